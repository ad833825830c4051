"""Fusion of odometry with a pose sensor: gating by Mahalanobis distance, and relocalization."""

from __future__ import annotations

import math
from collections import deque
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from tsd_twin.estimation.consistency import FALSE_ALARM, chi_square_bound
from tsd_twin.estimation.pose_filter import PoseFilter
from tsd_twin.estimation.sensor_odometry import Estimate
from tsd_twin.estimation.wheel_odometry import CORRELATION_S
from tsd_twin.kinematics import Kinematics, TwistSolution
from tsd_twin.lie import SE2, Array, wrap
from tsd_twin.robots import PoseSensor

_LEAST = 10
_LONG_ENOUGH_S = 0.5


class RelocalizationDetector:
    """Relocalizes when rejected poses agree with each other: then the estimate is wrong.

    It applies to a robot at rest only, whose pose is constant.
    """

    def __init__(self, covariance: Array, gate: float) -> None:
        """`covariance` (3, 3) is that of the difference of two poses, `gate` a chi-square bound."""
        self._weight = np.linalg.inv(covariance)
        self._gate = gate
        self._first: tuple[SE2, float] | None = None
        self._count = 0

    def clear(self) -> None:
        """Discard the rejected poses: the estimate is right, or the robot moves."""
        self._first = None

    def persists(self, pose: SE2, at_s: float) -> bool:
        """Add a rejected pose, measured at `at_s`; return whether they agree for long enough."""
        if self._first is None or not self._agrees(pose, self._first[0]):
            self._first, self._count = (pose, at_s), 0
        self._count += 1
        if self._count < _LEAST or at_s - self._first[1] < _LONG_ENOUGH_S:
            return False
        self.clear()
        return True

    def _agrees(self, pose: SE2, first: SE2) -> bool:
        off = pose.xy_heading - first.xy_heading
        off[2] = wrap(off[2])
        return float(off @ self._weight @ off) <= self._gate


MEMORY_S = 1.0
"""Largest delay of a pose that can be fused."""
MOST = 128
"""Capacity for measured poses within the memory."""
MOST_NEWER = 16
"""Largest number of later measurements for which a late pose is still fused; bounds the work of
recomputing them."""
_PATIENCE_S = 2.0
"""Timeout of the pose sensor; then the inner estimate is used alone."""
_FARTHEST_M = 1e6
"""Largest coordinate; beyond it, squares lose the precision that the test needs."""
_STEPS_KEPT = 128
_GATE = chi_square_bound(3, FALSE_ALARM)


class FusionResult(StrEnum):
    """Result of the fusion of one measured pose."""

    USED = "used"
    FOUND = "found"
    """Relocalized: the estimate was wrong, and is reset to the measured pose."""
    OLD = "old"
    FLOOD = "flood"
    FAR = "far"
    """Rejected by the Mahalanobis gate, which rejects one in 10,000 good poses."""


class _EstimateRecord(NamedTuple):
    """A step of the inner estimate, and its pose after it."""

    end_s: float
    motion: TwistSolution
    twist_covariance: Array
    pose: SE2
    pose_covariance: Array


class FusedEstimate:
    """Fused estimate of a robot on a floor: odometry with a pose corrected by a pose sensor.

    The twist is always that of the inner estimate, so a jump of the pose does not change it.
    Without pose measurements this is the inner estimate, and no filter runs.
    """

    def __init__(self, kinematics: Kinematics[SE2], inner: Estimate, noise: PoseSensor) -> None:
        self.inner = inner
        self._kinematics = kinematics
        sigma = np.array([noise.sigma_m, noise.sigma_m, math.radians(noise.sigma_deg)])
        self._noise = np.diag(np.square(sigma))
        self._past: deque[_EstimateRecord] = deque(maxlen=_STEPS_KEPT)
        self._filter: PoseFilter | None = None
        self._heard_s = -math.inf
        self._relocalization = RelocalizationDetector(2.0 * self._noise, _GATE)

    @property
    def is_corrected(self) -> bool:
        """Whether pose measurements have corrected the estimate lately."""
        return self._filter is not None

    @property
    def pose(self) -> Any:
        """The pose in `odom`."""
        return self.inner.pose if self._filter is None else self._filter.pose

    @property
    def pose_covariance(self) -> Array:
        """(3, 3): covariance of the pose, in `odom`."""
        return self.inner.pose_covariance if self._filter is None else self._filter.covariance

    @property
    def motion(self) -> TwistSolution:
        """The twist in `base_link`, with its residual."""
        return self.inner.motion

    @property
    def twist_covariance(self) -> Array:
        """(3, 3): covariance of the twist, in `base_link`."""
        return self.inner.twist_covariance

    def set_pose(self, pose: Any, covariance: Array | None = None) -> None:
        """Set the estimate to `pose`, and discard earlier measurements."""
        self.inner.set_pose(pose, covariance)
        self._past.clear()
        self._filter = None

    def follow(self, now_s: float) -> None:
        """Update with the step of the inner estimate to `now_s`."""
        inner = self.inner
        covariance = inner.twist_covariance
        self._past.append(
            _EstimateRecord(now_s, inner.motion, covariance, inner.pose, inner.pose_covariance)
        )
        if self._filter is None:
            return
        self._filter.advance(now_s, inner.motion.twist, covariance * CORRELATION_S)
        if now_s - self._heard_s > _PATIENCE_S:
            self.inner.set_pose(self._filter.pose, self._filter.covariance)
            self._past.clear()
            self._filter = None

    def fuse(self, pose: SE2, measured_s: float, *, at_rest: bool) -> FusionResult:
        """Fuse a pose measured at `measured_s`, and return the result.

        A robot at rest is relocalized when many rejected poses agree with each other.
        """
        if self._filter is None and not self._past:
            return FusionResult.OLD
        running = self._filter = self._filter or self._caught_up()
        now_s = self._heard_s = running.now_s
        at_s = min(measured_s, now_s)
        if not at_s >= max(running.oldest_s, now_s - MEMORY_S):
            return FusionResult.OLD
        if running.newer(at_s) > MOST_NEWER:
            return FusionResult.OLD
        if running.measurements >= MOST:
            return FusionResult.FLOOD
        if not np.abs(pose.xy_heading).max() <= _FARTHEST_M:
            return FusionResult.FAR
        if float(running.mahalanobis_sq(pose, self._noise, at_s)) <= _GATE:
            self._relocalization.clear()
            running.fuse_pose(pose, self._noise, at_s)
            return FusionResult.USED
        if at_rest and self._relocalization.persists(pose, at_s):
            self._begin_anew(running, pose, at_s)
            return FusionResult.FOUND
        if not at_rest:
            self._relocalization.clear()
        return FusionResult.FAR

    def _caught_up(self) -> PoseFilter:
        """Return a new filter that has processed all steps in the memory."""
        first, *others = self._past
        made = PoseFilter(
            self._kinematics,
            first.pose,
            first.pose_covariance,
            now_s=first.end_s,
            memory_s=MEMORY_S,
        )
        for past in others:
            made.advance(past.end_s, past.motion.twist, past.twist_covariance * CORRELATION_S)
        return made

    def _begin_anew(self, old: PoseFilter, seen: SE2, at_s: float) -> None:
        here = old.pose.xy_heading
        turned = here[2] + float(wrap(seen.xy_heading[2] - here[2]))
        pose = SE2(np.array([seen.xy_heading[0], seen.xy_heading[1], turned]))
        self.set_pose(pose, self._noise)
        self._filter = PoseFilter(
            self._kinematics, pose, self._noise, now_s=at_s, memory_s=MEMORY_S
        )
        # The robot is at rest, so the pose has been constant since.
        self._filter.advance(old.now_s, np.zeros(3), np.zeros((3, 3)))
