"""Shadow twin: simulated robots driven by a real robot's setpoints, and fault detection.

A bank of simulated robots follows the same setpoints: one as described, and the others with one
fault each. If the real robot deviates from the first like one of the others does, a sequential test
(CUSUM of log-likelihood ratios, Page 1954) accumulates evidence for that fault.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsd_twin.estimation.joint_errors import acceleration
from tsd_twin.kinematics import JointKind
from tsd_twin.lie import SE2, SO3, Array, wrap
from tsd_twin.messages.cdr import JointState, Odometry
from tsd_twin.messages.status import RobotStatus
from tsd_twin.messages.topics import JOINTS, ODOM, SETPOINT
from tsd_twin.robots import RPM, RobotDescription
from tsd_twin.shadow.fault_detectors import (
    SLOW_SERVO,
    SLOW_WHEEL,
    BatteryTest,
    JointComparison,
    PoseComparison,
    ServoTest,
    ShadowReport,
    WheelTest,
)
from tsd_twin.simulation import simulate
from tsd_twin.simulation.base import Simulation

WINDOW_S = 1.0
"""Sliding window for comparing poses; estimates would drift over longer windows."""

_GAP_S = 0.25
"""Maximum time between two states; after a longer gap the simulated robots restart."""
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
_FUSED_SIGMA = 0.45
"""Standard deviation of a fused pose relative to the sensor."""
_LAG_SHARE = 0.25
"""Relative model error of the motion's lag."""
_TILT_LAG_S = 0.08
"""Time constant of servo deflection under acceleration: the real robot slides first, and a servo
deflects like a spring with a damper."""
_BLOCK_S = 0.5
"""Length of the motion blocks tested for slow wheels."""
_INDEPENDENT = 0.3
"""Fraction of new information in each sample of wheel speeds."""
_LAG_NOISE = 0.25
"""Standard deviation of the lag that is independent in each block, relative to the lag."""
_MAX_CHANGE = np.array([0.7, 0.7, 1.5])
"""Change of the twist in a block (m/s, rad/s) above which the block is ignored, because wheels
slide and no model is accurate enough."""
_DROOP_OWN = 0.5
"""Fraction of the energy for a speed change that a single wheel may supply."""
_UNMODELLED = np.array([1e-3, 1e-3, 2.5e-3])
"""Unmodelled error in x, y and heading (1σ)."""
_GYRO_BIAS_RAD_PER_S = 0.0005
"""Standard deviation of a gyro's bias, as in `[gyro]`."""
_RATE_HZ = 10.0
"""Rate at which poses are recorded and wheel speeds are tested."""


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
        slow = np.ones((1 + (len(self._angles) > 0) + len(self._wheels), len(self._joints)))
        self._slow_servos = 1 if len(self._angles) else 0
        slow[self._slow_servos, self._angles] = 1.0 - SLOW_SERVO
        first = self._slow_servos + 1
        slow[range(first, len(slow)), self._wheels] = 1.0 - SLOW_WHEEL
        self._shares, self._slow_wheels = slow, slice(first, None)
        names = [self._joints[i] for i in self._wheels]
        self._servo_test = ServoTest(robot, [self._joints[i] for i in self._angles])
        self._battery_test = BatteryTest(robot.battery.nominal_v)
        self._has_gyro = any(joint.name == "gyro" for joint in robot.sensors)
        errors, self._gives = robot.joint_errors(), robot.joint_compliance()
        self._tilt_errors = np.zeros(len(self._angles))
        self._twist = np.zeros(3)
        self._dead_band_rad = 0.0 if self._gives is None else self._gives.dead_band_rad
        self._lag_s = max(errors.floor.slip_lag_s, _LAG_SHARE * robot.lag_s)
        # For the motion: a turn rate, the lag, the angle of each gimbal, poses at start and end.
        sensor = robot.pose_sensor
        pose_sigma = [sensor.sigma_m, sensor.sigma_m, math.radians(sensor.sigma_deg)]
        angle_rad = math.hypot(errors.zero_rad, self._dead_band_rad / math.sqrt(3.0))
        turn_rad_per_s = math.hypot(errors.floor.turn_rad_per_s, _GYRO_BIAS_RAD_PER_S)
        self._nuisances = np.array(
            [turn_rad_per_s, self._lag_s, *len(self._angles) * [angle_rad]]
            + 2 * [_FUSED_SIGMA * sigma for sigma in pose_sigma]
        )
        self._wheel_test = WheelTest(robot, names, None if robot.measures_spin else self._nuisances)
        self._ends_swapped = False
        self._droop_s2_per_m2 = robot.spin_droop_s2_per_m2
        self._bank: Simulation | None = None
        self._last_ns = 0
        self._measured = np.zeros(len(self._joints))
        self._setpoint = self._rates = self._nominal = self._measured
        self._compared_s = 0.0
        self._sensed_s = 0.0
        self._poses: deque[tuple[float, Any, Any, Any, Array, Array]] = deque()
        self._rolled: Any = kinematics.pose_type.identity()
        self._since_block_s = 0.0
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
        dt_s = 1e-9 * (stamp_ns - self._last_ns)
        if self._bank is not None and -_GAP_S < dt_s <= 0.0:
            return
        self._last_ns = stamp_ns
        contiguous = self._bank is not None and 0.0 < dt_s <= _GAP_S
        if status is not None:
            self._process_status(status, dt_s if contiguous else 0.0)
        if contiguous:
            self._step(measured, wanted, dt_s)
        else:
            self._restart(measured, wanted)
        if odom is not None and self._bank is not None:
            self._process_pose(self._bank, odom, dt_s if contiguous else 0.0)

    def report(self) -> ShadowReport:
        """Return the current comparison."""
        if self._bank is None:
            return ShadowReport(0.0)
        drifts = (
            *self._battery_test.drifts(),
            *self._servo_test.drifts(),
            *self._wheel_test.drifts(),
        )
        return ShadowReport(
            round(self._compared_s, 2),
            self._compare_joints(),
            self._compare_pose(),
            drifts,
            self._note,
        )

    @property
    def _note(self) -> str:
        if self._robot.measures_spin or self._has_gyro or self._sensed_s >= _SENSED_S:
            return ""
        return (
            "Wheel speeds are not measured: a slow wheel shows only with a pose sensor or a gyro."
        )

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
        """Restart the simulated robots at the real robot's state."""
        bank = simulate(self._robot, (len(self._shares),), step_s=_STEP_S)
        # Speed controllers ignore commands until they are armed.
        bank.command(np.zeros(len(self._joints)))
        bank.advance(self._robot.arming_hold_s + 1.0)
        bank.joints[...] = np.where(np.isfinite(measured), measured, wanted)
        bank.set_battery(self._battery_test.share * self._robot.battery.nominal_v)
        bank.degrade(self._shares)
        self._bank, self._setpoint, self._measured = bank, wanted, measured
        self._nominal, self._rates = bank.joints[0].copy(), np.zeros(len(wanted))
        self._servo_test.restart(self._nominal[self._angles])
        self._tilt_errors = np.zeros(len(self._angles))
        self._twist = self._kinematics.forward(self._nominal).twist
        self._compared_s = self._since_block_s = 0.0
        self._rolled = self._kinematics.pose_type.identity()
        self._poses.clear()
        self._newest = None

    def _step(self, measured: Array, wanted: Array, dt_s: float) -> None:
        bank = self._bank
        assert bank is not None  # noqa: S101  Checked by the caller.
        bank.command(_EARLIER_WEIGHT * self._setpoint + (1.0 - _EARLIER_WEIGHT) * wanted)
        bank.advance(dt_s)
        self._setpoint, self._measured = wanted, measured
        simulated = bank.joints
        self._rates = (simulated[0] - self._nominal) / dt_s
        self._nominal = simulated[0].copy()
        self._compared_s += dt_s
        if len(self._angles):
            # Use the measured gimbal angles, which include compliance; the remaining motion is due
            # to wheels.
            rolling = np.where(self._is_angle & np.isfinite(measured), measured, simulated[0])
            twist = self._kinematics.forward(rolling, self._rates).twist
            self._rolled = self._kinematics.integrate(self._rolled, twist, dt_s)
            self._servo_test.add(
                measured[self._angles],
                simulated[0, self._angles],
                simulated[self._slow_servos, self._angles],
                self._tilt_error(dt_s),
                dt_s,
                warm=self._compared_s > _WARM_UP_S,
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

    def _speed_noise(self) -> Array:
        """Return the standard deviation (k,) of measured wheel speeds, without biases."""
        speeds, rates = self._nominal[self._wheels], self._rates[self._wheels]
        # Maximum wheel speed at the speed limit.
        limit = np.array([self._robot.limits.speed_mps / self._kinematics.twist_scale_m, 0.0, 0.0])
        top = np.abs(self._kinematics.inverse(limit)[self._wheels]).max()
        lag_rad_per_s = _LAG_SHARE * self._robot.spin_up().up_s * np.abs(rates)
        return np.sqrt((0.005 * speeds) ** 2 + (0.003 * top) ** 2 + lag_rad_per_s**2)

    def _test_wheel_speeds(self, bank: Simulation, dt_s: float) -> None:
        """Compare the measured wheel speeds."""
        speeds = bank.joints[:, self._wheels]
        measured = self._measured[self._wheels]
        if np.isfinite(measured).all():
            per_loss = (speeds[self._slow_wheels] - speeds[0]).T / SLOW_WHEEL
            noise = np.diag(self._speed_noise() ** 2)
            self._wheel_test.keep(np.zeros(0), dt_s)
            self._wheel_test.add(measured - speeds[0], per_loss, noise / _INDEPENDENT)

    def _process_pose(self, bank: Simulation, odom: Odometry, dt_s: float) -> None:
        """Record the measured pose and the simulated poses, and test the wheels."""
        pose: Any = SE2(odom.xy_heading) if self._planar else SO3(np.asarray(odom.wxyz))
        if self._newest is not None:
            before, twist = self._newest
            if self._planar:  # Unwrap the heading, which is wrapped on the bus.
                was = before.xy_heading[2]
                here = was + wrap(odom.xy_heading[2] - was)
                pose = SE2(np.array([*odom.xy_heading[:2], here]))
            moved: Array = (before.inverse() @ pose).log()
            if np.abs(moved - dt_s * twist).max() > _JUMP:
                self._poses.clear()  # The pose was set or relocalized.
                self._since_block_s = 0.0
        self._newest = (pose, odom.twist)
        self._since_block_s += dt_s
        now_s = self._compared_s
        if self._poses and now_s - self._poses[-1][0] < 1.0 / _RATE_HZ - 1e-6:
            return
        rolled = self._rolled if len(self._angles) else bank.pose
        twist = self._kinematics.forward(self._nominal).twist
        self._poses.append((now_s, pose, rolled, bank.pose, self._nominal, twist))
        while len(self._poses) > 1 and self._poses[1][0] <= now_s - WINDOW_S + 1e-6:
            self._poses.popleft()
        if now_s <= _WARM_UP_S:
            return
        if self._robot.measures_spin:
            self._test_wheel_speeds(bank, 1.0 / _RATE_HZ)
        elif self._since_block_s >= _BLOCK_S - 1e-6 and now_s > _WARM_UP_S + WINDOW_S:
            self._test_motion()

    def _motion(self, seconds: float) -> _Motion | None:
        """Compare the motion in the last `seconds`, or return None without enough data."""
        end_s = self._poses[-1][0] if self._poses else 0.0
        poses = [each for each in self._poses if each[0] >= end_s - seconds - 1e-6]
        if len(poses) < 2 or end_s - poses[0][0] < 0.9 * seconds:
            return None
        _, was, rolled_was, sim_was, *_ = poses[0]
        _, pose, rolled, sim_pose, joints, _ = poses[-1]
        took_s = end_s - poses[0][0]
        measured = (was.inverse() @ pose).log()
        simulated = (sim_was.inverse() @ sim_pose).log()
        per_loss = (simulated[self._slow_wheels] - simulated[0]).T / SLOW_WHEEL
        forward, twists = self._kinematics.forward, np.array([each[-1] for each in poses])
        change = np.abs(np.diff(twists, axis=0)).sum(axis=0)
        sigma = 0.005 * np.abs(simulated[0]).max() + _LAG_NOISE * self._lag_s * change
        # An accelerating robot takes energy out of its wheels, possibly more from some of them.
        changed_m2_per_s2 = np.abs(np.diff(np.square(twists[:, :2]).sum(axis=1))).sum()
        droop = self._droop_s2_per_m2 * changed_m2_per_s2 * per_loss
        together = droop.sum(axis=1)
        own = _DROOP_OWN * droop
        noise = np.diag(sigma**2 + _UNMODELLED**2) + own @ own.T + np.outer(together, together)
        turn = np.array([[0.0], [0.0], [took_s]])
        lag = (twists[0] - twists[-1])[:, None]
        by_angle, turned = np.zeros((3, 0)), np.zeros(0)
        if len(self._angles):
            nudge = 1e-4
            nudged = joints + nudge * np.eye(len(joints))[self._angles]
            by_angle = took_s * (forward(nudged).twist - forward(joints).twist).T / nudge
            angles = np.array([each[-2][self._angles] for each in poses])
            turned = np.abs(np.diff(angles, axis=0)).sum(axis=0)
            # Turning gimbals average over many such errors, which cancel out.
            by_angle = by_angle / np.sqrt(1.0 + turned / max(self._dead_band_rad, 1e-9))
        rows = np.hstack([per_loss, turn, lag, by_angle, -_carried(measured), np.eye(3)])
        expected = (rolled_was.inverse() @ rolled).log()
        error = measured - (expected if expected.ndim == 1 else expected[0])
        return _Motion(error, rows, noise, change, turned)

    def _test_motion(self) -> None:
        """Test the motion in the last block, if a sensor other than the joints measured it."""
        motion = self._motion(_BLOCK_S)
        if motion is None or (motion.change > _MAX_CHANGE).any():
            return
        seconds, self._since_block_s = self._since_block_s, 0.0
        sensed = self._sensed_s >= _SENSED_S + WINDOW_S
        if not sensed and not self._has_gyro:
            return
        test, moves = self._wheel_test, np.exp(-motion.turned / max(self._dead_band_rad, 1e-9))
        # The end of a block is the start of the next, with the same pose error.
        contiguous = 1.0 if sensed and seconds < 1.1 * _BLOCK_S else 0.0
        ends = [0.0] * 3 + [contiguous] * 3 if self._ends_swapped else [contiguous] * 3 + [0.0] * 3
        test.keep(np.concatenate([[1.0, 1.0], moves, ends]), _BLOCK_S)
        rows = motion.rows.copy()
        if self._ends_swapped:
            rows[:, -6:] = np.hstack([rows[:, -3:], rows[:, -6:-3]])
        self._ends_swapped = not self._ends_swapped
        if sensed:
            test.add(motion.error, rows, motion.noise)
        else:
            rows[:, -6:] = 0.0
            test.add(motion.error[2:], rows[2:], motion.noise[2:, 2:])

    def _compare_joints(self) -> tuple[JointComparison, ...]:
        bands, scale = np.zeros(len(self._joints)), np.full(len(self._joints), 1.0 / RPM)
        if len(self._angles):
            bands[self._angles] = self._servo_test.bands(self._rates[self._angles])
            scale[self._angles] = 180.0 / math.pi
        errors = self._robot.joint_errors()
        share = math.hypot(errors.speed_scale_sigma, errors.common_mode_sigma)
        speeds = np.abs(self._nominal[self._wheels])
        bands[self._wheels] = 3.0 * np.hypot(share * speeds, self._speed_noise())
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
        motion = self._motion(WINDOW_S)
        if motion is None or self._compared_s < _WARM_UP_S + WINDOW_S:
            return None
        error, count = motion.error, len(self._wheels)
        per_loss, others = motion.rows[:, :count], motion.rows[:, count:] * self._nuisances
        if not (self._planar and self._sensed_s > 0.0):
            others = others[:, :-6]
        covariance = per_loss @ self._wheel_test.prior @ per_loss.T + motion.noise
        covariance += others @ others.T
        band = 3.0 * np.sqrt(np.diag(covariance))
        scale = np.array([1e3, 1e3, 180.0 / math.pi] if self._planar else [180.0 / math.pi] * 3)
        return PoseComparison(
            ("ahead", "left", "heading") if self._planar else ("about X", "about Y", "about Z"),
            ("mm", "mm", "°") if self._planar else ("°", "°", "°"),
            _triple(scale * error),
            _triple(scale * band),
            bool((np.abs(error) <= band).all()),
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Motion:
    """Measured minus simulated motion over some time."""

    error: Array
    """(3,): difference."""
    rows: Array
    """(3, k + n): Jacobian w.r.t. the wheels' fractional losses and the nuisances."""
    noise: Array
    """(3, 3): covariance of the remaining noise."""
    change: Array
    """(3,): total variation of the twist."""
    turned: Array
    """(m,): total variation of each gimbal angle, rad."""


def _carried(motion: Array) -> Array:
    """Return the Jacobian (3, 3) of a motion (3,) w.r.t. the initial pose error."""
    x, y, turn = motion.tolist()
    c, s = math.cos(turn), math.sin(turn)
    return np.array([[c, s, -c * y + s * x], [-s, c, s * y + c * x], [0.0, 0.0, 1.0]])


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
