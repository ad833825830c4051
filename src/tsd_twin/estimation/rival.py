"""Poses that contradict an estimate, but not one another."""

from __future__ import annotations

import numpy as np

from tsd_twin.lie import SE2, Array, wrap

_LEAST = 10
_LONG_ENOUGH_S = 0.5


class Rival:
    """Whether what is refused is always the same place: then it is the estimate that is wrong.

    Only of a robot at rest: there is one place where it is.
    """

    def __init__(self, covariance: Array, gate: float) -> None:
        """`covariance` (3, 3) is that of the difference of two poses, `gate` a chi-square bound."""
        self._weight = np.linalg.inv(covariance)
        self._gate = gate
        self._first: tuple[SE2, float] | None = None
        self._count = 0

    def clear(self) -> None:
        """Forget what was heard: the estimate is right, or the robot moves."""
        self._first = None

    def persists(self, pose: SE2, at_s: float) -> bool:
        """Take in one more, seen at `at_s`, and return whether it is always the same place."""
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
