"""Fusion of odometry with a pose sensor: gating by Mahalanobis distance, and relocalization."""

from __future__ import annotations

import math
from collections import deque
from enum import StrEnum
from itertools import dropwhile
from typing import Any, NamedTuple

import numpy as np

from tsd_twin.estimation.consistency import FALSE_ALARM, chi_square_bound
from tsd_twin.estimation.pose_filter import PoseFilter
from tsd_twin.estimation.pose_spread import PoseErrors, TwistErrors
from tsd_twin.estimation.sensor_odometry import DeadReckoning
from tsd_twin.estimation.wheel_odometry import POSE_SENSOR_CONSTANTS
from tsd_twin.kinematics import Kinematics
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
    twist: Array
    errors: TwistErrors
    pose: SE2
    spread: Any
    """State of the spread of the pose error; None in the middle of a block."""


class FusedEstimate:
    """Fused estimate of a robot on a floor: odometry with a pose corrected by a pose sensor.

    The twist is always that of the inner estimate, so a jump of the pose does not change it.
    Without pose measurements this is the inner estimate, and no filter runs. The mounting of the
    sensor is a constant error, which many measurements do not average out.
    """

    def __init__(
        self, kinematics: Kinematics[SE2], inner: DeadReckoning, noise: PoseSensor
    ) -> None:
        self.inner = inner
        self._kinematics = kinematics
        sigma = np.array([noise.sigma_m, noise.sigma_m, math.radians(noise.sigma_deg)])
        self._noise = np.diag(np.square(sigma))
        mounting = [noise.mounting_m, noise.mounting_m, math.radians(noise.mounting_deg)]
        self._mounting: Array = np.zeros((3, inner.spread.constants))
        self._mounting[:, -POSE_SENSOR_CONSTANTS:] = np.diag(mounting)
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
    def end_twist(self) -> Array:
        """(3,): twist in `base_link`, at the end of the last step."""
        return self.inner.end_twist

    @property
    def twist_covariance(self) -> Array:
        """(3, 3): covariance of the twist, in `base_link`."""
        return self.inner.twist_covariance

    def set_pose(self, pose: Any, errors: PoseErrors | None = None) -> None:
        """Set the estimate to `pose`, with pose `errors`, and discard earlier measurements."""
        self.inner.set_pose(pose, errors)
        self._past.clear()
        self._filter = None

    def follow(self, now_s: float) -> None:
        """Update with the step of the inner estimate to `now_s`."""
        inner = self.inner
        twist, errors = inner.motion.twist, inner.errors
        self._past.append(_EstimateRecord(now_s, twist, errors, inner.pose, inner.spread.state))
        if self._filter is None:
            return
        self._filter.advance(now_s, twist, errors.white_per_s, errors.by_constants)
        if now_s - self._heard_s > _PATIENCE_S:
            self.inner.set_pose(self._filter.pose, self._filter.errors)
            self._past.clear()
            self._filter = None

    def fuse(self, pose: SE2, measured_s: float, *, at_rest: bool) -> FusionResult:
        """Fuse a pose measured at `measured_s`, and return the result.

        A robot at rest is relocalized when many rejected poses agree with each other.
        """
        running = self._filter = self._filter or self._caught_up()
        if running is None:
            return FusionResult.OLD
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
        if float(running.mahalanobis_sq(pose, self._noise, at_s, self._mounting)) <= _GATE:
            self._relocalization.clear()
            running.fuse_pose(pose, self._noise, at_s, self._mounting)
            return FusionResult.USED
        if at_rest and self._relocalization.persists(pose, at_s):
            self._begin_anew(running, pose, at_s)
            return FusionResult.FOUND
        if not at_rest:
            self._relocalization.clear()
        return FusionResult.FAR

    def _caught_up(self) -> PoseFilter | None:
        """Return a new filter that has processed all steps in the memory; None without any."""
        steps = list(dropwhile(lambda past: past.spread is None, self._past))
        if not steps:
            return None
        first, *others = steps
        errors = self.inner.spread.errors_at(first.spread)
        made = self._new_filter(first.pose, errors, first.end_s)
        for past in others:
            made.advance(past.end_s, past.twist, past.errors.white_per_s, past.errors.by_constants)
        return made

    def _new_filter(self, pose: SE2, errors: PoseErrors, now_s: float) -> PoseFilter:
        return PoseFilter(
            self._kinematics,
            pose,
            errors.rest,
            by_constants=errors.by_constants,
            now_s=now_s,
            memory_s=MEMORY_S,
        )

    def _begin_anew(self, old: PoseFilter, seen: SE2, at_s: float) -> None:
        here = old.pose.xy_heading
        turned = here[2] + float(wrap(seen.xy_heading[2] - here[2]))
        pose = SE2(np.array([seen.xy_heading[0], seen.xy_heading[1], turned]))
        errors = PoseErrors(-self._mounting, self._noise)
        self.set_pose(pose, errors)
        self._filter = self._new_filter(pose, errors, at_s)
        # The robot is at rest, so the pose has been constant since.
        self._filter.advance(old.now_s, np.zeros(3), np.zeros((3, 3)))
