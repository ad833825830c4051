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
from tsd_twin.kinematics import Joint, JointKind, Kinematics, SingularityKinematics
from tsd_twin.lie import Array

RPM = math.pi / 30.0
"""One turn a minute in radians a second."""


_LAG_SHARE = 0.1
"""Largest lag of a motor during a change of speed, as a share of its speed: an error of the time
constant in the model shows in the motion by this share."""


@dataclass(frozen=True, slots=True, eq=False)
class WheelSpeedRange:
    """Range of spins that can be chosen for wheels that always spin.

    All follows from rolling, v = r_w spin sin(tilt): a faster wheel drives faster at the same tilt,
    and by as much more with each step of a servo. The page shows both (`static/wheel_speed.js`).
    """

    kinematics: SingularityKinematics
    """Kinematics at the wheel speed of the description."""
    least_rad_per_s: float
    """The slowest spin at which all motors turn."""
    most_rad_per_s: float
    """The fastest spin that all motors reach."""
    servo_step_rad: float

    def top_speed_mps(self, spin_rad_per_s: float) -> float:
        """Speed of a wheel over the ground at the tilt limit."""
        rim_mps = self.kinematics.wheel_radius_m * spin_rad_per_s
        return rim_mps * math.sin(self.kinematics.max_tilt_rad)

    def allows(self, spin_rad_per_s: float) -> bool:
        """Return whether a spin can be chosen."""
        # The comparison is false for NaN.
        return self.least_rad_per_s <= spin_rad_per_s <= self.most_rad_per_s

    def rate_rad_per_s2(
        self, spin_rad_per_s: float, time_constant_s: float, deceleration_mps2: float
    ) -> float:
        """Rate limit of the spin while the robot drives.

        The motors follow to within a tenth, and the top speed falls no faster than the robot brakes
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
"""A problem of a description, and its remedy or an empty text."""


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table of the file: unknown keys are errors, values are read-only."""


class Limits(Table, frozen=True):
    """`[limits]`: commands are scaled to these as a whole, keeping direction and curvature."""

    speed_mps: Positive
    turn_rate_rad_per_s: Positive
    acceleration_mps2: Positive
    deceleration_mps2: Positive
    """Also the deceleration of the controlled stop when commands fail to arrive."""
    angular_acceleration_rad_per_s2: Positive
    command_timeout_s: Positive = 0.2
    """Without a counted command for this long, the robot stops by itself."""
    max_command_age_s: Positive = 0.25
    """Age beyond which a command does not count, unless the lease was granted with more."""
    max_command_age_ceiling_s: Positive = 1.0
    """Largest command age that a lease can be granted with."""
    stop_allowance_m: Positive = 0.3
    """Travel within which the robot stops when its link fails in any way; the speed is capped so
    that this holds, under every lease."""


class Battery(Table, frozen=True):
    """`[battery]`."""

    nominal_v: Positive
    warn_v: NotNegative = 0.0
    """Below this, operators are warned, and the robot drives slowly; 0 is never, here and below."""
    low_speed_share: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.5
    """Share of the limits of speed and turn rate that is left below `warn_v`."""
    arm_v: NotNegative = 0.0
    """Below this, the controller board refuses to arm."""
    stop_v: NotNegative = 0.0
    """Below this for a second, the controller board stops and shuts off the wheels."""

    def __post_init__(self) -> None:
        """Check the order.

        Raises:
            ValueError: they do not rise.
        """
        thresholds = [volts for volts in (self.stop_v, self.arm_v, self.warn_v) if volts]
        if thresholds != sorted(thresholds):
            raise ValueError("stop_v, arm_v and warn_v must rise in this order")


class Body(Table, frozen=True):
    """`[body]`: appearance of the robot, as far as the drive does not determine it."""

    plate_thickness_m: Positive = 0.006
    """Thickness of the acrylic sheet of decks and ribs."""
    ground_clearance_m: Positive = 0.013
    """Under the lower deck, or less where the wheels are too small for it."""
    acrylic_rgba: Colour = (0.16, 0.44, 0.62, 0.42)
    frame_rgba: Colour = (0.80, 0.82, 0.85, 1.0)
    wheel_rgba: Colour = (0.96, 0.36, 0.05, 1.0)
    front_rgba: Colour = (0.60, 0.90, 0.05, 1.0)
    """Colour of the arrow that points forward."""
    meshes: str | None = None
    """Folder with a `parts.json`, shown instead of the generated model."""


class PoseSensor(Table, frozen=True):
    """`[pose_sensor]`: noise of an external pose sensor, such as a camera above the floor.

    The defaults are those of the camera that `tsd-lab` and `tsd-mock --camera` simulate.
    """

    sigma_m: Positive = 0.005
    """Standard deviation of x, and of y."""
    sigma_deg: Positive = 1.15
    """Standard deviation of the heading."""
    mounting_m: NotNegative = 0.01
    """Standard deviation of a constant error of x, and of y: the sensor is not where it is said to
    be."""
    mounting_deg: NotNegative = 0.5
    """Standard deviation of a constant error of the heading."""


@dataclass(frozen=True, slots=True)
class FloorErrors:
    """Standard deviations of what friction and pushes do to a robot whose wheels always spin.

    All come from the same floor, so they are all as many times these sizes. The first four hold
    at one wheel speed.
    """

    at_rad_per_s: float = 1.0
    """That wheel speed."""
    spin_share: float = 0.0
    """Share of its speed that a wheel loses to the floor; the loss is the same at any speed."""
    turn_rad_per_s: float = 0.0
    """Turn rate that no joint shows, against the spin; it grows with the wheel speed."""
    slip_lag_s: float = 0.0
    """Time by which the motion is behind the joints; it grows with the wheel speed."""
    droop_s2_per_m2: float = 0.0
    """Share of their speed that wheels lose to a robot that speeds up, for the difference of the
    squares of its speed; it falls with the square of the wheel speed."""
    restore_up_s: float = 1.0
    """Time constant with which motors restore what a wheel has lost."""
    restore_down_s: float = 1.0
    """Time constant with which they take back what a wheel has gained."""
    turn_per_spin: float = 0.0
    """Turn rate of the robot for which the floor pushes as much as for the spin of one wheel."""


@dataclass(frozen=True, slots=True)
class JointErrors:
    """Standard deviations of measured joints."""

    angle_rad: float = 0.0
    """Standard deviation of a position joint, new in each sample."""
    rounding_rad: float = 0.0
    """Standard deviation by which rounding adds to that, of a joint that rests between two
    steps."""
    spin_share: float = 0.0
    """Standard deviation of a velocity joint, as a share of its speed; constant."""
    common_spin_share: float = 0.0
    """Standard deviation of a share that is the same for all velocity joints; constant."""
    zero_rad: float = 0.0
    """Standard deviation of the zero of a position joint; constant."""
    floor: FloorErrors = FloorErrors()
    """What the floor does to wheels that always spin; constant."""
    creep_lag_s: tuple[tuple[float, ...], ...] | None = None
    """(3, 3): twist by which a body is behind its rollers, from its acceleration in m/s2 and
    rad/s2; as many times that as one standard normal number. None is without."""
    walk_rad: float = 0.0
    """Standard deviation of the way of each velocity joint in a second, while any of them turns; it
    grows with the square root of the time."""

    @property
    def alike_spin_share(self) -> float:
        """Standard deviation of the share by which all velocity joints are off alike."""
        return math.hypot(self.common_spin_share, self.floor.spin_share)


@dataclass(frozen=True, slots=True)
class SpinUp:
    """First-order model of a wheel speed that follows its set-point."""

    start_speed_rad_per_s: float
    """Dead band: a set-point below this does not turn the motor."""
    up_s: float
    """Time constant when the wheel gets faster."""
    down_s: float
    """Time constant when it gets slower."""


@dataclass(frozen=True, slots=True, eq=False)
class JointCompliance:
    """Deviations of position joints of a healthy robot from where they should be.

    Joints give way to forces at their contacts. A contact that slides has a force in proportion to
    its slip, as long as that is small.
    """

    by_acceleration: Array
    """(n, 3): deviation for an acceleration over the ground, rad for m/s^2 and rad/s^2."""
    by_force: Array
    """(n, m): deviation for the force of the floor along each number of the residual, rad/N."""
    friction_n: float
    """Friction of a sliding contact."""
    spin_to_slip_m: float
    """Slip over the wheel speed at which the force is 71 % of the friction."""
    lag_s: float
    """Time constant with which joints follow their set-points."""
    play_rad: float
    """Total backlash: a joint that reverses is behind by up to this, and by no more than its
    lag."""
    dead_band_rad: float
    """Largest error that a joint at rest may keep."""

    def by_slip(self, spin_rad_per_s: float) -> Array:
        """Return the deviation (n, m) for the slip of each contact, rad for m/s."""
        slip_mps = self.spin_to_slip_m * abs(spin_rad_per_s)
        if slip_mps <= 0.0:
            return np.zeros_like(self.by_force)
        return self.friction_n / slip_mps * self.by_force


class RobotDescription(Table, frozen=True, kw_only=True):
    """Description of a robot: tables and derived figures that all kinds have in common.

    A kind adds its own tables, `drive` among them, and is registered in `KINDS`.
    """

    name: Name
    title: str
    sources: Sequence[str] = ()
    """Sources of the figures."""
    assumptions: Sequence[str] = ()
    """Assumed figures, which no source gives."""
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
        """Whether wheel speeds are measured; otherwise the model `spin_up` estimates them."""
        return True

    @property
    def sensors(self) -> tuple[Joint, ...]:
        """Additional sensors; their readings follow the joints of the drive in this order."""
        return ()

    @property
    def not_promised(self) -> tuple[str, ...]:
        """What the rules of safety.md cannot promise for this robot, a sentence each."""
        return ()

    @property
    def drives_sideways(self) -> bool:
        """Whether it moves in all directions; paths are planned for such robots only."""
        return True

    def kinematics(self) -> Kinematics[Any]:
        """Kinematics."""
        raise NotImplementedError

    @property
    def delay_s(self) -> float:
        """Delay of set-points and of measurements on the actuator bus."""
        return 0.0

    def with_errors(self, scale: float) -> Self:  # noqa: ARG002  The shape.
        """Robot with `scale` times its `[errors]`, which not every kind has."""
        return self

    def joint_errors(self) -> JointErrors:
        """Noise of the measured joints."""
        raise NotImplementedError

    def joint_compliance(self) -> JointCompliance | None:
        """Return how joints give way to forces; None if they do not."""
        return None

    def spin_up(self) -> SpinUp:
        """First-order model of the wheel speeds."""
        raise NotImplementedError

    @property
    def stopping_s(self) -> float:
        """Time for which a robot goes on at full speed, at most, once its hardware stops it.

        It moves as far until it stands: with wheels that run down, or as fast as it brakes.
        """
        limits = self.limits
        return max(self.spin_up().down_s, limits.speed_mps / (2.0 * limits.deceleration_mps2))

    @property
    def spin_droop_s2_per_m2(self) -> float:
        """Share of their speed that spinning wheels lose to the robot when it speeds up.

        For the difference of the squares of its speed after and before; 0 where wheels turn with
        the robot only.
        """
        return 0.0

    @property
    def wheel_speed_range(self) -> WheelSpeedRange | None:
        """The speeds that its wheels may spin at, where they always spin and one can be chosen."""
        return None

    @property
    def lag_s(self) -> float:
        """Time constant with which the motion of the robot follows its set-points."""
        return self.spin_up().up_s

    def problems(self) -> Iterator[Problem]:
        """Yield violations of rules that involve several values."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True, eq=False)
class ActuatorOffsets:
    """Calibration between joints and actuators: gimbal zero offsets and wheel-speed scales.

    A gimbal is at its servo's angle plus `offset`; a wheel turns `scale` times as fast as its motor
    table says. Kinematics use joint values only; this class alone converts them.
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
        """Convert joint set-points (..., n) to actuator set-points (..., n)."""
        return (joints - self.offset) / self.scale

    def from_actuators(self, setpoints: Array) -> Array:
        """Convert actuator set-points (..., n) to joint values (..., n)."""
        return setpoints * self.scale + self.offset

    def from_servos(self, measured: Array) -> Array:
        """Convert measured servo angles to joints (..., n); wheel speeds are measured directly."""
        return measured + self.offset

    def to_servos(self, joints: Array) -> Array:
        """Convert `joints` (..., n) to measured servo angles (..., n); inverse of `from_servos`."""
        return joints - self.offset


class Gyro(Table, frozen=True):
    """`[gyro]`: noise of a yaw-rate gyro.

    The defaults are those of a small MEMS gyro, by the data sheet of the Bosch BMI270.
    """

    noise_rad_per_s: Positive = 0.0012
    """Standard deviation of one reading, at the 100 Hz of the core."""
    bias_rad_per_s: NotNegative = 0.0005
    """Standard deviation of the offset, which stays for the run: what is left after a second at
    rest."""


GYRO_SENSORS = (Joint("gyro", JointKind.VELOCITY),)
"""Sensors of a robot whose only one is a yaw gyro."""


class Floor(Table, frozen=True):
    """`[floor]`: friction and contact patch of a spinning wheel, for plants with friction."""

    friction: NotNegative = 0.8
    """Coefficient: rubber, or a printed wheel, on a dry hard floor."""
    patch_radius_m: Positive = 0.0005
    """Radius of the contact patch, by Hertz: 10 N on a 40 mm sphere of hard plastic (2 GPa)."""


class ModelErrors(Table, frozen=True):
    """`[errors]`: size of each deviation of a built robot from its description; 0 is none."""

    zero_deg: NotNegative = 0.0
    """Standard deviation of the zero offset of each gimbal."""
    dead_band_deg: NotNegative = 0.0
    """Dead band: a gimbal servo this close to its goal stops moving."""
    backlash_deg: NotNegative = 0.0
    """Total backlash of its gears, which the motor crosses after a reversal."""
    delay_s: NotNegative = 0.0
    """Delay of set-points to the actuators, and age of measurements."""
    battery_share: NotNegative = 0.0
    """Standard deviation of the battery's voltage, as a share of the nominal one."""
    layer_m: NotNegative = 0.0
    """Height of a printed layer: the radius of a wheel is wrong by up to half of it."""

    def scaled(self, scale: float) -> ModelErrors:
        """Return all errors multiplied by `scale`; 0 gives a robot without errors.

        Raises:
            TwinError: the scale is negative, or not a number.
        """
        if not 0.0 <= scale < math.inf:
            raise TwinError(f"errors are scaled by 0, which is none, or more, not by {scale:g}")
        return msgspec.structs.replace(
            self, **{name: scale * getattr(self, name) for name in self.__struct_fields__}
        )
