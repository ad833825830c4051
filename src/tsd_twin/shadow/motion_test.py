"""Fault test of a robot's motion against its joints: wheels that drive less, gimbals that slipped.

The model is the one of the estimated covariance: errors of joints, layout and floor, as columns.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tsd_twin.estimation.joint_errors import JointBiases, jacobians
from tsd_twin.kinematics import JointKind
from tsd_twin.lie import Array
from tsd_twin.robots import RobotDescription
from tsd_twin.shadow.fault_filter import FaultFilter, Hypothesis, with_pairs

RATE_HZ = 10.0
"""Rate at which poses are recorded."""
_BLOCK_S = 0.5
_FUSED_SIGMA = 0.45
"""Standard deviation of a fused pose relative to the sensor."""
_MOUNT_RAD, _PLACE_M, _SLOPE_MPS2 = math.radians(0.3), 1e-3, 9.81 * math.radians(0.3)
"""Least errors of the layout and of the floor: no machine is exact."""
_LAG_SHARE, _LAG_NOISE = 0.25, 0.25
"""Error of the motion's lag: constant, and independent in each block, relative to the lag."""
_LEAST_LAG_S = 0.02
"""Least lag: contacts of all kinds creep."""
_MAX_CHANGE = np.array([0.7, 0.7, 1.5])
"""Change of the twist in a block (m/s, rad/s) above which the block is ignored, because wheels
slide and no model is accurate enough."""
_DROOP_OWN = 0.5
"""Fraction of the energy for a speed change that a single wheel may supply."""
_UNMODELLED = np.array([1e-3, 1e-3, 2.5e-3])
"""Unmodelled error in x, y and heading (1σ) per block."""
_WANDERS = 0.15
"""Change of a constant error within a minute, relative to its standard deviation."""
LOSS, ZERO_RAD, TURNED_RAD = 0.08, math.radians(1.0), math.radians(5.0)
"""Typical sizes of faults: a wheel's loss, a gimbal's zero, and the angle of a mounting."""
LEAST_LOSS, LEAST_ZERO_RAD = 0.02, math.radians(0.15)
"""Faults up to these sizes are not reported."""
_OTHERS = np.array([0.1, 0.1, 0.2, 0.1, 0.05, 0.05])
"""Sizes of disturbances that are not parts: a constant twist, a motion in another direction (rad),
and a drift over the floor."""


@dataclass(frozen=True, slots=True, eq=False)
class MotionBlock:
    """Measured minus expected motion over some time."""

    error: Array
    """(3,): difference."""
    rows: Array
    """(3, n): Jacobian with respect to the nuisances."""
    columns: Array
    """(3, f): Jacobian with respect to the faults."""
    noise: Array
    """(3, 3): covariance of the remaining noise."""
    change: Array
    """(3,): total variation of the twist."""
    turned: Array
    """(m,): total variation of each gimbal angle, rad."""


@dataclass(frozen=True, slots=True, eq=False)
class _Sample:
    now_s: float
    pose: Any
    rolled: Any
    twist: Array
    angles: Array
    rows: Array
    """(3, m): Jacobian of the twist with respect to the constant errors."""
    columns: Array
    """(3, f): Jacobian of the twist with respect to the faults."""


class MotionTest:
    """Compares the measured motion with the joints, in blocks of 0.5 s."""

    def __init__(self, robot: RobotDescription, *, has_gyro: bool) -> None:
        self._kinematics = kinematics = robot.kinematics()
        is_angle = np.array([joint.kind is JointKind.POSITION for joint in kinematics.joints])
        self._angles, self._wheels = np.flatnonzero(is_angle), np.flatnonzero(~is_angle)
        errors = robot.joint_errors()
        built = replace(
            errors,
            mount_rad=max(errors.mount_rad, _MOUNT_RAD),
            place_m=max(errors.place_m, _PLACE_M),
            slope_mps2=max(errors.slope_mps2, _SLOPE_MPS2),
        )
        self._biases = JointBiases(kinematics, built)
        self._has_gyro = has_gyro
        gives = robot.joint_compliance()
        self._dead_band_rad = 0.0 if gives is None else gives.dead_band_rad
        self._lag_s = max(errors.floor.slip_lag_s, _LAG_SHARE * robot.lag_s, _LEAST_LAG_S)
        self._droop_s2_per_m2 = robot.spin_droop_s2_per_m2
        sensor = robot.pose_sensor
        pose = [sensor.sigma_m, sensor.sigma_m, math.radians(sensor.sigma_deg)]
        # Constant errors, then the errors of gimbals at rest, the lag, and poses at start and end.
        count, angles, wheels = self._biases.count, len(self._angles), len(self._wheels)
        sigma = np.concatenate(
            [
                np.ones(count),
                np.full(angles, self._dead_band_rad / math.sqrt(3.0)),
                [self._lag_s],
                np.tile([_FUSED_SIGMA * each for each in pose], 2),
            ]
        )
        walk = math.sqrt(_BLOCK_S / 60.0) * _WANDERS
        self._walk = np.where(np.arange(len(sigma)) < count, walk, 0.0)
        slow = [Hypothesis((i,), positive=True) for i in range(wheels)]
        slipped = [Hypothesis((wheels + i,)) for i in range(angles)]
        parts = with_pairs(slow) + with_pairs(slipped)
        if wheels > 1:
            least = 2.0 * errors.common_mode_sigma
            every = tuple(range(wheels))
            parts.append(Hypothesis(every, together=True, positive=True, least=least))
        sizes = [(wheels, LOSS, LEAST_LOSS), (angles, ZERO_RAD, LEAST_ZERO_RAD)]
        self._layout = getattr(kinematics, "contact_layout", None)
        mounts = 0 if self._layout is None else wheels
        sizes += [(mounts, TURNED_RAD, 0.3 * TURNED_RAD)]
        sizes += [(1, each, 0.3 * each) for each in _OTHERS]
        scale, least = (
            np.concatenate([np.full(size[0], size[i]) for size in sizes]) for i in (1, 2)
        )
        self.filter = FaultFilter(sigma, scale, least, parts)
        self.restart()

    def restart(self) -> None:
        """Begin again after a gap or a jump of the pose."""
        self._rolled: Any = self._kinematics.pose_type.identity()
        self._samples: deque[_Sample] = deque()
        self._block_from_s = -math.inf
        self._followed_s = -math.inf
        self._ended = False

    def roll(self, joints: Array, rates: Array, dt_s: float) -> None:
        """Integrate the motion expected by `joints` (n,) and their `rates` (n,)."""
        twist = self._kinematics.forward(joints, rates).twist
        self._rolled = self._kinematics.integrate(self._rolled, twist, dt_s)

    def record(self, now_s: float, pose: Any, joints: Array, window_s: float) -> None:
        """Record the measured pose with the expected one, for `window_s`."""
        samples = self._samples
        if samples and now_s - samples[-1].now_s < 1.0 / RATE_HZ - 1e-6:
            return
        kinematics, biases = self._kinematics, self._biases
        twist = kinematics.forward(joints).twist
        if biases.floor is not None:
            dt_s = min(now_s - self._followed_s, 1.0)
            biases.floor.follow(twist, joints, dt_s)
            self._followed_s = now_s
        slopes = jacobians(kinematics, joints)[0]
        heading = float(pose.xy_heading[2]) if hasattr(pose, "xy_heading") else 0.0
        rows = biases.of_twist(joints, slopes, twist, heading)
        c, s = math.cos(heading), math.sin(heading)
        others = np.zeros((3, len(_OTHERS)))
        turned = np.zeros((3, 0)) if self._layout is None else self._layout.slopes(twist)[:, ::4]
        others[:, :3] = np.eye(3)
        others[:2, 3] = -twist[1], twist[0]
        others[:2, 4:] = [[c, s], [-s, c]]
        wheels = self._wheels
        columns = np.hstack(
            [-slopes[:, wheels] * joints[wheels], slopes[:, self._angles], turned, others]
        )
        samples.append(
            _Sample(now_s, pose, self._rolled, twist, joints[self._angles], rows, columns)
        )
        while len(samples) > 1 and samples[1].now_s <= now_s - window_s + 1e-6:
            samples.popleft()

    def compare(self, seconds: float) -> MotionBlock | None:
        """Compare the motion in the last `seconds`, or return None without enough data."""
        end_s = self._samples[-1].now_s if self._samples else 0.0
        kept = [each for each in self._samples if each.now_s >= end_s - seconds - 1e-6]
        if len(kept) < 2 or end_s - kept[0].now_s < 0.9 * seconds:
            return None
        first, last = kept[0], kept[-1]
        took_s = end_s - first.now_s
        measured: Array = (first.pose.inverse() @ last.pose).log()
        expected: Array = np.atleast_2d((first.rolled.inverse() @ last.rolled).log())[0]
        rows = took_s * np.mean([each.rows for each in kept], axis=0)
        columns = took_s * np.mean([each.columns for each in kept], axis=0)
        twists = np.array([each.twist for each in kept])
        change = np.abs(np.diff(twists, axis=0)).sum(axis=0)
        sigma = 0.005 * np.abs(expected).max() + _LAG_NOISE * self._lag_s * change
        noise = np.diag(sigma**2 + _UNMODELLED**2)
        if self._droop_s2_per_m2 > 0.0:
            # An accelerating robot takes energy out of its wheels, more from some of them.
            gained = np.abs(np.diff(np.square(twists[:, :2]).sum(axis=1))).sum()
            own = _DROOP_OWN * self._droop_s2_per_m2 * gained * columns[:, : len(self._wheels)]
            noise += own @ own.T
        angles = np.array([each.angles for each in kept])
        turned = np.abs(np.diff(angles, axis=0)).sum(axis=0)
        wheels = len(self._wheels)
        by_angle = columns[:, wheels : wheels + len(self._angles)]
        # Turning gimbals average over many errors within their dead bands.
        by_angle = by_angle / np.sqrt(1.0 + turned / max(self._dead_band_rad, 1e-9))
        lag = (twists[0] - twists[-1])[:, None]
        ends = np.hstack([-_carried(measured), np.eye(3)])
        rows = np.hstack([rows, by_angle, lag, ends])
        return MotionBlock(measured - expected, rows, columns, noise, change, turned)

    def step(self, now_s: float, *, sensed: bool) -> None:
        """Test the last block, if a sensor other than the joints measured it."""
        if now_s - self._block_from_s < _BLOCK_S - 1e-6:
            return
        block = self.compare(_BLOCK_S)
        if block is None or (block.change > _MAX_CHANGE).any():
            self._ended = False
            return
        seconds, self._block_from_s = now_s - self._block_from_s, now_s
        if not sensed and not self._has_gyro:
            return
        count = len(self.filter.sigma)
        kept = np.ones(count)
        angles = self._biases.count
        turned = np.exp(-block.turned / max(self._dead_band_rad, 1e-9))
        kept[angles : angles + len(turned)] = turned
        # The end of a block is the start of the next, with the same pose error.
        contiguous = self._ended and sensed and seconds < 1.1 * _BLOCK_S
        kept[-6:-3], kept[-3:] = float(contiguous), 0.0
        source = np.arange(count)
        source[-6:-3], source[-3:] = source[-3:].copy(), source[-6:-3].copy()
        self.filter.predict(kept, self._walk, source)
        self._ended = sensed
        error, rows, columns, noise = block.error, block.rows, block.columns, block.noise
        if not sensed:
            rows = rows.copy()
            rows[:, -6:] = 0.0
            error, rows, columns, noise = error[2:], rows[2:], columns[2:], noise[2:, 2:]
        self.filter.add(error, rows, columns, noise)

    def band(self, block: MotionBlock, *, posed: bool) -> Array:
        """Return three standard deviations (3,) of a sound robot's motion."""
        rows = block.rows * self.filter.sigma
        if not posed:
            rows = rows[:, :-6]
        return 3.0 * np.sqrt(np.diag(rows @ rows.T + block.noise))


def _carried(motion: Array) -> Array:
    """Return the Jacobian (3, 3) of a motion (3,) w.r.t. the initial pose error."""
    x, y, turn = motion.tolist()
    c, s = math.cos(turn), math.sin(turn)
    return np.array([[c, s, -c * y + s * x], [-s, c, s * y + c * x], [0.0, 0.0, 1.0]])
