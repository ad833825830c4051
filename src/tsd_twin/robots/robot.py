"""The description of a robot, as it stands in a TOML file.

Every quantity is SI unless its key says otherwise. Derived things (matrices, URDF, meshes) are
generated from it, never written down.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, TypeAlias

import msgspec
import numpy as np
from msgspec import Meta

from tsd_twin.drives import SingularityDrive

RPM = math.pi / 30.0
"""One turn a minute in radians a second."""

Positive: TypeAlias = Annotated[float, Meta(gt=0.0)]
NotNegative: TypeAlias = Annotated[float, Meta(ge=0.0)]
Share: TypeAlias = Annotated[float, Meta(ge=0.0, le=1.0)]
Colour: TypeAlias = tuple[Share, Share, Share, Share]
"""Red, green, blue (sRGB) and opacity."""
Name: TypeAlias = Annotated[str, Meta(pattern=r"^[a-z0-9_-]{1,32}\Z")]
"""Names that become part of a bus key; `$` would let a newline at the end pass."""


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table of the file: unknown keys are errors, values are read-only."""


class SingularityGeometry(Table, frozen=True, tag="singularity", tag_field="kind"):
    """`[drive]` of a singularity drive."""

    azimuths_deg: Annotated[list[float], Meta(min_length=2)]
    """Direction of each pivot, from X forward towards Y left."""
    pivot_radius_m: Positive
    wheel_radius_m: Positive
    max_tilt_deg: Annotated[float, Meta(gt=0.0, lt=80.0)]
    cruise_speed_rpm: Positive
    """Speed of the wheels when the robot is ready: the gear."""

    @property
    def modules(self) -> int:
        """Number of wheels."""
        return len(self.azimuths_deg)


DriveGeometry: TypeAlias = SingularityGeometry
"""Union of the `[drive]` tables, told apart by `kind`."""


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
    """Travel allowed after a late command; the speed cap of a lease with a larger age follows."""


class Servo(Table, frozen=True):
    """`[servo]`: one gimbal actuator."""

    model: str
    steps_per_turn: Annotated[int, Meta(gt=0)]
    no_load_speed_rpm: Positive
    """At the nominal voltage of the battery."""
    approach_rate_per_s: Positive
    """Close to the goal the error decays exponentially, at this rate."""
    stall_torque_nm: Positive = 6.0
    """At the nominal voltage of the battery; of an MX-64 unless given."""
    size_m: tuple[Positive, Positive, Positive] = (0.0402, 0.0611, 0.041)
    """Width, length and depth along the shaft, of the case; of an MX-64 unless given."""


class Motor(Table, frozen=True):
    """`[motor]`: the drive motors with their speed controllers, one curve for each wheel."""

    signal: Annotated[list[float], Meta(min_length=2)]
    """Throttle signal of each row of the calibration table, rising."""
    speed_rpm: Annotated[list[list[NotNegative]], Meta(min_length=1)]
    """Measured speed at each signal, one list for each motor."""
    start_speed_rpm: NotNegative
    """Below this the motor does not turn."""
    time_constant_up_s: Positive
    time_constant_down_s: Positive
    pulse_low_us: Positive = 1000.0
    """Pulse width that the lowest signal stands for."""
    pulse_high_us: Positive = 2000.0
    arming_hold_s: NotNegative = 2.0
    """Time at zero throttle that the speed controllers need before they arm."""


class Battery(Table, frozen=True):
    """`[battery]`."""

    nominal_v: Positive


class Mass(Table, frozen=True):
    """`[mass]`: for the dynamics and the URDF."""

    total_kg: Positive
    wheel_kg: Positive
    gimbal_kg: Positive
    """Of one outer or inner frame with what it carries."""


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


class Noise(Table, frozen=True):
    """`[noise]`: standard deviations, for the covariance and as the simulator's default."""

    gimbal_angle_deg: NotNegative = 0.0
    spin_share: NotNegative = 0.0
    """Of a wheel's speed."""


class Robot(Table, frozen=True, kw_only=True):
    """A whole robot."""

    name: Name
    title: str
    sources: Sequence[str] = ()
    """Where the figures come from."""
    assumptions: Sequence[str] = ()
    """What no source gives, and was chosen."""
    drive: DriveGeometry
    limits: Limits
    servo: Servo
    motor: Motor
    battery: Battery
    mass: Mass
    body: Body = Body()
    noise: Noise = Noise()

    def kinematics(self) -> SingularityDrive:
        """Return the drive in its cruising gear."""
        g = self.drive
        return SingularityDrive(
            azimuths_rad=np.radians(g.azimuths_deg),
            pivot_radius_m=g.pivot_radius_m,
            wheel_radius_m=g.wheel_radius_m,
            spin_rad_per_s=g.cruise_speed_rpm * RPM,
            max_tilt_rad=float(np.radians(g.max_tilt_deg)),
            max_tilt_rate_rad_per_s=self.servo.no_load_speed_rpm * RPM,
        )
