"""Hypothesis about the pose of a robot, from measured poses that its estimate does not use."""

from __future__ import annotations

import numpy as np

from tsd_twin.estimation.consistency import FALSE_ALARM, chi_square_bound
from tsd_twin.estimation.pose_filter import PoseFilter
from tsd_twin.lie import SE2, Array, wrap

GATE = chi_square_bound(3, FALSE_ALARM)
"""Squared Mahalanobis distance of three numbers that one right pose in 10,000 exceeds."""
_VOTES = 10
_LONG_ENOUGH_S = 0.5
_MOVED = 4.0 * GATE
"""Squared distance of two poses in units of their noise, for which the picture has moved: twice the
distance that noise explains."""


class PoseHypothesis:
    """Hypothesis that rejected poses are right: a filter of its own that fuses them.

    Each pose that agrees with the filter, and so with the poses before it and with the odometry in
    between, is a vote for the hypothesis; each other one is a vote against it. Without votes it is
    over: the majority vote of Boyer and Moore (1981), which poses that jump alone cannot win.
    """

    def __init__(
        self, pose_filter: PoseFilter, pose: SE2, at_s: float, *, against_founded: bool
    ) -> None:
        """`pose_filter` begins at `pose`, measured at `at_s`."""
        self.filter = pose_filter
        self.against_founded = against_founded
        """Whether the estimate was well-founded when the hypothesis began."""
        self._first, self._first_s = pose, at_s
        self._votes = 1

    def age_s(self, at_s: float) -> float:
        """Return the time since the first pose."""
        return at_s - self._first_s

    def vote(self, pose: SE2, covariance: Array, by_constants: Array, at_s: float) -> bool:
        """Fuse a pose if it agrees, and return whether it does; the arguments as in `fuse_pose`."""
        if not at_s >= self.filter.oldest_s:
            return False
        if float(self.filter.mahalanobis_sq(pose, covariance, at_s, by_constants)) > GATE:
            self._votes -= 1
            return False
        self.filter.fuse_pose(pose, covariance, at_s, by_constants)
        self._votes = min(self._votes + 1, _VOTES)  # So a long-lived one can be outvoted soon.
        return True

    def vote_against(self) -> None:
        """Count a pose that agrees with the estimate."""
        self._votes -= 1

    @property
    def is_over(self) -> bool:
        """Whether as many poses have disagreed as agreed."""
        return self._votes <= 0

    def persists(self, at_s: float) -> bool:
        """Return whether enough poses have agreed for long enough."""
        return self._votes >= _VOTES and self.age_s(at_s) >= _LONG_ENOUGH_S

    def has_moved(self, pose: SE2, covariance: Array) -> bool:
        """Return whether `pose` differs from the first by more than noise: the picture moves."""
        off = pose.xy_heading - self._first.xy_heading
        off[2] = wrap(off[2])
        return float(off @ np.linalg.solve(2.0 * covariance, off)) > _MOVED
