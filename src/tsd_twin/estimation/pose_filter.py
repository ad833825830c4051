"""Kalman filters of the pose: twists integrated, late measurements applied at the time they were
taken.

One filter takes poses and headings, the other also estimates constant errors of the twist.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from tsd_twin.kinematics import Kinematics
from tsd_twin.lie import SE2, Array, wrap

_POSITION = np.eye(3)[:2]
_HEADING = np.eye(3)[2:]
_POSE = np.eye(3)


@dataclass(frozen=True, slots=True, eq=False)
class _Measurement:
    """`value` (..., j) of the parts of the pose that `rows` (j, 3) picks, with a covariance."""

    rows: Array
    value: Array
    covariance: Array


@dataclass(slots=True, eq=False)
class _Step:
    """What drives the filter up to one time, what is measured there, and what comes of it."""

    end_s: float
    twist: Array
    moved: Array
    """(..., 3): the way of the step, seen from its begin; it does not depend on the pose there."""
    growth_per_s: Array
    pose: Array
    covariance: Array
    measured: list[_Measurement] = field(default_factory=list[_Measurement])

    def correct(self) -> None:
        """Take in what is measured at the end."""
        for measurement in self.measured:
            self.pose, self.covariance = _corrected(self.pose, self.covariance, measurement)


class PoseFilter:
    """Pose and covariance in the world, at the time of the newest twist.

    All arrays may have leading batch dimensions, the same for all. Times are seconds of one clock
    and rise from twist to twist.
    """

    def __init__(
        self,
        kinematics: Kinematics[SE2],
        pose: SE2,
        covariance: Array | None = None,
        *,
        now_s: float = 0.0,
        memory_s: float = 1.0,
    ) -> None:
        self._kinematics = kinematics
        self._memory_s = memory_s
        start = np.array(pose.xy_heading, dtype=float)
        spread = np.zeros((*start.shape, 3)) if covariance is None else np.array(covariance)
        none = np.zeros_like(start)
        self._steps = [_Step(now_s, none, none, np.zeros((*start.shape, 3)), start, spread)]
        self._still = SE2.identity(start.shape[:-1])

    @property
    def now_s(self) -> float:
        """Time of the newest twist."""
        return self._steps[-1].end_s

    @property
    def oldest_s(self) -> float:
        """What was measured before this time comes too late."""
        return self._steps[0].end_s

    @property
    def measurements(self) -> int:
        """How many measurements the memory holds; the work of a late one grows with it."""
        return sum(len(step.measured) for step in self._steps)

    def newer(self, measured_s: float) -> int:
        """Return at how many later times something was measured: each is run over again."""
        return sum(bool(step.measured) for step in self._steps[self._index(measured_s) + 1 :])

    @property
    def pose(self) -> SE2:
        """The estimate."""
        return SE2(self._steps[-1].pose)

    @property
    def covariance(self) -> Array:
        """(..., 3, 3): of x, y, heading."""
        return self._steps[-1].covariance

    def advance(self, now_s: float, twist: Array, growth_per_s: Array) -> None:
        """Move on to `now_s` with the mean `twist` (..., 3) since the last time.

        `growth_per_s` (..., 3, 3) is what a second of such twists adds to the covariance of a pose,
        in the body frame: of white noise with the covariance S in each sample of dt, S times dt.
        """
        if not now_s > self.now_s:
            return
        last = self._steps[-1]
        growth = np.zeros_like(last.covariance) + growth_per_s
        self._steps.append(self._step(last, now_s, np.array(twist), growth))
        self._run(len(self._steps) - 1)
        # One step older than the memory stays: what happened since is what is between.
        oldest = now_s - self._memory_s
        while len(self._steps) > 2 and self._steps[1].end_s <= oldest:
            del self._steps[0]

    def fuse_heading(self, heading: Array, sigma: float, measured_s: float | None = None) -> bool:
        """Take in headings (...), radians; False: older than the memory, or not finite."""
        value = np.asarray(heading, dtype=float)[..., None]
        return self._fuse(_Measurement(_HEADING, value, np.array([[sigma**2]])), measured_s)

    def fuse_position(self, xy: Array, sigma_m: float, measured_s: float | None = None) -> bool:
        """Take in positions (..., 2), metres; False: as in `fuse_heading`."""
        covariance = sigma_m**2 * np.eye(2)
        return self._fuse(
            _Measurement(_POSITION, np.array(xy, dtype=float), covariance), measured_s
        )

    def fuse_pose(self, pose: SE2, covariance: Array, measured_s: float | None = None) -> bool:
        """Take in outside poses with a covariance (..., 3, 3); False: as in `fuse_heading`."""
        value = np.array(pose.xy_heading, dtype=float)
        return self._fuse(_Measurement(_POSE, value, np.array(covariance)), measured_s)

    def mahalanobis_sq(self, pose: SE2, covariance: Array, measured_s: float) -> Array:
        """Return how far (...) outside poses are from what was expected of them at that time.

        The squared Mahalanobis distance: chi-square of three dimensions when all is as claimed.
        The filter is left as it is. Times are those that can be fused.
        """
        index = self._index(min(measured_s, self.now_s))
        step = self._steps[index]
        if step.end_s < measured_s and index + 1 < len(self._steps):
            later = self._steps[index + 1]
            step = self._step(step, measured_s, later.twist, later.growth_per_s)
            _carry(self._steps[index], [step])
        off = pose.xy_heading - step.pose
        off[..., 2] = wrap(off[..., 2])
        expected = step.covariance + covariance
        weighed = np.asarray(np.linalg.solve(expected, off[..., None]), dtype=float)
        return (off * weighed[..., 0]).sum(axis=-1)

    def _index(self, at_s: float) -> int:
        """Return the last step that ends at `at_s` or before."""
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
            step = self._steps[0]
            step.pose, step.covariance = _corrected(step.pose, step.covariance, measurement)
            index = 1
        self._run(index)
        return True

    def _split(self, index: int, at_s: float) -> None:
        """Cut the step at `index` in two: a first that ends at `at_s`, and the rest."""
        whole = self._steps[index]
        twist, growth = whole.twist, whole.growth_per_s
        first = self._step(self._steps[index - 1], at_s, twist, growth)
        rest = self._step(first, whole.end_s, twist, growth)
        rest.measured = whole.measured
        self._steps[index : index + 1] = [first, rest]

    def _step(self, before: _Step, end_s: float, twist: Array, growth_per_s: Array) -> _Step:
        """Return a step from the end of another, which has still to be run."""
        moved = self._kinematics.integrate(self._still, twist, end_s - before.end_s).xy_heading
        return _Step(end_s, twist, moved, growth_per_s, before.pose, before.covariance)

    def _run(self, index: int) -> None:
        """Run over all steps from `index` on: in one go up to the next that has a measurement."""
        while index < len(self._steps):
            end = index + 1
            while end < len(self._steps) and not self._steps[end - 1].measured:
                end += 1
            _carry(self._steps[index - 1], self._steps[index:end])
            self._steps[end - 1].correct()
            index = end


def _carry(before: _Step, steps: Sequence[_Step]) -> None:
    """Carry pose and covariance from the end of a step over the ways of those that follow.

    All at once: what is measured late is followed by up to a second of steps.
    """
    moved = np.stack([step.moved for step in steps])
    growth = np.stack([step.growth_per_s for step in steps])
    heading = before.pose[..., 2] + moved[..., 2].cumsum(axis=0)
    begin = heading - moved[..., 2]
    c, s = np.cos(begin), np.sin(begin)
    pose = np.stack([moved[..., 0], moved[..., 1], heading], axis=-1)
    pose[..., 0] = before.pose[..., 0] + (c * moved[..., 0] - s * moved[..., 1]).cumsum(axis=0)
    pose[..., 1] = before.pose[..., 1] + (s * moved[..., 0] + c * moved[..., 1]).cumsum(axis=0)
    # The noise of each twist, seen from the middle of its way, then from where all began.
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
    grown = before.covariance + (dt_s * (shift @ growth @ _transposed(shift))).cumsum(axis=0)
    carry = 2.0 * _POSE - back
    covariance = carry @ grown @ _transposed(carry)
    for i, step in enumerate(steps):
        step.pose, step.covariance = pose[i], covariance[i]


def _corrected(pose: Array, covariance: Array, measurement: _Measurement) -> tuple[Array, Array]:
    """Return pose and covariance after a measurement, in Joseph's form: it stays symmetric."""
    rows = measurement.rows
    off = measurement.value - pose @ rows.T
    heading = rows[:, 2] != 0.0
    off[..., heading] = wrap(off[..., heading])
    innovation: Array = rows @ covariance @ rows.T + measurement.covariance
    gain = _transposed(np.asarray(np.linalg.solve(innovation, rows @ covariance), dtype=float))
    keep = np.eye(3) - gain @ rows
    corrected = keep @ covariance @ _transposed(keep)
    corrected = corrected + gain @ measurement.covariance @ _transposed(gain)
    return pose + (gain @ off[..., None])[..., 0], corrected


def _transposed(matrices: Array) -> Array:
    return np.swapaxes(matrices, -1, -2)


class _TwistRecord(NamedTuple):
    """The end of a step."""

    end_s: float
    reckoned: Array
    """(3,): the pose by the twists alone; headings count on."""
    shift: Array
    """(3, m): how the pose there depends on the errors."""
    walk: Array
    """(3, 3): covariance of the random walk up to there."""

    def towards(self, later: _TwistRecord, share: float) -> _TwistRecord:
        """Return what is in between, `share` of the way to a later end."""
        return _TwistRecord(
            self.end_s + share * (later.end_s - self.end_s),
            self.reckoned + share * (later.reckoned - self.reckoned),
            self.shift + share * (later.shift - self.shift),
            self.walk + share * (later.walk - self.walk),
        )


class DriftFilter:
    """Pose in the world at the time of the newest twist, and the constant errors of all twists.

    The pose that twists add up to is off by a random walk, and by what their errors add up to,
    which is linear in them. Neither is expected to change, so the Kalman filter stands at the time
    of the newest pose from outside, however late that comes: nothing has to be run again.
    """

    def __init__(
        self, pose: SE2, sigma: Array, *, now_s: float = 0.0, memory_s: float = 1.0
    ) -> None:
        """`sigma` (m,) are standard deviations of the errors; the start is exact."""
        errors = len(sigma)
        self._state: Array = np.zeros(3 + errors)
        self._covariance: Array = np.diag(np.square(np.concatenate([np.zeros(3), sigma])))
        self._memory_s = memory_s
        start = np.array(pose.xy_heading, dtype=float)
        self._seen = _TwistRecord(now_s, start, np.zeros((3, errors)), np.zeros((3, 3)))
        self._past = deque([self._seen])

    @property
    def pose(self) -> SE2:
        """The estimate."""
        newest = self._past[-1]
        return SE2(newest.reckoned + self._off(newest.shift))

    @property
    def errors(self) -> Array:
        """(m,): as they are known by now."""
        return self._state[3:]

    @property
    def error_covariance(self) -> Array:
        """(m, m): of `errors`."""
        return self._covariance[3:, 3:]

    def advance(self, now_s: float, twist: Array, by_errors: Array, growth_per_s: Array) -> None:
        """Move on to `now_s` with the mean `twist` (3,) since the last time.

        It is truly `twist + by_errors @ errors`, with `by_errors` (3, m), and noise of which a
        second adds `growth_per_s` (3, 3) to the covariance of a pose; all in the body frame.
        """
        last = self._past[-1]
        dt_s = now_s - last.end_s
        if not dt_s > 0.0:
            return
        moved = (SE2(last.reckoned) @ SE2.exp(dt_s * twist)).xy_heading
        reckoned = np.array([moved[0], moved[1], last.reckoned[2] + dt_s * twist[2]])
        way = reckoned - last.reckoned
        turn = np.eye(3)
        turn[:2, :2] = _turn(last.reckoned[2] + 0.5 * way[2])
        step = dt_s * turn @ by_errors
        # A heading that is off turns all of the way.
        step[:2] += np.outer([-way[1], way[0]], last.shift[2] + 0.5 * step[2])
        walk = last.walk + dt_s * turn @ growth_per_s @ turn.T
        self._past.append(_TwistRecord(now_s, reckoned, last.shift + step, walk))
        while len(self._past) > 2 and self._past[1].end_s <= now_s - self._memory_s:
            self._past.popleft()

    def fuse_pose(self, pose: SE2, covariance: Array, measured_s: float) -> bool:
        """Take in an outside pose with a covariance (3, 3); poses come in the order of their times.

        Return False if it is older than the memory or than the last one, or not finite.
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


def _turn(angle_rad: float) -> Array:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s], [s, c]])
