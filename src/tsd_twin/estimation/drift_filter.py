"""Kalman filter for the pose and constant biases of the twist, at the time of the latest pose."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from typing import NamedTuple

import numpy as np

from tsd_twin.lie import SE2, Array, wrap


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
