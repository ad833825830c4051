"""Shadow twin: fault tests of a robot, from its setpoints, joints and estimated pose.

Measured wheel speeds are compared with their setpoints, the motion with the joints, and gimbal
angles with a simulated robot that follows the same setpoints.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tsd_twin.estimation.joint_errors import acceleration
from tsd_twin.kinematics import JointKind
from tsd_twin.lie import SE2, SO3, Array, wrap
from tsd_twin.messages.cdr import JointState, Odometry
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.status import RobotStatus
from tsd_twin.messages.topics import JOINTS, ODOM, SETPOINT
from tsd_twin.robots import RPM, RobotDescription
from tsd_twin.shadow.fault_detectors import (
    SLOW_SERVO,
    BatteryTest,
    Drift,
    JointComparison,
    PoseComparison,
    ServoTest,
    ShadowReport,
)
from tsd_twin.shadow.fault_filter import FaultFilter, Verdict
from tsd_twin.shadow.motion_test import MotionTest
from tsd_twin.shadow.speed_test import SpeedTest
from tsd_twin.simulation import simulate
from tsd_twin.simulation.base import Simulation

WINDOW_S = 1.0
"""Sliding window for comparing poses; estimates would drift over longer windows."""

_GAP_S = 0.25
"""Maximum time between two states; after a longer gap the comparison restarts."""
_WARM_UP_S = 1.0
"""Time after which the initial state of the simulated robots no longer matters."""
_STEP_S = 0.01
"""Step of the simulation of geared motors: four times its default, and still accurate enough."""
_EARLIER_WEIGHT = 0.75
"""Weight of the earlier setpoint, because setpoints change every 0.01 s and are received every 0.02
s."""
_JUMP = 0.05
"""Maximum difference (metres or radians) between pose change and twist; larger ones are pose
jumps."""
_SENSED_S = 2.0
"""Time after which an estimate follows a pose sensor."""
_TILT_LAG_S = 0.08
"""Time constant of servo deflection under acceleration: the real robot slides first, and a servo
deflects like a spring with a damper."""
_SPEED_BAND, _TOP_BAND = 0.02, 0.01
"""Tolerance of a measured wheel speed, relative to it and to the highest speed."""


class ShadowTwin:
    """Shadow twin of a robot: receives its messages and reports differences.

    It uses no clock and no I/O; the stamps provide the time.
    """

    def __init__(self, robot: RobotDescription) -> None:
        self._robot = robot
        kinematics = robot.kinematics()
        self._kinematics = kinematics
        self._joints = [joint.name for joint in kinematics.joints]
        is_angle = np.array([joint.kind is JointKind.POSITION for joint in kinematics.joints])
        self._is_angle = is_angle
        self._angles, self._wheels = np.flatnonzero(is_angle), np.flatnonzero(~is_angle)
        self._planar = kinematics.pose_type is SE2
        self._shares = np.ones((2, len(self._joints)))
        self._shares[1, self._angles] = 1.0 - SLOW_SERVO
        self._servo_test = ServoTest(robot, [self._joints[i] for i in self._angles])
        self._battery_test = BatteryTest(robot.battery.nominal_v)
        self._has_gyro = any(joint.name == "gyro" for joint in robot.sensors)
        self._motion_test = MotionTest(robot, has_gyro=self._has_gyro)
        self._speed_test = SpeedTest(robot) if robot.measures_spin else None
        self._gives = robot.joint_compliance()
        self._tilt_errors = np.zeros(len(self._angles))
        self._twist = np.zeros(3)
        self._bank: Simulation | None = None
        """Healthy robot, and one with slow servos; only for robots with gimbals."""
        self._last_ns: int | None = None
        self._measured = np.full(len(self._joints), np.nan)
        self._setpoint = self._rates = self._nominal = np.zeros(len(self._joints))
        self._compared_s = 0.0
        self._sensed_s = 0.0
        self._since_sample_s = 0.0
        self._newest: tuple[Any, Array] | None = None

    def advance(
        self,
        stamp_ns: int,
        joints: JointState,
        setpoint: JointState,
        odom: Odometry | None,
        status: RobotStatus | None,
    ) -> None:
        """Process the messages of a robot period, unless older than the last.

        `stamp_ns` is the time of the period, preferably on the robot's monotonic clock.
        """
        measured, wanted = self._vector(joints), self._vector(setpoint)
        if measured is None or wanted is None or not np.isfinite(wanted).all():
            return
        dt_s = math.inf if self._last_ns is None else 1e-9 * (stamp_ns - self._last_ns)
        if -_GAP_S < dt_s <= 0.0:
            return
        self._last_ns = stamp_ns
        contiguous = 0.0 < dt_s <= _GAP_S
        if status is not None:
            self._process_status(status, dt_s if contiguous else 0.0)
        if contiguous:
            self._step(measured, wanted, dt_s)
        else:
            self._restart(measured, wanted)
        if odom is not None:
            self._process_pose(odom, dt_s if contiguous else 0.0)

    def report(self) -> ShadowReport:
        """Return the current comparison."""
        if self._last_ns is None:
            return ShadowReport(0.0)
        return ShadowReport(
            round(self._compared_s, 2),
            self._compare_joints(),
            self._compare_pose(),
            tuple(self.drifts()),
            self._note,
        )

    @property
    def fault_filters(self) -> tuple[FaultFilter | None, FaultFilter]:
        """Filters that name faulty parts: by wheel speeds, if they are measured, and by motion."""
        speeds = None if self._speed_test is None else self._speed_test.filter
        return speeds, self._motion_test.filter

    def drifts(self) -> list[Drift]:
        """Return the parts that differ."""
        return [*self._battery_test.drifts(), *self._servo_test.drifts(), *self._wheel_drifts()]

    def _wheel_drifts(self) -> list[Drift]:
        """Return the differences of speeds, or else of the motion."""
        wheels = [self._joints[i] for i in self._wheels]
        by_speed, by_motion = self.fault_filters
        speeds, motion = by_speed.verdict if by_speed else None, by_motion.verdict
        if speeds is not None and speeds.alike and (motion is None or motion.alike):
            codes = Code.WHEEL_SLOWER, Code.WHEELS_SLOWER, Code.UNKNOWN_WHEEL
            return _drifts(speeds, wheels, len(wheels), *codes)
        if motion is None:
            return []
        names = [*wheels, *(self._joints[i] for i in self._angles)]
        codes = Code.WHEEL_WORN, Code.WHEELS_WORN, Code.UNKNOWN_PART
        if self._speed_test is None:
            codes = Code.WHEEL_WEAKER, Code.WHEELS_WEAKER, Code.UNKNOWN_PART
        return _drifts(motion, names, len(wheels), *codes)

    @property
    def _note(self) -> Reason | None:
        if self._robot.measures_spin or self._has_gyro or self._sensed_s >= _SENSED_S:
            return None
        return because(Code.SPEEDS_UNMEASURED)

    def _vector(self, state: JointState) -> Array | None:
        """Return angles and speeds (n,) in kinematics order, or None if one is missing."""
        place = {name: i for i, name in enumerate(state.names)}
        if not all(name in place for name in self._joints):
            return None
        rows = [place[name] for name in self._joints]
        return np.where(self._is_angle, state.position_rad[rows], state.velocity_rad_per_s[rows])

    def _process_status(self, status: RobotStatus, dt_s: float) -> None:
        sensor = status.pose_sensor
        self._sensed_s = self._sensed_s + dt_s if sensor is not None and sensor.hz > 0.0 else 0.0
        volts = status.hardware.get("battery_v")
        if not isinstance(volts, float | int) or not 0.0 < volts < 1000.0:
            return
        self._since_sample_s += dt_s
        if self._since_sample_s < 1.0 / 20.0:
            return
        self._since_sample_s = 0.0
        before = self._battery_test.share
        self._battery_test.add(float(volts))
        if self._bank is not None and abs(self._battery_test.share - before) > 1e-3:
            self._bank.set_battery(float(volts))

    def _restart(self, measured: Array, wanted: Array) -> None:
        """Restart at the real robot's state."""
        self._setpoint, self._measured = wanted, measured
        self._nominal = np.where(np.isfinite(measured), measured, wanted)
        self._rates = np.zeros(len(wanted))
        if len(self._angles):
            bank = simulate(self._robot, (len(self._shares),), step_s=_STEP_S)
            # Speed controllers ignore commands until they are armed.
            bank.command(np.zeros(len(self._joints)))
            bank.advance(self._robot.arming_hold_s + 1.0)
            bank.joints[...] = self._nominal
            bank.set_battery(self._battery_test.share * self._robot.battery.nominal_v)
            bank.degrade(self._shares)
            self._bank = bank
        self._servo_test.restart(self._nominal[self._angles])
        self._tilt_errors = np.zeros(len(self._angles))
        self._twist = self._kinematics.forward(self._nominal).twist
        self._compared_s = 0.0
        self._motion_test.restart()
        if self._speed_test is not None:
            self._speed_test.restart()
        self._newest = None

    def _step(self, measured: Array, wanted: Array, dt_s: float) -> None:
        meant = _EARLIER_WEIGHT * self._setpoint + (1.0 - _EARLIER_WEIGHT) * wanted
        before, was = self._nominal, self._measured
        if self._bank is not None:
            self._bank.command(meant)
            self._bank.advance(dt_s)
            self._nominal = self._bank.joints[0].copy()
        else:
            # A first-order lag; the speed test learns the rest.
            share = 1.0 - math.exp(-dt_s / self._robot.lag_s)
            self._nominal = before + share * (meant - before)
        self._setpoint, self._measured = wanted, measured
        self._rates = (self._nominal - before) / dt_s
        self._compared_s += dt_s
        warm = self._compared_s > _WARM_UP_S
        # Expected motion: by measured joints, and by the model where they are not measured.
        known = np.isfinite(measured) & np.isfinite(was)
        middle = np.where(known, 0.5 * (measured + was), self._nominal)
        self._motion_test.roll(middle, self._rates, dt_s)
        if self._speed_test is not None:
            self._speed_test.add(
                measured[self._wheels], self._nominal[self._wheels], dt_s, warm=warm
            )
        if self._bank is not None:
            self._servo_test.add(
                measured[self._angles],
                self._nominal[self._angles],
                self._bank.joints[1, self._angles],
                self._tilt_error(dt_s),
                dt_s,
                warm=warm,
            )

    def _tilt_error(self, dt_s: float) -> Array:
        """Return the deflection (m,) of the servos under the healthy robot's acceleration."""
        twist, before = self._kinematics.forward(self._nominal).twist, self._twist
        self._twist = twist
        if self._gives is None:
            return self._tilt_errors
        deflection: Array = self._gives.by_acceleration @ acceleration(before, twist, dt_s)
        self._tilt_errors += (1.0 - math.exp(-dt_s / _TILT_LAG_S)) * (
            deflection[self._angles] - self._tilt_errors
        )
        return self._tilt_errors.copy()

    def _process_pose(self, odom: Odometry, dt_s: float) -> None:
        """Record the measured pose and test the motion."""
        pose: Any = SE2(odom.xy_heading) if self._planar else SO3(np.asarray(odom.wxyz))
        if self._newest is not None:
            before, twist = self._newest
            if self._planar:  # Unwrap the heading, which is wrapped on the bus.
                was = before.xy_heading[2]
                here = was + wrap(odom.xy_heading[2] - was)
                pose = SE2(np.array([*odom.xy_heading[:2], here]))
            moved: Array = (before.inverse() @ pose).log()
            if np.abs(moved - dt_s * twist).max() > _JUMP:
                self._motion_test.restart()  # The pose was set or relocalized.
        self._newest = (pose, odom.twist)
        now_s = self._compared_s
        joints = np.where(np.isfinite(self._measured), self._measured, self._nominal)
        self._motion_test.record(now_s, pose, joints, WINDOW_S)
        if now_s > _WARM_UP_S + WINDOW_S:
            sensed = self._sensed_s >= _SENSED_S + WINDOW_S
            self._motion_test.step(now_s, sensed=sensed and self._planar)

    def _compare_joints(self) -> tuple[JointComparison, ...]:
        bands, scale = np.zeros(len(self._joints)), np.full(len(self._joints), 1.0 / RPM)
        if len(self._angles):
            bands[self._angles] = self._servo_test.bands(self._rates[self._angles])
            scale[self._angles] = 180.0 / math.pi
        speeds = np.abs(self._nominal[self._wheels])
        errors = self._robot.joint_errors()
        share = _SPEED_BAND + 3.0 * math.hypot(errors.speed_scale_sigma, errors.common_mode_sigma)
        limit = np.array([self._robot.limits.speed_mps / self._kinematics.twist_scale_m, 0.0, 0.0])
        top = np.abs(self._kinematics.inverse(limit)[self._wheels]).max()
        lag = self._robot.spin_up().up_s * np.abs(self._rates[self._wheels])
        bands[self._wheels] = share * speeds + _TOP_BAND * top + 2.0 * lag
        rows: list[JointComparison] = []
        for i, name in enumerate(self._joints):
            is_measured = self._is_angle[i] or self._robot.measures_spin
            measured = float(self._measured[i]) if is_measured else math.nan
            known = math.isfinite(measured)
            rows.append(
                JointComparison(
                    name,
                    "°" if self._is_angle[i] else "rpm",
                    round(measured * float(scale[i]), 3) if known else None,
                    round(float(self._nominal[i] * scale[i]), 3),
                    round(float(bands[i] * scale[i]), 3),
                    not known or bool(abs(measured - self._nominal[i]) <= bands[i]),
                )
            )
        return tuple(rows)

    def _compare_pose(self) -> PoseComparison | None:
        motion = self._motion_test.compare(WINDOW_S)
        if motion is None or self._compared_s < _WARM_UP_S + WINDOW_S:
            return None
        error = motion.error
        band = self._motion_test.band(motion, posed=self._planar and self._sensed_s > 0.0)
        scale = np.array([1e3, 1e3, 180.0 / math.pi] if self._planar else [180.0 / math.pi] * 3)
        return PoseComparison(
            ("ahead", "left", "heading") if self._planar else ("about X", "about Y", "about Z"),
            ("mm", "mm", "°") if self._planar else ("°", "°", "°"),
            _triple(scale * error),
            _triple(scale * band),
            bool((np.abs(error) <= band).all()),
        )


def _drifts(
    verdict: Verdict, names: list[str], wheels: int, one: Code, every: Code, unknown: Code
) -> list[Drift]:
    """Return the differences that a verdict names; the first names are wheels."""
    since: dict[str, str | float] = {"since": "start"} if verdict.begun == 0 else {}
    if len(verdict.alike) != 1:
        parts = {names[i]: None for each in verdict.alike for i in each.columns}
        known: dict[str, str | float] = {"parts": ", ".join(parts)} if parts else {}
        return [Drift("", because(unknown, **known))]
    (found,) = verdict.alike
    if found.together:
        percent = 100.0 * float(verdict.sizes[0])
        return [Drift("wheels", because(every, percent=percent, **since))]
    drifts: list[Drift] = []
    for i, size in zip(found.columns, verdict.sizes.tolist(), strict=True):
        name = names[i]
        if i < wheels:
            why = because(one, wheel=name, percent=100.0 * size, **since)
        else:
            why = because(Code.GIMBAL_ASIDE, joint=name, deg=math.degrees(size), **since)
        drifts.append(Drift(name, why))
    return drifts


def _triple(values: Array) -> tuple[float, float, float]:
    a, b, c = (round(float(value), 3) for value in values)
    return a, b, c


_BUFFERED_PERIODS = 8
"""Incomplete periods to buffer; the limit is twice as many, because extra setpoints count too."""


class ShadowFeed:
    """Collects the messages of each period and passes them to a twin.

    Setpoints between two periods of the other streams, and incomplete periods, are dropped.
    """

    def __init__(self, twin: ShadowTwin) -> None:
        self.twin = twin
        self.status: RobotStatus | None = None
        """Latest status."""
        self._incomplete: dict[int, dict[str, Any]] = {}

    def add(self, stream: str, message: Any, robot_ns: int) -> None:
        """Add a `JointState` of `joints` or `setpoint`, or an `Odometry` of `odom`.

        `robot_ns` is the robot's monotonic clock at sending, which is equal within a period.
        """
        parts = self._incomplete.setdefault(robot_ns, {})
        parts[stream] = message
        if len(parts) == len(STREAMS):
            for each in [each for each in self._incomplete if each <= robot_ns]:
                del self._incomplete[each]
            self.twin.advance(
                robot_ns, parts["joints"], parts["setpoint"], parts["odom"], self.status
            )
        elif len(self._incomplete) > 2 * _BUFFERED_PERIODS:
            del self._incomplete[min(self._incomplete)]


STREAMS = {"joints": JOINTS, "setpoint": SETPOINT, "odom": ODOM}
"""Topics that a twin needs, in addition to the status."""
