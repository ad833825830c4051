"""Robot descriptions in TOML: the tables shared by all kinds of robots.

Quantities are in SI units unless the key says otherwise. Derived quantities (matrices, URDF,
meshes) are generated from the description and never stored.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self

import msgspec
import numpy as np
from msgspec import Meta

from tsd_twin.errors import TwinError
from tsd_twin.kinematics import Joint, Kinematics, SingularityKinematics
from tsd_twin.kinematics.base import set_matrices
from tsd_twin.lie import Array
from tsd_twin.sensors import MountedSensor, SensorTable, mounted, read_tables
from tsd_twin.sensors.pose import PoseSensor
from tsd_twin.tables import Colour, Name, NotNegative, Positive, Problem, Table

RPM = math.pi / 30.0
"""rad/s per rpm."""
GRAVITY_MPS2 = 9.81

_MAX_RELATIVE_LAG = 0.1
"""Maximum motor lag while the speed changes, relative to the speed; a wrong time constant in the
model causes at most this relative error of the motion."""


@dataclass(frozen=True, slots=True, eq=False)
class WheelSpeedRange:
    """Range of selectable speeds for continuously spinning wheels.

    It follows from rolling, v = r_w spin sin(tilt): faster wheels raise the top speed, and equally
    the speed change per servo step. The page shows both (`web/src/panel/`).
    """

    kinematics: SingularityKinematics
    """Kinematics at the described wheel speed."""
    least_rad_per_s: float
    """Minimum speed at which all motors turn."""
    most_rad_per_s: float
    """Maximum speed that all motors reach."""
    servo_step_rad: float

    def top_speed_mps(self, spin_rad_per_s: float) -> float:
        """Return the ground speed at the tilt limit."""
        rim_mps = self.kinematics.wheel_radius_m * spin_rad_per_s
        return rim_mps * math.sin(self.kinematics.max_tilt_rad)

    def allows(self, spin_rad_per_s: float) -> bool:
        """Return whether a speed is selectable."""
        # False for NaN.
        return self.least_rad_per_s <= spin_rad_per_s <= self.most_rad_per_s

    def rate_rad_per_s2(
        self, spin_rad_per_s: float, time_constant_s: float, deceleration_mps2: float
    ) -> float:
        """Return the rate limit of the wheel speed while the robot drives.

        The motors then follow to within a tenth, and the top speed falls no faster than the robot
        brakes within its limits.
        """
        fall = deceleration_mps2 / self.top_speed_mps(1.0)
        return min(_MAX_RELATIVE_LAG * spin_rad_per_s / time_constant_s, fall)


PACKAGE_NAME = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9._-]{0,62}[A-Za-z0-9])?")
"""Name of a Python package."""


class Limits(Table, frozen=True):
    """`[limits]`: commands are scaled to these uniformly, keeping direction and curvature."""

    speed_mps: Positive
    turn_rate_rad_per_s: Positive
    acceleration_mps2: Positive
    deceleration_mps2: Positive
    """Also used for the controlled stop if commands fail to arrive."""
    angular_acceleration_rad_per_s2: Positive
    command_timeout_s: Positive = 0.2
    """The robot stops automatically after this time without an accepted command."""
    max_command_age_s: Positive = 0.25
    """Maximum command age, unless the lease was granted with a larger one."""
    max_command_age_ceiling_s: Positive = 1.0
    """Maximum command age that a lease can be granted with."""
    stop_allowance_m: Positive = 0.3
    """Maximum stopping distance after any link failure; the speed is capped accordingly under every
    lease."""


class Battery(Table, frozen=True):
    """`[battery]`: nominal voltage and thresholds."""

    nominal_v: Positive
    warn_v: NotNegative = 0.0
    """Below this, operators are warned and the robot drives slowly; 0 disables a threshold."""
    low_speed_share: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.5
    """Factor on the limits of speed and turn rate below `warn_v`."""
    arm_v: NotNegative = 0.0
    """Below this, the controller board refuses to arm."""
    stop_v: NotNegative = 0.0
    """Below this for 1 s, the controller board stops and shuts off the wheels."""

    def __post_init__(self) -> None:
        """Check the order.

        Raises:
            ValueError: If the thresholds do not increase.
        """
        thresholds = [volts for volts in (self.stop_v, self.arm_v, self.warn_v) if volts]
        if thresholds != sorted(thresholds):
            raise ValueError("stop_v, arm_v and warn_v must rise in this order")


class Body(Table, frozen=True):
    """`[body]`: appearance of the robot, where the drive does not determine it."""

    plate_thickness_m: Positive = 0.006
    """Thickness of the acrylic sheet of decks and ribs."""
    ground_clearance_m: Positive = 0.013
    """Clearance under the lower deck, or less if the wheels are too small."""
    acrylic_rgba: Colour = (0.16, 0.44, 0.62, 0.42)
    frame_rgba: Colour = (0.80, 0.82, 0.85, 1.0)
    wheel_rgba: Colour = (0.96, 0.36, 0.05, 1.0)
    front_rgba: Colour = (0.60, 0.90, 0.05, 1.0)
    """Colour of the arrow that points forward."""
    meshes: str | None = None
    """Folder with a `parts.json`, shown instead of the generated model."""


@dataclass(frozen=True, slots=True)
class FloorErrors:
    """Standard deviations of floor effects on robots with continuously spinning wheels.

    They have three independent causes: drag grows with friction and contact patch, lag falls with
    friction, and lost energy depends on neither. The first four hold at one wheel speed.
    """

    at_rad_per_s: float = 1.0
    """Wheel speed at which the other values hold."""
    speed_scale_sigma: float = 0.0
    """Drag: relative speed loss of a wheel due to floor friction; the absolute loss is the same at
    any speed."""
    turn_rad_per_s: float = 0.0
    """Drag: turn rate against the wheels' spin that joints cannot measure; proportional to the
    wheel speed."""
    slip_lag_s: float = 0.0
    """Lag: time by which the motion lags the joints; proportional to the wheel speed."""
    grip_per_s2: tuple[float, float, float] = (1e3, 1e3, 1e3)
    """Lag: acceleration (m/s², rad/s²) at which the floor saturates."""
    droop_s2_per_m2: float = 0.0
    """Lost energy: relative loss of wheel speed per change of the squared robot speed, when the
    robot accelerates; falls with the square of the wheel speed."""
    restore_up_s: float = 1.0
    """Time constant with which motors restore lost wheel speed."""
    restore_down_s: float = 1.0
    """Time constant with which motors remove gained wheel speed."""
    turn_per_spin: float = 0.0
    """Turn-rate change of the robot equivalent, in floor force, to a unit change of a wheel's
    speed."""


@dataclass(frozen=True, slots=True)
class JointErrors:
    """Standard deviations of measured joints."""

    angle_rad: float = 0.0
    """White noise of a position joint."""
    rounding_rad: float = 0.0
    """Additional rounding error of a joint at rest between two encoder steps."""
    speed_scale_sigma: float = 0.0
    """Bias of a velocity joint, relative to its speed."""
    common_spin_share: float = 0.0
    """Common relative bias of all velocity joints."""
    motor_share: float = 0.0
    """Part of `common_spin_share` that remains if the supply voltage is known."""
    zero_rad: float = 0.0
    """Bias of a position joint's zero."""
    floor: FloorErrors = FloorErrors()
    """Floor effects on continuously spinning wheels; a bias."""
    creep_lag_s: tuple[tuple[float, ...], ...] | None = None
    """(3, 3): twist by which a body lags its rollers per acceleration in m/s² and rad/s², scaled by
    one standard normal number; None without creep."""
    mount_rad: float = 0.0
    """Angle at which a wheel or module is mounted wrongly; a bias."""
    place_m: float = 0.0
    """Displacement of a wheel or pivot along X and along Y; a bias."""
    slope_mps2: float = 0.0
    """Acceleration along a sloping floor, for each of two directions; a bias."""
    random_walk_rad: float = 0.0
    """Random walk of each velocity joint's angle after one second in which any of them turns; grows
    with the square root of time."""

    @property
    def common_mode_sigma(self) -> float:
        """Total common relative bias of all velocity joints."""
        return math.hypot(self.common_spin_share, self.floor.speed_scale_sigma)


@dataclass(frozen=True, slots=True)
class WheelSpeedResponse:
    """First-order model of a wheel speed following its setpoint."""

    start_speed_rad_per_s: float
    """Dead band: setpoints below this do not turn the motor."""
    up_s: float
    """Time constant of acceleration."""
    down_s: float
    """Time constant of deceleration."""


@dataclass(frozen=True, slots=True, eq=False)
class JointCompliance:
    """Expected deviations of position joints of a healthy robot.

    Joints deflect under contact forces. The force of a sliding contact is proportional to its slip,
    as long as the slip is small.
    """

    by_acceleration: Array
    """(n, 3): deflection per acceleration over the ground, rad per m/s² and rad/s²."""
    by_force: Array
    """(n, m): deflection per floor force along each residual component, rad/N."""
    friction_n: float
    """Maximum friction of a sliding contact."""
    spin_to_slip_m: float
    """Slip per wheel speed at which the force reaches 71 % of the friction."""
    lag_s: float
    """Time constant with which joints follow their setpoints."""
    backlash_rad: float
    """Total backlash: maximum lag of a joint after a reversal, within its dynamic lag."""
    dead_band_rad: float
    """Maximum error of a joint at rest."""

    def by_slip(self, spin_rad_per_s: float) -> Array:
        """Return the deflection (n, m) per slip of each contact, rad per m/s."""
        slip_mps = self.spin_to_slip_m * abs(spin_rad_per_s)
        if slip_mps <= 0.0:
            return np.zeros_like(self.by_force)
        return self.friction_n / slip_mps * self.by_force


class RobotDescription(Table, frozen=True, kw_only=True):
    """Description of a robot: tables and derived values common to all kinds.

    Each kind adds its own tables, including `drive`. Shipped kinds are listed in `robots/kinds.py`;
    other packages provide theirs through an entry point, see `registry`.
    """

    name: Name
    title: str
    package: Annotated[str, Meta(pattern=rf"^({PACKAGE_NAME.pattern})?\Z")] = ""
    """Python package that provides the kind; the error names it if it is not installed."""
    sources: Sequence[str] = ()
    """Sources of the values."""
    assumptions: Sequence[str] = ()
    """Assumed values that no source provides."""
    limits: Limits
    battery: Battery
    body: Body = Body()
    pose_sensor: PoseSensor = PoseSensor()
    sensor_tables: Sequence[Any] = msgspec.field(default=(), name="sensors")
    """Entries of `[[sensors]]`, as `SensorTable`."""
    measures_spin: ClassVar[bool] = True
    """Whether wheel speeds are measured; otherwise the model `spin_up` estimates them."""
    driven_by_ros: ClassVar[bool] = False
    """Whether another controller drives it through ROS, without a node on the robot."""
    not_drawn: ClassVar[frozenset[str]] = frozenset((
        "title", "package", "sources", "assumptions", "limits", "battery", "pose_sensor",
        "calibration", "noise", "errors", "floor", "gyro", "motor", "sensor_tables",
        "wheel_sensor",
    ))  # fmt: skip
    """Names of the fields that no model depends on."""

    def __post_init__(self) -> None:
        """Convert the entries of `[[sensors]]` to the tables of their kinds.

        Raises:
            ValueError: If one is unknown or impossible.
        """
        msgspec.structs.force_setattr(self, "sensor_tables", read_tables(self.sensor_tables))

    @property
    def arming_hold_s(self) -> float:
        """Time at zero throttle needed for arming; 0 if enabling is immediate."""
        return 0.0

    @property
    def own_sensors(self) -> tuple[MountedSensor, ...]:
        """Sensors with a separate table, such as `[gyro]`."""
        return ()

    @property
    def mounted_sensors(self) -> tuple[MountedSensor, ...]:
        """Entries of `[[sensors]]`."""
        tables: Sequence[SensorTable] = self.sensor_tables
        return tuple(map(mounted, tables))

    @property
    def sensors(self) -> tuple[Joint, ...]:
        """Channels of all sensors; their readings follow the drive's joints in this order."""
        every = (*self.own_sensors, *self.mounted_sensors)
        return tuple(each for sensor, table in every for each in sensor.channels(table))

    @property
    def not_promised(self) -> tuple[str, ...]:
        """Rules of safety.md that do not hold for this robot, a sentence each."""
        return ()

    @property
    def drives_sideways(self) -> bool:
        """Whether the robot moves in all directions; paths are planned only for such robots."""
        return True

    def kinematics(self) -> Kinematics[Any]:
        """Return the kinematics."""
        raise NotImplementedError

    @property
    def servo_limit_c(self) -> float:
        """Temperature at which servos shut off, deg C."""
        return 80.0

    @property
    def delay_s(self) -> float:
        """Delay of setpoints and measurements on the actuator bus."""
        return 0.0

    def with_errors(self, scale: float) -> Self:  # noqa: ARG002  Common signature.
        """Return the robot with its `[errors]`, if any, multiplied by `scale`."""
        return self

    def with_delay(self, delay_s: float) -> Self:  # noqa: ARG002  Common signature.
        """Return the robot with this delay on its actuator bus, if it describes one."""
        return self

    def joint_errors(self) -> JointErrors:
        """Return the noise of the measured joints."""
        raise NotImplementedError

    def joint_compliance(self) -> JointCompliance | None:
        """Return the deflection of joints under forces, or None if they are rigid."""
        return None

    def spin_up(self) -> WheelSpeedResponse:
        """Return the first-order model of the wheel speeds."""
        raise NotImplementedError

    @property
    def stopping_s(self) -> float:
        """Maximum stopping distance after the hardware stops the robot, as time at full speed.

        It applies to running-down wheels as well as braking.
        """
        limits = self.limits
        return max(self.spin_up().down_s, limits.speed_mps / (2.0 * limits.deceleration_mps2))

    @property
    def spin_droop_s2_per_m2(self) -> float:
        """Relative loss of speed of spinning wheels when the robot accelerates.

        It is given per change of the squared robot speed; 0 if wheels turn only with the robot.
        """
        return 0.0

    @property
    def wheel_speed_range(self) -> WheelSpeedRange | None:
        """Selectable speeds of continuously spinning wheels, or None without a choice."""
        return None

    @property
    def lag_s(self) -> float:
        """Time constant with which the robot's motion follows its setpoints."""
        return self.spin_up().up_s

    def problems(self) -> Iterator[Problem]:
        """Yield violations of rules that involve several values."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True, eq=False)
class ActuatorOffsets:
    """Calibration between joints and actuators: gimbal zero offsets and wheel-speed scales.

    A gimbal angle is its servo angle plus `offset`; a wheel turns at `scale` times its motor-table
    speed. Kinematics use joint values only; only this class converts them.
    """

    offset: Array
    """(n,): radians, 0 for wheels."""
    scale: Array
    """(n,): 1 for gimbals."""

    def __post_init__(self) -> None:
        arrays = {"offset": np.array(self.offset, float), "scale": np.array(self.scale, float)}
        set_matrices(self, arrays)

    def to_actuators(self, joints: Array) -> Array:
        """Convert joint setpoints (..., n) to actuator setpoints (..., n)."""
        return (joints - self.offset) / self.scale

    def from_actuators(self, setpoints: Array) -> Array:
        """Convert actuator setpoints (..., n) to joint values (..., n)."""
        return setpoints * self.scale + self.offset

    def from_servos(self, measured: Array) -> Array:
        """Convert measured servo angles to joints (..., n); wheel speeds are measured directly."""
        return measured + self.offset

    def to_servos(self, joints: Array) -> Array:
        """Convert `joints` (..., n) to measured servo angles (..., n); inverse of `from_servos`."""
        return joints - self.offset


class Floor(Table, frozen=True):
    """`[floor]`: friction and contact patch of a spinning wheel, for plants with friction."""

    friction: NotNegative = 0.8
    """Friction coefficient: rubber or a printed wheel on a dry hard floor."""
    patch_radius_m: Positive = 0.0005
    """Hertzian contact radius: 10 N on a 40 mm sphere of hard plastic (2 GPa)."""


class BuildErrors(Table, frozen=True, kw_only=True):
    """`[errors]`: deviations of a built robot and floor from the description; 0 disables one."""

    mount_deg: NotNegative = 0.0
    """Standard deviation of the angle at which each wheel or module is mounted, and of that of the
    rollers of a Mecanum wheel."""
    place_m: NotNegative = 0.0
    """Standard deviation of each coordinate of a wheel or pivot."""
    slope_deg: NotNegative = 0.0
    """Slope of the floor, in any direction."""

    def scaled(self, scale: float) -> Self:
        """Return the errors multiplied by `scale`.

        Raises:
            TwinError: If the scale is negative or not finite.
        """
        if not 0.0 <= scale < math.inf:
            raise TwinError(f"errors are scaled by 0, which is none, or more, not by {scale:g}")
        values = {name: scale * value for name, value in msgspec.structs.asdict(self).items()}
        return msgspec.structs.replace(self, **values)

    @property
    def slope_mps2(self) -> float:
        """Acceleration along a floor with that slope."""
        return GRAVITY_MPS2 * math.sin(math.radians(self.slope_deg))


class ModelErrors(BuildErrors, frozen=True, kw_only=True):
    """`[errors]`: deviations of a built robot from its description; 0 disables one."""

    zero_deg: NotNegative = 0.0
    """Standard deviation of each gimbal's zero offset."""
    dead_band_deg: NotNegative = 0.0
    """Dead band: a gimbal servo this close to its goal stops moving."""
    backlash_deg: NotNegative = 0.0
    """Total gear backlash, which the motor crosses after a reversal."""
    delay_s: NotNegative = 0.0
    """Delay of setpoints to the actuators, and age of measurements."""
    battery_share: NotNegative = 0.0
    """Standard deviation of the battery voltage, relative to the nominal voltage."""
    motor_share: NotNegative = 0.0
    """Standard deviation of the common relative error of all curves of `[motor]`."""
    layer_m: NotNegative = 0.0
    """Height of a printed layer; the wheel radius deviates by up to half of it."""
