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
from tsd_twin.robots.joint_model import JointCompliance, JointErrors, WheelSpeedResponse
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
