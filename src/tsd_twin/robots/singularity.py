"""Description of a singularity drive: continuously spinning wheels on servo gimbals."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import ClassVar, Self

import msgspec
import numpy as np

from tsd_twin.kinematics import SingularityKinematics
from tsd_twin.robots.description import (
    GRAVITY_MPS2,
    RPM,
    ActuatorOffsets,
    Floor,
    ModelErrors,
    RobotDescription,
    WheelSpeedRange,
)
from tsd_twin.robots.joint_model import (
    FloorErrors,
    JointCompliance,
    JointErrors,
    WheelSpeedResponse,
)
from tsd_twin.robots.plausibility import proportion_problems
from tsd_twin.robots.singularity_parts import (
    MAX_PULSES_PER_S,
    Calibration,
    Mass,
    Motor,
    Noise,
    Servo,
    SingularityGeometry,
    WheelSensor,
)
from tsd_twin.sensors import MountedSensor
from tsd_twin.sensors.gyro import GYRO, Gyro
from tsd_twin.tables import Problem

_MEAN_LEVER = 3.0 * math.pi / 16.0
"""Friction lever of a purely spinning patch, in radii."""
_LAG_FACTOR = 2.5
"""Factor by which the lag on a floor typically differs from the described one: friction is 0.2 on
polished wood and 2 on rubber."""
_LAG_SIGMA = math.exp(math.log(_LAG_FACTOR) ** 2)
"""RMS of a log-normal lag with that factor, relative to its median."""
_GRIP_FACTOR = 1.25
"""Grip of a floor with one standard deviation of the lag, relative to the described floor. If
friction alone caused the lag, it would be 1 / `_LAG_SIGMA`, but that makes robots on the described
floor too uncertain. Tuned on seeds 5300 and up."""
_SPIN_IN_SLIP = 8.0 / (3.0 * math.pi)
"""Weight of the rim speed of a contact patch relative to its slip (Zhuravlev 1998)."""
_MAX_OFFSET_DEG = 10.0
"""Plausibility limit; beyond it the servo is mounted wrongly, and may hit a stop or a cable."""


class SingularityDescription(RobotDescription, frozen=True, kw_only=True):
    """Robot with a singularity drive."""

    drive: SingularityGeometry
    servo: Servo
    motor: Motor
    wheel_sensor: WheelSensor | None = None
    mass: Mass
    noise: Noise = Noise()
    gyro: Gyro | None = None
    calibration: Calibration = Calibration()
    floor: Floor = Floor()
    errors: ModelErrors = ModelErrors()
    measures_spin: ClassVar[bool] = False
    """Wheel speeds may be unmeasured, also with `wheel_sensor` until the sensors send pulses."""

    @property
    def arming_hold_s(self) -> float:
        """Time at zero throttle after which the speed controllers arm."""
        return self.motor.arming_hold_s

    @property
    def own_sensors(self) -> tuple[MountedSensor, ...]:
        """The gyro, if any."""
        return () if self.gyro is None else ((GYRO, self.gyro),)

    def kinematics(self) -> SingularityKinematics:
        """Return the kinematics at cruise speed."""
        g = self.drive
        return SingularityKinematics(
            azimuths_rad=np.radians(g.directions_deg),
            pivot_radius_m=g.pivot_radii_m,
            wheel_radius_m=g.wheel_radius_m,
            spin_rad_per_s=g.cruise_speed_rpm * RPM,
            max_tilt_rad=float(np.radians(g.max_tilt_deg)),
            max_tilt_rate_rad_per_s=self.servo.no_load_speed_rpm * RPM,
            spin_ratio=np.array(g.spin_ratio or [1.0] * g.modules),
        )

    def actuator_offsets(self) -> ActuatorOffsets:
        """Return the calibration between joints and actuators."""
        found, modules = self.calibration, self.drive.modules
        offset = np.zeros((modules, 3))
        offset[:, :2] = np.radians(found.tilt_offset_deg or np.zeros((modules, 2)))
        scale = np.ones((modules, 3))
        scale[:, 2] = found.spin_scale or 1.0
        return ActuatorOffsets(offset.ravel(), scale.ravel())

    @property
    def delay_s(self) -> float:
        """Delay of `[errors]`."""
        return self.errors.delay_s

    def with_errors(self, scale: float) -> Self:
        """Return the robot with its `[errors]` multiplied by `scale`; 0 removes them.

        Raises:
            TwinError: If the scale is negative or not finite.
        """
        return msgspec.structs.replace(self, errors=self.errors.scaled(scale))

    def with_delay(self, delay_s: float) -> Self:
        """Return the robot with `delay_s` in its `[errors]`."""
        errors = msgspec.structs.replace(self.errors, delay_s=delay_s)
        return msgspec.structs.replace(self, errors=errors)

    def joint_errors(self) -> JointErrors:
        """Return the errors of gimbal angles and wheel speeds, from `[noise]` and `[errors]`.

        The radius of a printed wheel varies sinusoidally with its tilt, which has the same effect
        as a wheel-speed error. Servos with a dead band stop anywhere between two encoder steps, and
        noisy readings are rounded to either. The battery affects all wheels equally, and so do a
        motor table that was measured elsewhere, and the floor.
        """
        noise, errors = self.noise, self.errors
        step_rad = 2.0 * math.pi / self.servo.steps_per_turn
        layer_share = 0.5 * errors.layer_m / math.sqrt(2.0) / self.drive.wheel_radius_m
        return JointErrors(
            angle_rad=math.radians(noise.gimbal_angle_deg),
            rounding_rad=step_rad / math.sqrt(12.0) if errors.dead_band_deg > 0.0 else 0.0,
            speed_scale_sigma=math.hypot(noise.speed_scale_sigma, layer_share),
            common_spin_share=math.hypot(errors.battery_share, errors.motor_share),
            motor_share=errors.motor_share,
            zero_rad=math.radians(errors.zero_deg),
            floor=self._floor_errors(),
            mount_rad=math.radians(errors.mount_deg),
            place_m=errors.place_m,
            slope_mps2=errors.slope_mps2 / math.sqrt(2.0),
        )

    def _floor_errors(self) -> FloorErrors:
        if self.floor.friction == 0.0:
            return FloorErrors()
        drive = self.drive
        grip_mps2 = _GRIP_FACTOR * self.floor.friction * GRAVITY_MPS2
        return FloorErrors(
            at_rad_per_s=drive.cruise_speed_rpm * RPM,
            speed_scale_sigma=self.spin_friction_share,
            turn_rad_per_s=self.floor_turn_rad_per_s,
            slip_lag_s=self.slip_lag_s * _LAG_SIGMA,
            grip_per_s2=(grip_mps2, grip_mps2, grip_mps2 / drive.rms_radius_m),
            droop_s2_per_m2=self.spin_droop_s2_per_m2,
            restore_up_s=self.motor.time_constant_up_s,
            restore_down_s=self.motor.time_constant_down_s,
            turn_per_spin=self._spin_inertia_kg_m2 / (self.mass.total_kg * drive.rms_radius_m**2),
        )

    @property
    def spin_friction_share(self) -> float:
        """Relative wheel speed lost to floor friction by a robot at rest.

        The motor's stiffness follows from its time constant.
        """
        stiffness_nm_s = self._spin_inertia_kg_m2 / self.motor.time_constant_up_s
        return self._spin_torque_nm / (stiffness_nm_s * self.drive.cruise_speed_rpm * RPM)

    @property
    def spin_droop_s2_per_m2(self) -> float:
        """Relative loss of wheel speed when the robot takes its energy from the wheels."""
        spin_rad_per_s = self.drive.cruise_speed_rpm * RPM
        # Both energies contain 1/2; a relative speed change is half that of the squared speed.
        energy_j = self.drive.modules * self._spin_inertia_kg_m2 * spin_rad_per_s**2
        return 0.5 * self.mass.total_kg / energy_j

    @property
    def floor_turn_rad_per_s(self) -> float:
        """Turn rate of a robot at rest, because the floor brakes all wheels in the same direction.

        Forces along the pivot circle balance these torques. They require wheel slip and deflect the
        gimbals by less than one step; see `docs/physics.md` for the friction.
        """
        drive = self.drive
        force_n = self._spin_torque_nm / drive.rms_radius_m
        spin_rad_per_s = drive.cruise_speed_rpm * RPM
        slip_mps = force_n / self._load_n * GRAVITY_MPS2 * self.slip_lag_s
        lean_rad = force_n * drive.wheel_radius_m / self._gimbal_stiffness_nm
        return (slip_mps + drive.wheel_radius_m * spin_rad_per_s * lean_rad) / drive.rms_radius_m

    @property
    def slip_lag_s(self) -> float:
        """Time constant with which the body follows its wheels, whose force requires slip."""
        floor = self.floor
        if floor.friction == 0.0:
            return 0.0
        rim_mps = floor.patch_radius_m * self.drive.cruise_speed_rpm * RPM
        return _SPIN_IN_SLIP * rim_mps / (floor.friction * GRAVITY_MPS2)

    @property
    def turning_inertia_kg_m2(self) -> float:
        """Moment of inertia about the vertical axis.

        Modelled as a disc with the diameter of the pivot circle, with the modules on its rim. Its
        radius is the root mean square if pivot distances differ.
        """
        module_kg = self.mass.wheel_kg + 2.0 * self.mass.gimbal_kg
        mass_kg = self.mass.total_kg + self.drive.modules * module_kg
        return 0.5 * mass_kg * self.drive.rms_radius_m**2

    def joint_compliance(self) -> JointCompliance:
        """Return the deflection of gimbals under floor forces, and their lag behind setpoints."""
        kinematics, errors = self.kinematics(), self.errors
        mass_kg = self.mass.total_kg
        inertia = np.diag([mass_kg, mass_kg, self.turning_inertia_kg_m2])
        # A force at the lowest point of a wheel rotates the gimbal about the perpendicular
        # horizontal axis; alpha rotates about -X of its module.
        lean = -self.drive.wheel_radius_m / self._gimbal_stiffness_nm
        one_module = np.array([[0.0, lean], [lean, 0.0], [0.0, 0.0]])
        by_force = np.asarray(np.kron(np.eye(kinematics.modules), one_module), dtype=float)
        return JointCompliance(
            by_acceleration=by_force @ kinematics.twist_from_contacts.T @ inertia,
            by_force=by_force,
            friction_n=self.floor.friction * self._load_n,
            spin_to_slip_m=_SPIN_IN_SLIP * self.floor.patch_radius_m,
            lag_s=1.0 / self.servo.approach_rate_per_s,
            backlash_rad=math.radians(errors.backlash_deg),
            dead_band_rad=math.radians(errors.dead_band_deg),
        )

    @property
    def _gimbal_stiffness_nm(self) -> float:
        """Stiffness of a gimbal servo, N m/rad: near its goal it acts as a spring."""
        servo = self.servo
        rate_per_s = servo.approach_rate_per_s / (servo.no_load_speed_rpm * RPM)
        return servo.stall_torque_nm * rate_per_s

    @property
    def _spin_inertia_kg_m2(self) -> float:
        """Moment of inertia of a wheel about its axle: half a hollow sphere."""
        return self.mass.wheel_kg * self.drive.wheel_radius_m**2 * 2.0 / 3.0

    @property
    def _load_n(self) -> float:
        """Weight on a wheel."""
        return self.mass.total_kg * GRAVITY_MPS2 / self.drive.modules

    @property
    def _spin_torque_nm(self) -> float:
        """Friction torque of a purely spinning contact patch under Hertzian pressure."""
        floor = self.floor
        return floor.friction * self._load_n * _MEAN_LEVER * floor.patch_radius_m

    def spin_up(self) -> WheelSpeedResponse:
        """Return the model of the drive motors' acceleration and run-down."""
        m = self.motor
        return WheelSpeedResponse(
            m.start_speed_rpm * RPM, m.time_constant_up_s, m.time_constant_down_s
        )

    @property
    def wheel_speed_range(self) -> WheelSpeedRange:
        """Range of wheel speeds that all motors can reach."""
        drive = self.kinematics()
        # The motor setpoint is the wheel speed divided by the wheel's scale.
        per_setpoint = self.actuator_offsets().scale[2::3] / drive.spin_ratio
        fastest_rpm = np.array([column[-1] for column in self.motor.speed_rpm])
        most_rpm = float((fastest_rpm * per_setpoint).min())
        if self.drive.max_speed_rpm is not None:
            most_rpm = min(most_rpm, self.drive.max_speed_rpm)
        return WheelSpeedRange(
            kinematics=drive,
            least_rad_per_s=self.motor.start_speed_rpm * float(per_setpoint.max()) * RPM,
            most_rad_per_s=most_rpm * RPM,
            servo_step_rad=2.0 * math.pi / self.servo.steps_per_turn,
        )

    @property
    def lag_s(self) -> float:
        """Time constant of the servos, because wheel speeds are constant."""
        return 1.0 / self.servo.approach_rate_per_s

    def problems(self) -> Iterator[Problem]:
        """Yield coincident pivots, and defects that make the motor table not invertible."""
        yield from self._layout_problems()
        for key, values in (
            ("drive.spin_ratio", self.drive.spin_ratio),
            ("calibration.tilt_offset_deg", self.calibration.tilt_offset_deg),
            ("calibration.spin_scale", self.calibration.spin_scale),
        ):
            if len(values) not in (0, self.drive.modules):
                yield (
                    f"{key} has {len(values)} entries for {self.drive.modules} modules",
                    f"one for each of {self.drive.modules_key}, or none",
                )
        yield from proportion_problems(
            ("drive.wheel_radius_m", self.drive.wheel_radius_m),
            (self.drive.radius_key, float(np.max(self.drive.pivot_radii_m))),
            self.mass.total_kg,
        )
        yield from self._calibration_problems()
        yield from self._motor_problems()
        yield from self._wheel_sensor_problems()

    def _layout_problems(self) -> Iterator[Problem]:
        drive = self.drive
        azimuths = [azimuth % 360.0 for azimuth in drive.directions_deg]
        if not drive.positions and len(set(azimuths)) < len(azimuths):
            yield (
                "drive.azimuths_deg has the same direction twice",
                "one direction for each pivot",
            )
        for i, j in itertools.combinations(range(drive.modules), 2):
            apart_m = float(np.hypot(*(drive.pivots_m[i] - drive.pivots_m[j])))
            if drive.positions and apart_m < 2.0 * drive.wheel_radius_m:
                yield (
                    f"drive.modules[{i}] and [{j}] are {apart_m:g} m apart",
                    f"at least two wheel radii, {2.0 * drive.wheel_radius_m:g} m",
                )

    def _calibration_problems(self) -> Iterator[Problem]:
        limit = min(self.drive.max_tilt_deg, _MAX_OFFSET_DEG)
        for i, pair in enumerate(self.calibration.tilt_offset_deg):
            if max(abs(angle) for angle in pair) >= limit:
                yield (
                    f"calibration.tilt_offset_deg[{i}] is {list(pair)}",
                    f"less than {limit:g} either way: put the servo in anew, then zero it",
                )

    def _motor_problems(self) -> Iterator[Problem]:
        motor, modules = self.motor, self.drive.modules
        if any(b <= a for a, b in itertools.pairwise(motor.signal)):
            yield "motor.signal must rise from row to row", ""
        if len(motor.speed_rpm) != modules:
            yield (
                f"motor.speed_rpm has {len(motor.speed_rpm)} lists, the drive has {modules} wheels",
                f"one list for each of {self.drive.modules_key}",
            )
        for i, column in enumerate(motor.speed_rpm):
            yield from self._curve_problems(i, column)
        most_rpm, cruise_rpm = self.drive.max_speed_rpm, self.drive.cruise_speed_rpm
        if most_rpm is not None and most_rpm < cruise_rpm:
            yield (
                f"drive.max_speed_rpm is {most_rpm:g}",
                f"drive.cruise_speed_rpm, {cruise_rpm:g}, or more",
            )

    def _wheel_sensor_problems(self) -> Iterator[Problem]:
        if self.wheel_sensor is None or self.wheel_sensor.kind != "hall":
            return
        rpm = max(speed for column in self.motor.speed_rpm for speed in column)
        if self.drive.max_speed_rpm is not None:
            rpm = min(rpm, self.drive.max_speed_rpm * max(self.drive.spin_ratio, default=1.0))
        per_turn = self.wheel_sensor.per_turn
        if per_turn * rpm / 60.0 > MAX_PULSES_PER_S:
            yield (
                f"wheel_sensor.pulses_per_turn is {per_turn}, {per_turn * rpm / 60.0:.0f} pulses "
                f"per second at {rpm:.0f} rpm",
                f"at most {MAX_PULSES_PER_S:.0f} per second: fewer magnets, or a lower "
                "drive.max_speed_rpm",
            )

    def _curve_problems(self, i: int, column: list[float]) -> Iterator[Problem]:
        motor, rows = self.motor, len(self.motor.signal)
        if len(column) != rows:
            yield (
                f"motor.speed_rpm[{i}] has {len(column)} speeds for {rows} signals",
                "one speed for each of motor.signal",
            )
        if any(b < a for a, b in itertools.pairwise(column)):
            yield f"motor.speed_rpm[{i}] must not fall as the signal rises", ""
        if column and column[0] > 0.0:
            yield (
                f"motor.speed_rpm[{i}] starts at {column[0]:g}",
                "0: the lowest signal is zero throttle",
            )
        ratio = [*self.drive.spin_ratio[i : i + 1], 1.0][0]
        scale = [*self.calibration.spin_scale[i : i + 1], 1.0][0]
        requested_rpm = self.drive.cruise_speed_rpm * ratio / scale
        if column and not motor.start_speed_rpm <= requested_rpm <= column[-1]:
            times = f" times drive.spin_ratio[{i}] = {ratio:g}" if ratio != 1.0 else ""
            times += f" over calibration.spin_scale[{i}] = {scale:g}" if scale != 1.0 else ""
            yield (
                f"drive.cruise_speed_rpm is {self.drive.cruise_speed_rpm:g}{times}, "
                f"motor {i + 1} turns from {motor.start_speed_rpm:g} to {column[-1]:g}",
                "between motor.start_speed_rpm and the last speed of every motor",
            )
