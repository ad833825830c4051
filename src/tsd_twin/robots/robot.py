"""The description of a robot, as it stands in a TOML file: what all kinds have in common.

Every quantity is SI unless its key says otherwise. Derived things (matrices, URDF, meshes) are
generated from it, never written down.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Self, TypeAlias

import msgspec
from msgspec import Meta

from tsd_twin.drives import Drive, Joint
from tsd_twin.robots.gears import Gears

Positive: TypeAlias = Annotated[float, Meta(gt=0.0)]
NotNegative: TypeAlias = Annotated[float, Meta(ge=0.0)]
Share: TypeAlias = Annotated[float, Meta(ge=0.0, le=1.0)]
Colour: TypeAlias = tuple[Share, Share, Share, Share]
"""Red, green, blue (sRGB) and opacity."""
Name: TypeAlias = Annotated[str, Meta(pattern=r"^[a-z0-9_-]{1,32}\Z")]
"""Names that become part of a bus key; `$` would let a newline at the end pass."""
Problem: TypeAlias = tuple[str, str]
"""What is wrong, and what would be right, or nothing."""


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table of the file: unknown keys are errors, values are read-only."""


class Limits(Table, frozen=True):
    """`[limits]`: what a command is scaled to, as a whole, keeping direction and curvature."""

    speed_mps: Positive
    turn_rate_rad_per_s: Positive
    acceleration_mps2: Positive
    deceleration_mps2: Positive
    """Also that of the controlled stop when commands fail to come."""
    angular_acceleration_rad_per_s2: Positive
    command_timeout_s: Positive = 0.2
    """Without a counted command for this long, the robot stops by itself."""
    max_command_age_s: Positive = 0.25
    """Age beyond which a command does not count, unless the lease was granted with more."""
    max_command_age_ceiling_s: Positive = 1.0
    """The most that a lease can be granted with."""
    stop_allowance_m: Positive = 0.3
    """Travel within which the robot stops when its link fails in any way; the speed is capped so
    that this holds, under every lease."""


class Battery(Table, frozen=True):
    """`[battery]`."""

    nominal_v: Positive


class Body(Table, frozen=True):
    """`[body]`: what the robot looks like, as far as the drive leaves it open."""

    plate_thickness_m: Positive = 0.006
    """Of the acrylic sheet that decks and ribs are cut from."""
    ground_clearance_m: Positive = 0.013
    """Under the lower deck, or less where the wheels are too small for it."""
    acrylic_rgba: Colour = (0.16, 0.44, 0.62, 0.42)
    frame_rgba: Colour = (0.80, 0.82, 0.85, 1.0)
    wheel_rgba: Colour = (0.96, 0.36, 0.05, 1.0)
    front_rgba: Colour = (0.60, 0.90, 0.05, 1.0)
    """Of the arrow that points forward."""
    meshes: str | None = None
    """Folder with a `parts.json`, shown instead of the generated look."""


class OutsidePose(Table, frozen=True):
    """`[outside_pose]`: how exact poses are that somebody else sees, as a camera above the floor.

    As given: of the camera that `tsd-lab` and `tsd-mock --camera` simulate.
    """

    sigma_m: Positive = 0.005
    """Standard deviation of x, and of y."""
    sigma_deg: Positive = 1.15
    """Of the heading."""


@dataclass(frozen=True, slots=True)
class JointErrors:
    """Standard deviations of what is measured of the joints."""

    angle_rad: float = 0.0
    """Of a position joint."""
    spin_share: float = 0.0
    """Of a velocity joint, as a share of its speed."""


@dataclass(frozen=True, slots=True)
class SpinUp:
    """How the speed of a wheel follows its set-point: first order."""

    start_speed_rad_per_s: float
    """A set-point below this turns nothing."""
    up_s: float
    """Time constant when the wheel gets faster."""
    down_s: float
    """Time constant when it gets slower."""


class Robot(Table, frozen=True, kw_only=True):
    """A whole robot: what every kind has, and what the core asks of every kind.

    A kind adds its own tables, `drive` among them, and stands in the table `KINDS`.
    """

    name: Name
    title: str
    sources: Sequence[str] = ()
    """Where the figures come from."""
    assumptions: Sequence[str] = ()
    """What no source gives, and was chosen."""
    limits: Limits
    battery: Battery
    body: Body = Body()
    outside_pose: OutsidePose = OutsidePose()

    @property
    def arming_hold_s(self) -> float:
        """Time at zero throttle that arming takes before anything may turn; 0: just enable."""
        return 0.0

    @property
    def measures_spin(self) -> bool:
        """Whether the speed of the wheels is measured; else it comes from `spin_up`."""
        return True

    @property
    def sensors(self) -> tuple[Joint, ...]:
        """What is measured besides the joints of the drive, after them in this order."""
        return ()

    def kinematics(self) -> Drive[Any]:
        """Return the drive."""
        raise NotImplementedError

    @property
    def delay_s(self) -> float:
        """Time by which a bus makes set-points and measurements late."""
        return 0.0

    def with_errors(self, scale: float) -> Self:  # noqa: ARG002  The shape.
        """Return the robot with `scale` times its `[errors]`, which not every kind has."""
        return self

    def joint_errors(self) -> JointErrors:
        """Return how noisy the measured joints are."""
        raise NotImplementedError

    def spin_up(self) -> SpinUp:
        """Return how wheels follow their set-points."""
        raise NotImplementedError

    @property
    def gears(self) -> Gears | None:
        """The speeds that its wheels may spin at, where they always spin and one can be chosen."""
        return None

    @property
    def lag_s(self) -> float:
        """Time constant with which the motion of the robot follows its set-points."""
        return self.spin_up().up_s

    def problems(self) -> Iterator[Problem]:
        """Yield what no single value can show to be wrong."""
        raise NotImplementedError
