"""Description of a robot as it is in a TOML file: the tables that all kinds of robots share.

Every quantity is in SI units unless its key says otherwise. Derived quantities (matrices, URDF,
meshes) are generated from the description and never written down.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Self, TypeAlias

import msgspec
import numpy as np
from msgspec import Meta

from tsd_twin.errors import TwinError
from tsd_twin.kinematics import Joint, Kinematics, SingularityKinematics
from tsd_twin.lie import Array

RPM = math.pi / 30.0
"""One turn a minute in radians a second."""


_LAG_SHARE = 0.1
"""Share of its speed that a motor may be behind while the speed is changed: what the model has
wrong of a time constant shows in the motion by this share of it."""


@dataclass(frozen=True, slots=True, eq=False)
class WheelSpeedRange:
    """A gear without steps: any spin between two, chosen by the speed range that is wanted.

    All follows from rolling, v = r_w spin sin(tilt): a faster wheel drives faster at the same tilt,
    and by as much more with each step of a servo. The page shows both (`static/wheel_speed.js`).
    """

    kinematics: SingularityKinematics
    """In the gear of the description."""
    least_rad_per_s: float
    """The slowest spin at which all motors turn."""
    most_rad_per_s: float
    """The fastest spin that all motors reach."""
    servo_step_rad: float

    def top_speed_mps(self, spin_rad_per_s: float) -> float:
        """Return the speed of a wheel over the ground at the tilt limit."""
        rim_mps = self.kinematics.wheel_radius_m * spin_rad_per_s
        return rim_mps * math.sin(self.kinematics.max_tilt_rad)

    def refusal(self, spin_rad_per_s: float) -> str:
        """Return why a spin cannot be chosen, as part of a sentence; "" when it can."""
        # What is not a number is not between them.
        if self.least_rad_per_s <= spin_rad_per_s <= self.most_rad_per_s:
            return ""
        least, most = self.least_rad_per_s / RPM, self.most_rad_per_s / RPM
        return f"the wheels turn at {least:,.0f} to {most:,.0f} rpm"

    def rate_rad_per_s2(
        self, spin_rad_per_s: float, time_constant_s: float, deceleration_mps2: float
    ) -> float:
        """Return how fast the spin may be changed while the robot drives.

        Its motors follow to within a tenth, and the top speed falls no faster than the robot brakes
        within its limits.
        """
        fall = deceleration_mps2 / self.top_speed_mps(1.0)
        return min(_LAG_SHARE * spin_rad_per_s / time_constant_s, fall)


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


class PoseSensor(Table, frozen=True):
    """`[pose_sensor]`: how exact poses are that somebody else sees, as a camera above the floor.

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


class RobotDescription(Table, frozen=True, kw_only=True):
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
    pose_sensor: PoseSensor = PoseSensor()

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

    def kinematics(self) -> Kinematics[Any]:
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
    def wheel_speed_range(self) -> WheelSpeedRange | None:
        """The speeds that its wheels may spin at, where they always spin and one can be chosen."""
        return None

    @property
    def lag_s(self) -> float:
        """Time constant with which the motion of the robot follows its set-points."""
        return self.spin_up().up_s

    def problems(self) -> Iterator[Problem]:
        """Yield what no single value can show to be wrong."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True, eq=False)
class ActuatorOffsets:
    """A gimbal stands `offset` beside where its servo says; a wheel turns `scale` times as fast.

    Joints are what the drive reckons with. Servos and motor tables are told, and tell, something
    else, and this is the only place where one becomes the other.
    """

    offset: Array
    """(n,): radians, 0 for wheels."""
    scale: Array
    """(n,): 1 for gimbals."""

    def __post_init__(self) -> None:
        for name in ("offset", "scale"):
            value = np.array(getattr(self, name), dtype=float)
            value.setflags(write=False)
            object.__setattr__(self, name, value)

    def to_actuators(self, joints: Array) -> Array:
        """Return what actuators are told (..., n) so that the joints do `joints` (..., n)."""
        return (joints - self.offset) / self.scale

    def from_actuators(self, told: Array) -> Array:
        """Return what joints do (..., n) when their actuators are told `told` (..., n)."""
        return told * self.scale + self.offset

    def from_servos(self, said: Array) -> Array:
        """Return joints (..., n) from what servos say; the speed of a wheel is measured itself."""
        return said + self.offset

    def to_servos(self, joints: Array) -> Array:
        """Return what servos say (..., n) of `joints` (..., n): the inverse of `from_servos`."""
        return joints - self.offset


class Gyro(Table, frozen=True):
    """`[gyro]`: measures how fast the robot turns about the vertical.

    As given: of a small MEMS gyro, by the data sheet of the Bosch BMI270 (0.007 deg/s/sqrt(Hz)).
    """

    noise_rad_per_s: Positive = 0.0012
    """Standard deviation of one reading, at the 100 Hz of the core."""
    bias_rad_per_s: NotNegative = 0.0005
    """Standard deviation of the offset, which stays for the run: what is left after a second at
    rest."""


class Floor(Table, frozen=True):
    """`[floor]`: what a wheel that spins on the spot rubs on, for plants with friction."""

    friction: NotNegative = 0.8
    """Coefficient: rubber, or a printed wheel, on a dry hard floor."""
    patch_radius_m: Positive = 0.0005
    """Of the spot that touches. By Hertz: 10 N on a sphere of 40 mm of hard plastic (2 GPa)."""


class ModelErrors(Table, frozen=True):
    """`[errors]`: how a built robot differs from its description. 0 is none, of each."""

    zero_deg: NotNegative = 0.0
    """Standard deviation of where each gimbal has its zero: it stands there when told 0."""
    dead_band_deg: NotNegative = 0.0
    """A gimbal servo that is this close to its goal does not move any more."""
    backlash_deg: NotNegative = 0.0
    """Play of its gears, in all: after a reversal the motor turns so far alone."""
    delay_s: NotNegative = 0.0
    """Set-points reach the actuators so much later, and measurements are so old."""
    battery_share: NotNegative = 0.0
    """Standard deviation of the battery's voltage, as a share of the nominal one."""
    layer_m: NotNegative = 0.0
    """Height of a printed layer: the radius of a wheel is wrong by up to half of it."""

    def scaled(self, scale: float) -> ModelErrors:
        """Return all of them `scale` times as large; 0 is a machine without any.

        Raises:
            TwinError: the scale is negative, or not a number.
        """
        if not 0.0 <= scale < math.inf:
            raise TwinError(f"errors are scaled by 0, which is none, or more, not by {scale:g}")
        return msgspec.structs.replace(
            self, **{name: scale * getattr(self, name) for name in self.__struct_fields__}
        )


class GearedMotor(Table, frozen=True):
    """`[motor]`: one drive motor with gearbox, encoder and speed control; all are alike."""

    power_w: Positive
    """The most that it can give, at half its no-load speed."""
    gear_ratio: Positive
    """Turns of the motor for one of the wheel."""
    no_load_speed_rpm: Positive
    """Of the motor, at the nominal voltage of the battery."""
    rotor_inertia_kg_m2: Positive
    """Of the motor's own rotor."""
    time_constant_s: Positive
    """Of the speed control: how fast a wheel follows its set-point."""
    current_limit: Positive = 1.0
    """Most torque that the driver lets through, as a share of the stall torque."""

    @property
    def top_speed_rad_per_s(self) -> float:
        """Of the wheel, without load."""
        return self.no_load_speed_rpm * RPM / self.gear_ratio

    @property
    def stall_torque_nm(self) -> float:
        """At the wheel: a straight torque curve has its most power at half speed and torque."""
        return 4.0 * self.power_w / self.top_speed_rad_per_s

    @property
    def rotor_at_wheel_kg_m2(self) -> float:
        """Inertia of the rotor as the wheel feels it."""
        return self.rotor_inertia_kg_m2 * self.gear_ratio**2

    def acceleration_rad_per_s2(self, inertia_kg_m2: float) -> float:
        """Return what a wheel that feels an inertia can do from standing."""
        return self.stall_torque_nm * min(1.0, self.current_limit) / inertia_kg_m2

    def spin_up(self) -> SpinUp:
        """Return how a wheel follows its set-point, as long as torque and grip suffice."""
        return SpinUp(0.0, self.time_constant_s, self.time_constant_s)


def carried_kg_m2(twist_from_speeds: Array, body: Array) -> float:
    """Return the most inertia that a wheel feels of a body with masses and inertias `body` (3,).

    The largest over all motions: the kinetic energy of the body in terms of the wheel speeds.
    """
    by_wheels = twist_from_speeds.T @ (body[:, None] * twist_from_speeds)
    return float(np.linalg.eigvalsh(by_wheels)[-1])


class WheelNoise(Table, frozen=True):
    """`[noise]`: standard deviations, for the covariance and as the simulator's default."""

    spin_share: NotNegative = 0.0
    """Of a measured wheel speed."""


class GearedMotorDescription(RobotDescription, frozen=True, kw_only=True):
    """A robot whose wheels, all alike, turn by geared motors."""

    motor: GearedMotor
    noise: WheelNoise = WheelNoise()

    def joint_errors(self) -> JointErrors:
        """Return the noise of the wheel speeds."""
        return JointErrors(spin_share=self.noise.spin_share)

    def spin_up(self) -> SpinUp:
        """Return how wheels follow their set-points."""
        return self.motor.spin_up()
