"""Kalman filters for the pose: integrate twists, apply late measurements at their stamps.

`PoseFilter` fuses poses and headings, and considers biases (Schmidt-Kalman). `DriftFilter` also
estimates biases of the twist.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from tsd_twin.estimation.consistency import FALSE_ALARM, chi_square_bound
from tsd_twin.estimation.pose_uncertainty import PoseErrors, exponential_error
from tsd_twin.kinematics import Kinematics
from tsd_twin.lie import SE2, Array, wrap

GATE = chi_square_bound(3, FALSE_ALARM)
"""Squared Mahalanobis distance (3 dimensions) exceeded by one correct pose in 10,000."""
_HEADING = np.eye(3)[2:]
_POSE = np.eye(3)


@dataclass(frozen=True, slots=True, eq=False)
class _Measurement:
    """Measured `value` (..., j) of the pose components selected by `rows` (j, 3)."""

    rows: Array
    value: Array
    covariance: Array
    bias_jacobian: Array
    """(..., j, m): Jacobian of the measured value with respect to the biases."""
    weighs_biases: bool = False
    """Whether the gain accounts for the biases, so that the pose does not follow a biased value."""


@dataclass(slots=True, eq=False)
class _FilterStep:
    """Filter step: its input, the measurements at its end, and the resulting state."""

    end_s: float
    twist: Array
    moved: Array
    """(..., 3): displacement in the frame of the step's start, independent of that pose."""
    growth_per_s: Array
    twist_bias_jacobian: Array
    """(..., 3, m): Jacobian of the twist with respect to the biases."""
    pose: Array
    bias_jacobian: Array
    """(..., 3, m): Jacobian of the pose with respect to the biases."""
    noise_cov: Array
    """(..., 3, 3): covariance of the pose without biases (process noise)."""
    cautious: Array
    """(..., 3, 3): covariance of the pose if twist biases were redrawn every second."""
    measured: list[_Measurement] = field(default_factory=list[_Measurement])

    @property
    def covariance(self) -> Array:
        """(..., 3, 3): covariance of the pose."""
        return self.noise_cov + self.bias_jacobian @ _transposed(self.bias_jacobian)


class PoseFilter:
    """Kalman filter for the world pose at the time of the latest twist.

    All arrays may have leading batch dimensions, equal for all. Times are in seconds on one clock
    and increase from twist to twist.

    Biases are independent, standard normal numbers that twists and measurements may depend on. The
    filter considers them: it propagates their effect on the pose without estimating them. Source:
    Schmidt, "Application of state-space methods to navigation problems" (1966). The gains assume
    that twist biases are redrawn every second and that measurements have none, so the filter also
    corrects errors that are larger than described or not constant. The covariance accounts for
    these suboptimal gains.
    """

    def __init__(
        self,
        kinematics: Kinematics[SE2],
        pose: SE2,
        covariance: Array | None = None,
        *,
        bias_jacobian: Array | None = None,
        now_s: float = 0.0,
        memory_s: float = 1.0,
    ) -> None:
        """`bias_jacobian` (..., 3, m): effect of m biases on `pose`, besides `covariance`."""
        self._kinematics = kinematics
        self._memory_s = memory_s
        start = np.array(pose.xy_heading, dtype=float)
        none, growth = np.zeros_like(start), np.zeros((*start.shape, 3))
        noise_cov = growth if covariance is None else np.array(covariance)
        by = np.zeros((*start.shape, 0)) if bias_jacobian is None else np.array(bias_jacobian)
        self._none: Array = np.zeros_like(by)
        cautious = noise_cov + by @ _transposed(by)
        self._steps = [
            _FilterStep(now_s, none, none, growth, self._none, start, by, noise_cov, cautious)
        ]
        self._still = SE2.identity(start.shape[:-1])

    @property
    def now_s(self) -> float:
        """Time of the latest twist."""
        return self._steps[-1].end_s

    @property
    def oldest_s(self) -> float:
        """Start of the memory; older measurements are rejected."""
        return self._steps[0].end_s

    @property
    def measurements(self) -> int:
        """Number of measurements in the memory, which determines the cost of a late one."""
        return sum(len(step.measured) for step in self._steps)

    def newer(self, measured_s: float) -> int:
        """Return the number of later measurement times, each of which must be recomputed."""
        return sum(bool(step.measured) for step in self._steps[self._index(measured_s) + 1 :])

    @property
    def pose(self) -> SE2:
        """Estimated pose."""
        return SE2(self._steps[-1].pose)

    @property
    def covariance(self) -> Array:
        """(..., 3, 3): covariance of x, y, heading."""
        return self._steps[-1].covariance

    @property
    def errors(self) -> PoseErrors:
        """Errors of x, y, heading."""
        return PoseErrors(self._steps[-1].bias_jacobian, self._steps[-1].noise_cov)

    def advance(
        self, now_s: float, twist: Array, growth_per_s: Array, bias_jacobian: Array | None = None
    ) -> None:
        """Predict to `now_s` with the mean `twist` (..., 3) since the last time.

        Args:
            now_s: End of the step.
            twist: (..., 3) mean twist in the body frame.
            growth_per_s: (..., 3, 3) growth of the pose covariance per second, body frame: S dt for
                white noise of covariance S in each sample of length dt.
            bias_jacobian: (..., 3, m) Jacobian of the twist w.r.t. the biases; zero by default.
        """
        if not now_s > self.now_s:
            return
        last = self._steps[-1]
        growth = np.zeros_like(last.noise_cov) + growth_per_s
        by = self._none if bias_jacobian is None else self._none + bias_jacobian
        self._steps.append(self._step(last, now_s, np.array(twist), growth, by))
        self._run(len(self._steps) - 1)
        # Keep one step older than the memory as the initial state for the others.
        oldest = now_s - self._memory_s
        while len(self._steps) > 2 and self._steps[1].end_s <= oldest:
            del self._steps[0]

    def fuse_pose(
        self,
        pose: SE2,
        covariance: Array,
        measured_s: float | None = None,
        bias_jacobian: Array | None = None,
    ) -> bool:
        """Fuse measured poses with a covariance (..., 3, 3); return False if too old or not finite.

        `bias_jacobian` (..., 3, m) is the Jacobian of a measured pose w.r.t. the biases; zero by
        default.
        """
        by = self._none if bias_jacobian is None else bias_jacobian
        value = np.array(pose.xy_heading, dtype=float)
        return self._fuse(_Measurement(_POSE, value, np.array(covariance), by), measured_s)

    def fuse_linear(
        self,
        rows: Array,
        value: Array,
        covariance: Array,
        bias_jacobian: Array,
        measured_s: float | None = None,
    ) -> bool:
        """Fuse a `value` (..., j) of `rows` (j, 3) @ pose; return False as in `fuse_pose`.

        The gain accounts for the biases of the value, unlike that of a measured pose.
        """
        measurement = _Measurement(rows, value, covariance, bias_jacobian, weighs_biases=True)
        return self._fuse(measurement, measured_s)

    def mahalanobis_sq(
        self,
        pose: SE2,
        covariance: Array,
        measured_s: float,
        bias_jacobian: Array | None = None,
    ) -> Array:
        """Return the squared Mahalanobis distance (...) of measured poses from the prediction.

        It is the smaller of two distances, by the filter's covariance and by the covariance assumed
        for the gains, so its distribution is at most chi-square with three degrees of freedom. The
        filter is not changed. `measured_s` must be within the memory; `bias_jacobian` as in
        `fuse_pose`.
        """
        index = self._index(min(measured_s, self.now_s))
        step = self._steps[index]
        if step.end_s < measured_s and index + 1 < len(self._steps):
            later = self._steps[index + 1]
            step = self._part(step, measured_s, later)
            _carry(self._steps[index], [step])
        off = exponential_error(SE2(step.pose), pose)
        by = step.bias_jacobian if bias_jacobian is None else step.bias_jacobian + bias_jacobian
        claimed = step.noise_cov + by @ _transposed(by)
        expected = np.stack([claimed, step.cautious]) + covariance
        weighed = np.asarray(np.linalg.solve(expected, off[None, ..., None]), dtype=float)
        return (off * weighed[..., 0]).sum(axis=-1).min(axis=0)

    def _index(self, at_s: float) -> int:
        """Return the index of the last step that ends at or before `at_s`."""
        return bisect_right(self._steps, at_s, key=lambda step: step.end_s) - 1

    def _fuse(self, measurement: _Measurement, measured_s: float | None) -> bool:
        at_s = self.now_s if measured_s is None else min(measured_s, self.now_s)
        if not np.isfinite(measurement.value).all() or not at_s >= self.oldest_s:
            return False
        index = self._index(at_s)
        if self._steps[index].end_s < at_s:
            index += 1
            self._split(index, at_s)
        self._steps[index].measured.append(measurement)
        if index == 0:
            _correct(self._steps[0], measurement)
            index = 1
        self._run(index)
        return True

    def _split(self, index: int, at_s: float) -> None:
        """Split the step at `index` at the time `at_s`."""
        whole = self._steps[index]
        first = self._part(self._steps[index - 1], at_s, whole)
        second = self._part(first, whole.end_s, whole)
        second.measured = whole.measured
        self._steps[index : index + 1] = [first, second]

    def _part(self, before: _FilterStep, end_s: float, whole: _FilterStep) -> _FilterStep:
        """Return the part of a step from the end of `before` to `end_s`, not yet run."""
        twist_by = whole.twist_bias_jacobian
        return self._step(before, end_s, whole.twist, whole.growth_per_s, twist_by)

    def _step(
        self, before: _FilterStep, end_s: float, twist: Array, growth_per_s: Array, twist_by: Array
    ) -> _FilterStep:
        """Return a step that starts at the end of `before`, not yet run."""
        moved = self._kinematics.integrate(self._still, twist, end_s - before.end_s).xy_heading
        state = (before.pose, before.bias_jacobian, before.noise_cov, before.cautious)
        return _FilterStep(end_s, twist, moved, growth_per_s, twist_by, *state)

    def _run(self, index: int) -> None:
        """Recompute all steps from `index`, batched between measurements."""
        while index < len(self._steps):
            end = index + 1
            while end < len(self._steps) and not self._steps[end - 1].measured:
                end += 1
            _carry(self._steps[index - 1], self._steps[index:end])
            for measurement in self._steps[end - 1].measured:
                _correct(self._steps[end - 1], measurement)
            index = end


_PERSIST_S = 1.0
"""Time over which the gains treat a twist error as constant."""
_TWIST_MARGIN = 0.01
"""Relative twist error assumed by the gains, in addition to the described errors."""


def _carry(before: _FilterStep, steps: Sequence[_FilterStep]) -> None:
    """Propagate pose and covariance from the end of `before` over the following `steps`.

    Batched, because up to a second of steps follows a late measurement.
    """
    moved = np.stack([step.moved for step in steps])
    growth = np.stack([step.growth_per_s for step in steps])
    heading = before.pose[..., 2] + moved[..., 2].cumsum(axis=0)
    begin = heading - moved[..., 2]
    c, s = np.cos(begin), np.sin(begin)
    pose = np.stack([moved[..., 0], moved[..., 1], heading], axis=-1)
    pose[..., 0] = before.pose[..., 0] + (c * moved[..., 0] - s * moved[..., 1]).cumsum(axis=0)
    pose[..., 1] = before.pose[..., 1] + (s * moved[..., 0] + c * moved[..., 1]).cumsum(axis=0)
    # Rotate the noise of each twist into the mid-step frame, then into the first start frame.
    middle = heading - 0.5 * moved[..., 2]
    turn = np.zeros_like(growth) + _POSE
    turn[..., 0, 0] = turn[..., 1, 1] = np.cos(middle)
    turn[..., 1, 0] = np.sin(middle)
    turn[..., 0, 1] = -turn[..., 1, 0]
    off = pose - before.pose
    back = np.zeros_like(growth) + _POSE
    back[..., 0, 2], back[..., 1, 2] = off[..., 1], -off[..., 0]
    shift = back @ turn
    ends_s = np.array([before.end_s, *(step.end_s for step in steps)])
    dt_s = np.diff(ends_s).reshape(-1, *(1,) * (growth.ndim - 1))
    grown = (dt_s * (shift @ growth @ _transposed(shift))).cumsum(axis=0)
    carry = 2.0 * _POSE - back
    noise_cov = carry @ (before.noise_cov + grown) @ _transposed(carry)
    bias_jacobian, cautious = [before.bias_jacobian] * len(steps), noise_cov
    if before.bias_jacobian.shape[-1]:
        twist_by = shift @ np.stack([step.twist_bias_jacobian for step in steps])
        bias_jacobian = carry @ (before.bias_jacobian + (dt_s * twist_by).cumsum(axis=0))
        twist = np.stack([step.twist for step in steps])
        square = np.square(_TWIST_MARGIN * twist)
        square[..., :2] = square[..., :1] + square[..., 1:2]
        doubt = twist_by @ _transposed(twist_by) + (shift * square[..., None, :]) @ _transposed(
            shift
        )
        grown = grown + _PERSIST_S * (dt_s * doubt).cumsum(axis=0)
        cautious = carry @ (before.cautious + grown) @ _transposed(carry)
    for i, step in enumerate(steps):
        step.pose, step.bias_jacobian = pose[i], bias_jacobian[i]
        step.noise_cov, step.cautious = noise_cov[i], cautious[i]


def _correct(step: _FilterStep, measurement: _Measurement) -> None:
    """Correct the state at the end of a step; Joseph form, which stays symmetric.

    The biases keep their prior, so the error remains a part linear in them plus process noise.
    """
    rows, pose = measurement.rows, step.pose
    off = measurement.value - pose @ rows.T
    heading = (rows == _HEADING).all(axis=-1)
    off[..., heading] = wrap(off[..., heading])
    innovation: Array = rows @ step.cautious @ rows.T + measurement.covariance
    crossed: Array = rows @ step.cautious
    if measurement.weighs_biases:
        by = rows @ step.bias_jacobian + measurement.bias_jacobian
        innovation = rows @ step.noise_cov @ rows.T + by @ _transposed(by) + measurement.covariance
        crossed = rows @ step.noise_cov + by @ _transposed(step.bias_jacobian)
    gain = _transposed(np.asarray(np.linalg.solve(innovation, crossed), dtype=float))
    keep = np.eye(3) - gain @ rows
    noise = gain @ measurement.covariance @ _transposed(gain)
    step.pose = pose + (gain @ off[..., None])[..., 0]
    step.bias_jacobian = keep @ step.bias_jacobian - gain @ measurement.bias_jacobian
    step.noise_cov = keep @ step.noise_cov @ _transposed(keep) + noise
    step.cautious = keep @ step.cautious @ _transposed(keep) + noise


def _transposed(matrices: Array) -> Array:
    return np.swapaxes(matrices, -1, -2)


class _TwistRecord(NamedTuple):
    """State of the odometry at the end of a step."""

    end_s: float
    reckoned: Array
    """(3,): pose integrated from the twists alone; headings are not wrapped."""
    shift: Array
    """(3, m): Jacobian of that pose with respect to the errors."""
    walk: Array
    """(3, 3): covariance of the random walk up to this time."""

    def towards(self, later: _TwistRecord, share: float) -> _TwistRecord:
        """Interpolate linearly towards a later record."""
        return _TwistRecord(
            self.end_s + share * (later.end_s - self.end_s),
            self.reckoned + share * (later.reckoned - self.reckoned),
            self.shift + share * (later.shift - self.shift),
            self.walk + share * (later.walk - self.walk),
        )


class DriftFilter:
    """Kalman filter for the pose at the time of the latest twist, and for twist biases.

    The integrated pose deviates by a random walk and, linearly, by the integrated twist errors.
    Neither changes in expectation, so the filter state is kept at the time of the latest measured
    pose, however late it arrives, and no step is recomputed.
    """

    def __init__(
        self, pose: SE2, sigma: Array, *, now_s: float = 0.0, memory_s: float = 1.0
    ) -> None:
        """`sigma` (m,) are standard deviations of the errors; the start pose is exact."""
        errors = len(sigma)
        self._state: Array = np.zeros(3 + errors)
        self._covariance: Array = np.diag(np.square(np.concatenate([np.zeros(3), sigma])))
        self._memory_s = memory_s
        start = np.array(pose.xy_heading, dtype=float)
        self._seen = _TwistRecord(now_s, start, np.zeros((3, errors)), np.zeros((3, 3)))
        self._past = deque([self._seen])

    @property
    def pose(self) -> SE2:
        """Estimated pose."""
        newest = self._past[-1]
        return SE2(newest.reckoned + self._off(newest.shift))

    @property
    def errors(self) -> Array:
        """(m,): estimated errors of the twist."""
        return self._state[3:]

    @property
    def error_covariance(self) -> Array:
        """(m, m): covariance of `errors`."""
        return self._covariance[3:, 3:]

    def advance(self, now_s: float, twist: Array, by_errors: Array, growth_per_s: Array) -> None:
        """Predict to `now_s` with the mean `twist` (3,) since the last time.

        The true twist is `twist + by_errors @ errors`, with `by_errors` (3, m), plus noise that
        adds `growth_per_s` (3, 3) to the pose covariance per second; all in the body frame.
        """
        last = self._past[-1]
        dt_s = now_s - last.end_s
        if not dt_s > 0.0:
            return
        moved = (SE2(last.reckoned) @ SE2.exp(dt_s * twist)).xy_heading
        reckoned = np.array([moved[0], moved[1], last.reckoned[2] + dt_s * twist[2]])
        way = reckoned - last.reckoned
        middle = last.reckoned[2] + 0.5 * way[2]
        c, s = np.cos(middle), np.sin(middle)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        step = dt_s * turn @ by_errors
        # A heading error rotates the whole displacement.
        step[:2] += np.outer([-way[1], way[0]], last.shift[2] + 0.5 * step[2])
        walk = last.walk + dt_s * turn @ growth_per_s @ turn.T
        self._past.append(_TwistRecord(now_s, reckoned, last.shift + step, walk))
        while len(self._past) > 2 and self._past[1].end_s <= now_s - self._memory_s:
            self._past.popleft()

    def fuse_pose(self, pose: SE2, covariance: Array, measured_s: float) -> bool:
        """Fuse a measured pose with a covariance (3, 3), in the order of measurement.

        Return False if it is older than the memory or the last pose, or not finite.
        """
        at_s = min(measured_s, self._past[-1].end_s)
        oldest_s = max(self._seen.end_s, self._past[0].end_s)
        if not (np.isfinite(pose.xy_heading).all() and at_s >= oldest_s):
            return False
        then = self._at(at_s)
        self._covariance[:3, :3] += then.walk - self._seen.walk
        self._seen, shift = then, then.shift
        rows = np.hstack([np.eye(3), shift])
        off = pose.xy_heading - then.reckoned - self._off(shift)
        off[2] = wrap(off[2])
        innovation = rows @ self._covariance @ rows.T + covariance
        gain = np.linalg.solve(innovation, rows @ self._covariance).T
        keep = np.eye(len(self._state)) - gain @ rows
        self._state = self._state + gain @ off
        self._covariance = keep @ self._covariance @ keep.T + gain @ covariance @ gain.T
        return True

    def _off(self, shift: Array) -> Array:
        return self._state[:3] + shift @ self._state[3:]

    def _at(self, at_s: float) -> _TwistRecord:
        after = bisect_left(self._past, at_s, key=lambda past: past.end_s)
        later = self._past[after]
        if after == 0:
            return later
        earlier = self._past[after - 1]
        return earlier.towards(later, (at_s - earlier.end_s) / (later.end_s - earlier.end_s))
