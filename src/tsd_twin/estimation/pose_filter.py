"""Kalman filter for the pose: integrates twists, and applies late measurements at their stamps.

It fuses poses and headings, and considers biases (Schmidt-Kalman).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field

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

        The distance from the estimate is the smaller of two, by the filter's covariance and by the
        covariance assumed for the gains, so its distribution is at most chi-square with three
        degrees of freedom. If the change since an earlier measured pose contradicts the twists
        more, its distance is returned. The filter is not changed. `measured_s` must be within the
        memory; `bias_jacobian` as in `fuse_pose`.
        """
        index = self._index(min(measured_s, self.now_s))
        steps = self._steps[: index + 1]
        if steps[-1].end_s < measured_s and index + 1 < len(self._steps):
            steps.append(self._part(steps[-1], measured_s, self._steps[index + 1]))
            _carry(steps[-2], steps[-1:])
        step = steps[-1]
        by_biases = self._none if bias_jacobian is None else bias_jacobian
        by = step.bias_jacobian + by_biases
        claimed = step.noise_cov + by @ _transposed(by)
        off = exponential_error(SE2(step.pose), pose)
        distance_sq = _distance_sq(off, np.stack([claimed, step.cautious]) + covariance)
        now = _Measurement(_POSE, pose.xy_heading, covariance, by_biases)
        return np.maximum(distance_sq.min(axis=0), _change_sq(steps, now))

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
_SLIP = 0.1
"""Relative error of a displacement assumed by the gate, in addition to the described errors."""


@dataclass(frozen=True, slots=True, eq=False)
class _Reckoning:
    """Motion and errors of the twists over steps, each from the same start to the step's end."""

    dt_s: Array
    off: Array
    """(n, ..., 3): displacement, axes of the world."""
    carry: Array
    """(n, ..., 3, 3): effect of an error of the start on the end."""
    shift: Array
    """(n, ..., 3, 3): error of the start that has the effect of an error of the step's twist."""
    twist_by: Array
    """(n, ..., 3, m): Jacobian of each step's twist w.r.t. the biases, as an error of the start."""
    grown: Array
    """(n, ..., 3, 3): covariance of the noise, as an error of the start."""

    @property
    def by_biases(self) -> Array:
        """(n, ..., 3, m): Jacobian of the displacement, as an error of the start."""
        return (self.dt_s * self.twist_by).cumsum(axis=0)


def _reckon(start_s: float, heading: Array, steps: Sequence[_FilterStep]) -> _Reckoning:
    """Integrate the twists of `steps` from a `heading` (...) at `start_s`."""
    moved = np.array([step.moved for step in steps])
    growth = np.array([step.growth_per_s for step in steps])
    x_m, y_m, turned = moved[..., 0], moved[..., 1], moved[..., 2]
    heading = heading + turned.cumsum(axis=0)
    begin = heading - turned
    c, s = np.cos(begin), np.sin(begin)
    off = np.empty_like(moved)
    off[..., 0], off[..., 1], off[..., 2] = c * x_m - s * y_m, s * x_m + c * y_m, turned
    off = off.cumsum(axis=0)
    # Rotate the noise of each twist into the mid-step frame, then into the first start frame.
    middle = heading - 0.5 * turned
    shift = _lever(-off)
    shift[..., 0, 0] = shift[..., 1, 1] = np.cos(middle)
    shift[..., 1, 0] = np.sin(middle)
    shift[..., 0, 1] = -shift[..., 1, 0]
    ends_s = np.array([start_s, *(step.end_s for step in steps)])
    dt_s = (ends_s[1:] - ends_s[:-1]).reshape(-1, *(1,) * (growth.ndim - 1))
    grown = (dt_s * (shift @ growth @ _transposed(shift))).cumsum(axis=0)
    twist_by = shift @ np.array([step.twist_bias_jacobian for step in steps])
    return _Reckoning(dt_s, off, _lever(off), shift, twist_by, grown)


def _lever(off: Array) -> Array:
    """Return the effect (..., 3, 3) of a pose error after a displacement `off` (..., 3)."""
    lever = np.zeros((*off.shape, 3)) + _POSE
    lever[..., 0, 2], lever[..., 1, 2] = -off[..., 1], off[..., 0]
    return lever


def _carry(before: _FilterStep, steps: Sequence[_FilterStep]) -> None:
    """Propagate pose and covariance from the end of `before` over the following `steps`.

    Batched, because up to a second of steps follows a late measurement.
    """
    reckoned = _reckon(before.end_s, before.pose[..., 2], steps)
    pose = before.pose + reckoned.off
    carry, grown = reckoned.carry, reckoned.grown
    noise_cov = carry @ (before.noise_cov + grown) @ _transposed(carry)
    bias_jacobian, cautious = [before.bias_jacobian] * len(steps), noise_cov
    if before.bias_jacobian.shape[-1]:
        bias_jacobian = carry @ (before.bias_jacobian + reckoned.by_biases)
        shift, twist_by, dt_s = reckoned.shift, reckoned.twist_by, reckoned.dt_s
        twist = np.array([step.twist for step in steps])
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


def _change_sq(steps: Sequence[_FilterStep], now: _Measurement) -> Array:
    """Return the squared Mahalanobis distance (...) of the change since an earlier measured pose.

    `now` is measured at the end of `steps`. For each earlier pose, the change is compared with the
    motion by the twists since then, whose errors are constant. Returns the distance from the latest
    pose whose repetition would be rejected, or 0 without such a pose. All poses have the same
    covariance and biases, because they come from the same sensor.
    """
    poses = [(i, each) for i, step in enumerate(steps[:-1]) for each in step.measured]
    poses = [(i, each.value) for i, each in poses if each.rows is _POSE]
    if not poses:
        return np.zeros(now.value.shape[:-1])
    places, seen = [i for i, _ in poses], np.stack([value for _, value in poses])
    start = steps[0].pose
    way = _reckon(steps[0].end_s, start[..., 2], steps[1:])

    def since(values: Array) -> Array:
        return values[-1] - np.concatenate([np.zeros_like(values[:1]), values])[places]

    end, off = SE2(start + way.off[-1]), since(way.off)
    expected = SE2(seen) @ (SE2(end.xy_heading - off).inverse() @ end)
    still, changed = (exponential_error(expected, SE2(each)) for each in (seen, now.value))
    carry, carry_start = _lever(off), way.carry[-1]
    by = (_POSE - carry) @ now.bias_jacobian + carry_start @ since(way.by_biases)
    slipped = np.square(_SLIP * still)
    slipped[..., :2] = slipped[..., :1] + slipped[..., 1:2]
    covariance = carry @ now.covariance @ _transposed(carry) + now.covariance
    covariance = covariance + by @ _transposed(by) + slipped[..., None] * _POSE
    covariance += carry_start @ since(way.grown) @ _transposed(carry_start)
    is_rejected = _distance_sq(still, covariance) > GATE
    latest = len(poses) - 1 - np.argmax(is_rejected[::-1], axis=0)
    distance_sq = np.where(is_rejected, _distance_sq(changed, covariance), 0.0)
    return np.take_along_axis(distance_sq, latest[None], axis=0)[0]


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


def _distance_sq(off: Array, covariance: Array) -> Array:
    """Return the squared Mahalanobis distance of `off` (..., 3), for covariances (..., 3, 3)."""
    weighed = np.asarray(np.linalg.solve(covariance, off[..., None]), dtype=float)
    return np.asarray((off * weighed[..., 0]).sum(axis=-1))


def _transposed(matrices: Array) -> Array:
    return matrices.swapaxes(-1, -2)
