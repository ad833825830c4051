"""An estimate that poses from outside correct for as long as they come."""

from __future__ import annotations

import math
from collections import deque
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from tsd_twin.drives import Drive, Motion
from tsd_twin.estimation.odometry import CORRELATION_S
from tsd_twin.estimation.parity import FALSE_ALARM, chi_square_bound
from tsd_twin.estimation.pose_filter import PoseFilter
from tsd_twin.estimation.rival import Rival
from tsd_twin.estimation.second import Estimate
from tsd_twin.lie import SE2, Array, wrap
from tsd_twin.robots import OutsidePose

MEMORY_S = 1.0
"""Poses that come later than this are of no use."""
MOST = 128
"""Outside poses within the memory."""
MOST_NEWER = 16
"""A pose that comes after so many that were seen later tells nothing that they do not, and the work
for it, which is to run over them again, is bounded."""
_PATIENCE_S = 2.0
"""When none has come for so long, the estimate goes on without."""
_FARTHEST_M = 1e6
"""Beyond, squares lose what they are compared with."""
_STEPS_KEPT = 128
_GATE = chi_square_bound(3, FALSE_ALARM)


class Fate(StrEnum):
    """What becomes of an outside pose."""

    USED = "used"
    FOUND = "found"
    """The robot was somewhere else; the estimate begins anew there."""
    OLD = "old"
    FLOOD = "flood"
    FAR = "far"
    """Farther from the estimate than what both claim to know, one in 10,000 excepted."""


class _Past(NamedTuple):
    """A step of the inner estimate, and where it was after it."""

    end_s: float
    motion: Motion
    twist_covariance: Array
    pose: SE2
    pose_covariance: Array


class CorrectedEstimate:
    """An estimate of a robot on a floor, its pose corrected by what others see of the robot.

    The twist is that of the inner estimate, always: a pose that jumps moves no velocity. While
    nobody sends poses, this is the inner estimate, and nothing is computed.
    """

    def __init__(self, drive: Drive[SE2], inner: Estimate, noise: OutsidePose) -> None:
        self.inner = inner
        self._drive = drive
        sigma = np.array([noise.sigma_m, noise.sigma_m, math.radians(noise.sigma_deg)])
        self._noise = np.diag(np.square(sigma))
        self._past: deque[_Past] = deque(maxlen=_STEPS_KEPT)
        self._filter: PoseFilter | None = None
        self._heard_s = -math.inf
        self._rival = Rival(2.0 * self._noise, _GATE)

    @property
    def is_corrected(self) -> bool:
        """Whether somebody has sent poses lately."""
        return self._filter is not None

    @property
    def pose(self) -> Any:
        """The pose in `odom`."""
        return self.inner.pose if self._filter is None else self._filter.pose

    @property
    def pose_covariance(self) -> Array:
        """(3, 3): of the pose, in `odom`."""
        return self.inner.pose_covariance if self._filter is None else self._filter.covariance

    @property
    def motion(self) -> Motion:
        """The twist in `base_link`, and what it leaves unexplained."""
        return self.inner.motion

    @property
    def twist_covariance(self) -> Array:
        """(3, 3): of the twist, in `base_link`."""
        return self.inner.twist_covariance

    def set_pose(self, pose: Any, covariance: Array | None = None) -> None:
        """Take the robot to be at `pose`; what others saw before is of the past."""
        self.inner.set_pose(pose, covariance)
        self._past.clear()
        self._filter = None

    def follow(self, now_s: float) -> None:
        """Take in that the inner estimate has moved on to `now_s`."""
        inner = self.inner
        covariance = inner.twist_covariance
        self._past.append(_Past(now_s, inner.motion, covariance, inner.pose, inner.pose_covariance))
        if self._filter is None:
            return
        self._filter.advance(now_s, inner.motion.twist, covariance * CORRELATION_S)
        if now_s - self._heard_s > _PATIENCE_S:
            self.inner.set_pose(self._filter.pose, self._filter.covariance)
            self._past.clear()
            self._filter = None

    def fuse(self, pose: SE2, measured_s: float, *, at_rest: bool) -> Fate:
        """Take in a pose that was seen at `measured_s`, and say what became of it.

        A robot that is at rest is found again where many poses, one like the other, say it is.
        """
        if self._filter is None and not self._past:
            return Fate.OLD
        running = self._filter = self._filter or self._caught_up()
        now_s = self._heard_s = running.now_s
        at_s = min(measured_s, now_s)
        if not at_s >= max(running.oldest_s, now_s - MEMORY_S):
            return Fate.OLD
        if running.newer(at_s) > MOST_NEWER:
            return Fate.OLD
        if running.measurements >= MOST:
            return Fate.FLOOD
        if not np.abs(pose.xy_heading).max() <= _FARTHEST_M:
            return Fate.FAR
        if float(running.surprise(pose, self._noise, at_s)) <= _GATE:
            self._rival.clear()
            running.fuse_pose(pose, self._noise, at_s)
            return Fate.USED
        if at_rest and self._rival.persists(pose, at_s):
            self._begin_anew(running, pose, at_s)
            return Fate.FOUND
        if not at_rest:
            self._rival.clear()
        return Fate.FAR

    def _caught_up(self) -> PoseFilter:
        """Return the filter as if it had run all the time."""
        first, *others = self._past
        made = PoseFilter(
            self._drive,
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
        self._filter = PoseFilter(self._drive, pose, self._noise, now_s=at_s, memory_s=MEMORY_S)
        # It is at rest: it has been there ever since.
        self._filter.advance(old.now_s, np.zeros(3), np.zeros((3, 3)))
