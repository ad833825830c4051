"""Fusion of odometry with a pose sensor: gating by Mahalanobis distance, and relocalization.

Rejected poses that agree with each other relocalize the robot. The rules and their rate of
accepting wrong poses are derived in `docs/estimation.md`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from enum import StrEnum
from itertools import dropwhile
from typing import Any, NamedTuple

import numpy as np

from tsd_twin.estimation.bias_filter import BiasFilter
from tsd_twin.estimation.pose_filter import GATE, PoseFilter
from tsd_twin.estimation.pose_uncertainty import PoseErrors, TwistErrors
from tsd_twin.estimation.sensor_correction import SensorCorrection
from tsd_twin.estimation.wheel_odometry import POSE_SENSOR_BIASES, WheelOdometry
from tsd_twin.kinematics import Kinematics
from tsd_twin.lie import SE2, Array, wrap
from tsd_twin.sensors.pose import PoseSensor

_VOTES = 10
_MIN_VOTING_S = 0.5
_MOVED = 4.0 * GATE
"""Squared normalized distance between two poses above which the image counts as moving: twice the
distance explained by noise."""


class PoseHypothesis:
    """Hypothesis that the rejected poses are correct, with a separate filter that fuses them.

    Each pose that agrees with the filter, and thus with earlier poses and the odometry between
    them, votes for the hypothesis; other poses vote against it. It ends without votes. This is the
    majority vote of Boyer and Moore (1981), which isolated outliers cannot win.
    """

    def __init__(
        self, pose_filter: PoseFilter, pose: SE2, at_s: float, *, against_founded: bool
    ) -> None:
        """`pose_filter` starts at `pose`, measured at `at_s`."""
        self.filter = pose_filter
        self.against_founded = against_founded
        """Whether the estimate was well-founded when the hypothesis began."""
        self._first, self._first_s = pose, at_s
        self._votes = 1

    def age_s(self, at_s: float) -> float:
        """Return the time since the first pose."""
        return at_s - self._first_s

    def vote(self, pose: SE2, covariance: Array, bias_jacobian: Array, at_s: float) -> bool:
        """Fuse a pose if it agrees, and return whether it did; arguments as in `fuse_pose`."""
        if not at_s >= self.filter.oldest_s:
            return False
        if float(self.filter.mahalanobis_sq(pose, covariance, at_s, bias_jacobian)) > GATE:
            self._votes -= 1
            return False
        self.filter.fuse_pose(pose, covariance, at_s, bias_jacobian)
        self._votes = min(self._votes + 1, _VOTES)  # Capped, so that it can be outvoted soon.
        return True

    def vote_against(self) -> None:
        """Count a pose that agrees with the estimate."""
        self._votes -= 1

    @property
    def is_over(self) -> bool:
        """Whether at least as many poses disagreed as agreed."""
        return self._votes <= 0

    def persists(self, at_s: float) -> bool:
        """Return whether enough poses have agreed for long enough."""
        return self._votes >= _VOTES and self.age_s(at_s) >= _MIN_VOTING_S

    def has_moved(self, pose: SE2, covariance: Array) -> bool:
        """Return whether `pose` differs from the first by more than noise (the image is moving)."""
        off = pose.xy_heading - self._first.xy_heading
        off[2] = wrap(off[2])
        return float(off @ np.linalg.solve(2.0 * covariance, off)) > _MOVED


MEMORY_S = 1.0
"""Maximum delay of a pose that can be fused."""
MAX_BUFFERED = 128
"""Maximum number of measured poses within the memory."""
MAX_REPLAYED = 16
"""Maximum number of later measurements for which a late pose is still fused; bounds the
recomputation."""
_SENSOR_TIMEOUT_S = 2.0
"""Pose-sensor timeout, after which the correction is dropped."""
_MAX_COORDINATE_M = 1e6
"""Maximum coordinate; squares of larger values lose the precision needed for the gate."""
_STEPS_KEPT = 128
_NARROW_FACTOR = 4.0
"""A covariance is narrow if it is at most this multiple of the sensor's own. An outlier within the
gate is then at most twice the sensor gate away, and later poses correct it."""
_OVERRIDE_S = 10.0
"""Time for which poses must agree with each other to override a well-founded estimate."""


class FusionResult(StrEnum):
    """Result of fusing one measured pose."""

    USED = "used"
    RELOCALIZED = "found"
    """Relocalized at rest: the estimate was wrong and is reset to the measured poses."""
    OLD = "old"
    QUEUE_FULL = "flood"
    GATED = "far"
    """Rejected by the Mahalanobis gate (one in 10,000 correct poses), or not accepted alone because
    the estimate is not well-founded."""


class _EstimateRecord(NamedTuple):
    """Step of the inner estimate, and its pose afterwards."""

    end_s: float
    twist: Array
    errors: TwistErrors
    pose: SE2
    uncertainty: Any
    """State of the pose uncertainty, or None in the middle of a block."""

    def __deepcopy__(self, _memo: object) -> _EstimateRecord:
        """Return itself, because nothing changes a record."""
        return self


class FusedEstimate:
    """Planar estimate whose pose is corrected by a pose sensor.

    The twist always comes from `inner`, so a pose jump does not change it. Without pose
    measurements the pose does too, and no filter runs. The sensor mounting is a bias that does not
    average out over measurements.
    """

    def __init__(
        self,
        kinematics: Kinematics[SE2],
        inner: WheelOdometry[SE2],
        noise: PoseSensor,
        sensors: SensorCorrection | None = None,
    ) -> None:
        """`sensors` correct the pose, too; none by default."""
        self.inner = inner
        own = inner.uncertainty.bias_count
        self.sensors = sensors or SensorCorrection(0, (), own)
        self._kinematics = kinematics
        sigma = np.array([noise.sigma_m, noise.sigma_m, math.radians(noise.sigma_deg)])
        self._noise = np.diag(np.square(sigma))
        mounting = [noise.mounting_m, noise.mounting_m, math.radians(noise.mounting_deg)]
        self._mounting: Array = np.zeros((3, self.sensors.bias_count))
        self._mounting[:, own - POSE_SENSOR_BIASES : own] = np.diag(mounting)
        self._past: deque[_EstimateRecord] = deque(maxlen=_STEPS_KEPT)
        self._filter: PoseFilter | None = None
        self._well_founded_limit = _NARROW_FACTOR * (
            2.0 * self._noise + self._mounting @ self._mounting.T
        )
        self._received_s = -math.inf
        self._used_s: float | None = None
        """Time when a pose was last used or set, or None until the next step."""
        self._hypothesis: PoseHypothesis | None = None
        self._rested = False
        self.learning = BiasFilter(self.sensors.bias_count)
        """Estimates the biases from the poses used."""

    @property
    def is_corrected(self) -> bool:
        """Whether recent pose measurements have corrected the estimate."""
        return self._filter is not None

    @property
    def pose(self) -> Any:
        """Estimated pose in `odom`."""
        return self.inner.pose if self._filter is None else self._filter.pose

    @property
    def pose_covariance(self) -> Array:
        """(3, 3): covariance of the pose, in `odom`."""
        return self.inner.pose_covariance if self._filter is None else self._filter.covariance

    @property
    def end_twist(self) -> Array:
        """(3,): twist in `base_link` at the end of the last step."""
        return self.inner.end_twist

    @property
    def twist_covariance(self) -> Array:
        """(3, 3): covariance of the twist, in `base_link`."""
        return self.inner.twist_covariance

    def set_pose(self, pose: Any, errors: PoseErrors | None = None) -> None:
        """Set the estimate to `pose`, with pose `errors`, and discard earlier measurements."""
        self.inner.set_pose(pose, errors)
        self._past.clear()
        self._filter = self._hypothesis = self._used_s = None
        self.learning.forget_pose()

    def follow(self, now_s: float) -> None:
        """Update with the step of `inner` that ends at `now_s`."""
        inner = self.inner
        twist, errors = inner.motion.twist, self.sensors.twist_errors(inner.errors)
        self.learning.follow(now_s, twist, errors)
        step = _EstimateRecord(now_s, twist, errors, inner.pose, inner.uncertainty.state)
        self._past.append(step)
        if self._used_s is None:
            self._used_s = now_s
        if self._filter is None:
            return
        _replay(self._filter, [step])
        if self._hypothesis is not None:
            _replay(self._hypothesis.filter, [step])
        if now_s - self._received_s > _SENSOR_TIMEOUT_S:
            self._set_inner(self._filter)
            self._past.clear()
            self._filter = self._hypothesis = None

    def _set_inner(self, pose_filter: PoseFilter) -> None:
        self.inner.set_pose(pose_filter.pose, self.sensors.own_errors(pose_filter.errors))

    def fuse_readings(self, readings: Array, now_s: float) -> None:
        """Fuse the sensor readings (s,) of the step that ended at `now_s`; NaN are left out."""
        if not self.sensors.has_reading(readings):  # Catching up takes longer than a period.
            return
        running = self._filter or self._caught_up()
        if running is None:
            return
        found = self.sensors.readings(readings, running.pose)
        if not found:
            return
        self._filter, self._received_s = running, running.now_s
        self.learning.begin_pose(running.pose, running.errors, now_s)
        self.learning.fuse_readings(now_s, lambda pose: self.sensors.readings(readings, pose))
        for reading in found:
            if reading.is_plausible(running.errors):
                value = reading.rows @ running.pose.xy_heading + reading.offset
                running.fuse_linear(reading.rows, value, reading.covariance, reading.bias_jacobian)
                self._used_s = running.now_s

    def fuse(self, pose: SE2, measured_s: float, *, at_rest: bool) -> FusionResult:
        """Fuse a pose measured at `measured_s`, and return the result.

        Poses that agree with each other and with the odometry form a hypothesis, which can replace
        the estimate.
        """
        running = self._filter = self._filter or self._caught_up()
        if running is None:
            return FusionResult.OLD
        now_s = self._received_s = running.now_s
        at_s = min(measured_s, now_s)
        if at_rest and not self._rested:
            self._hypothesis = None  # The rules differ at rest; use only poses measured there.
        self._rested = at_rest
        filters = [running] if self._hypothesis is None else [running, self._hypothesis.filter]
        if not at_s >= max(running.oldest_s, now_s - MEMORY_S):
            return FusionResult.OLD
        if any(each.newer(at_s) > MAX_REPLAYED for each in filters):
            return FusionResult.OLD
        if any(each.measurements >= MAX_BUFFERED for each in filters):
            return FusionResult.QUEUE_FULL
        if not np.abs(pose.xy_heading).max() <= _MAX_COORDINATE_M:
            return FusionResult.GATED
        distance_sq = float(running.mahalanobis_sq(pose, self._noise, at_s, self._mounting))
        is_founded = self._is_founded(running, at_s)
        if distance_sq > GATE or not is_founded:
            return self._test(running, pose, at_s, distance_sq, at_rest, is_founded)
        running.fuse_pose(pose, self._noise, at_s, self._mounting)
        self.learning.fuse_pose(pose, self._noise, self._mounting, at_s)
        self._used_s = at_s if self._used_s is None else max(self._used_s, at_s)
        if self._hypothesis is not None:
            self._hypothesis.vote_against()
            self._hypothesis = None if self._hypothesis.is_over else self._hypothesis
        return FusionResult.USED

    def _is_founded(self, running: PoseFilter, at_s: float) -> bool:
        """Return whether the estimate is well-founded, so that a single agreeing pose is used."""
        if self._used_s is None or at_s - self._used_s <= _SENSOR_TIMEOUT_S:
            return True
        return bool(np.linalg.eigvalsh(self._well_founded_limit - running.covariance)[0] >= 0.0)

    def _test(
        self,
        running: PoseFilter,
        pose: SE2,
        at_s: float,
        distance_sq: float,
        at_rest: bool,
        is_founded: bool,
    ) -> FusionResult:
        """Test a pose against the hypothesis, which may replace the estimate `running`."""
        held = self._hypothesis
        if held is None or not held.vote(pose, self._noise, self._mounting, at_s):
            if held is None or held.is_over:
                self._hypothesis = self._new_hypothesis(running, pose, at_s, is_founded)
            return FusionResult.GATED
        if not held.persists(at_s):
            return FusionResult.GATED
        if not at_rest:
            may_win = not held.against_founded or held.age_s(at_s) >= _OVERRIDE_S
            if not (may_win and distance_sq <= GATE and held.has_moved(pose, self._noise)):
                return FusionResult.GATED
        self._filter, self._hypothesis, self._used_s = held.filter, None, at_s
        if distance_sq <= GATE:
            self.learning.fuse_pose(pose, self._noise, self._mounting, at_s)
            return FusionResult.USED
        self.learning.forget_pose()
        self._set_inner(held.filter)
        return FusionResult.RELOCALIZED

    def _new_hypothesis(
        self, running: PoseFilter, seen: SE2, at_s: float, is_founded: bool
    ) -> PoseHypothesis:
        here = running.pose.xy_heading
        turned = here[2] + float(wrap(seen.xy_heading[2] - here[2]))
        pose = SE2(np.array([seen.xy_heading[0], seen.xy_heading[1], turned]))
        made = self._new_filter(pose, PoseErrors(-self._mounting, self._noise), at_s)
        _replay(made, self._past)
        return PoseHypothesis(made, pose, at_s, against_founded=is_founded)

    def _caught_up(self) -> PoseFilter | None:
        """Return a new filter that has processed all steps in the memory, or None without steps."""
        steps = list(dropwhile(lambda past: past.uncertainty is None, self._past))
        if not steps:
            return None
        first, *others = steps
        errors = self.inner.uncertainty.errors_at(first.uncertainty)
        errors = PoseErrors(self.sensors.padded(errors.bias_jacobian), errors.noise_cov)
        made = self._new_filter(first.pose, errors, first.end_s)
        _replay(made, others)
        return made

    def _new_filter(self, pose: SE2, errors: PoseErrors, now_s: float) -> PoseFilter:
        return PoseFilter(
            self._kinematics,
            pose,
            errors.noise_cov,
            bias_jacobian=errors.bias_jacobian,
            now_s=now_s,
            memory_s=MEMORY_S,
        )


def _replay(pose_filter: PoseFilter, steps: Iterable[_EstimateRecord]) -> None:
    for step in steps:
        errors = step.errors
        pose_filter.advance(step.end_s, step.twist, errors.white_per_s, errors.bias_jacobian)
