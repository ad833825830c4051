"""Whether a camera and the wheels tell of the same motion, as far as wheels can be trusted yet."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque

import numpy as np

from tsd_twin.lie import SE2, Array, wrap

WINDOW_S = 0.5
"""What is compared is how the robot has moved for so long."""
APART_M, APART_RAD = 0.15, 0.5
"""Gimbals that are off by half a degree make 0.05 m and 0.3 rad of it, noise of a camera less."""
_MEMORY_S = 3.0


class Agreement:
    """Compares motion that is seen with motion that is reckoned from the joints.

    A view that has frozen, leaps, is mirrored or turned would lead a robot anywhere: to a guide it
    looks as if the robot did not do what it is told.
    """

    def __init__(self) -> None:
        self._reckoned: deque[tuple[float, SE2]] = deque()
        self._seen: deque[tuple[float, SE2, SE2]] = deque()

    def move(self, now_s: float, twist: Array) -> None:
        """Take in the body twist (3,) until `now_s`; times rise."""
        before_s, before = self._reckoned[-1] if self._reckoned else (now_s, SE2.identity())
        self._reckoned.append((now_s, before @ SE2.exp(twist * (now_s - before_s))))
        while self._reckoned[0][0] < now_s - _MEMORY_S:
            self._reckoned.popleft()

    def see(self, pose: SE2, seen_s: float) -> str:
        """Take in where it was seen; return what does not agree, "" if it does."""
        reckoned = self._at(seen_s)
        if reckoned is None:
            return ""
        self._seen.append((seen_s, pose, reckoned))
        while len(self._seen) > 1 and self._seen[1][0] <= seen_s - WINDOW_S:
            self._seen.popleft()
        _, pose_then, reckoned_then = self._seen[0]
        by_camera = (pose_then.inverse() @ pose).xy_heading
        by_wheels = (reckoned_then.inverse() @ reckoned).xy_heading
        apart_m = math.dist(by_camera[:2], by_wheels[:2])
        apart_rad = abs(float(wrap(by_camera[2] - by_wheels[2])))
        if apart_m <= APART_M and apart_rad <= APART_RAD:
            return ""
        return (
            f"camera and wheels disagree by {apart_m:.2f} m and {math.degrees(apart_rad):.0f} "
            f"degrees about the last {WINDOW_S:g} s"
        )

    def _at(self, seen_s: float) -> SE2 | None:
        """Return the reckoned pose at a time, None before the memory begins."""
        index = bisect_right(self._reckoned, seen_s, key=lambda each: each[0])
        if index == 0:
            return None
        before_s, before = self._reckoned[index - 1]
        if index == len(self._reckoned):
            return before
        after_s, after = self._reckoned[index]
        share = (seen_s - before_s) / (after_s - before_s)
        step = np.array((before.inverse() @ after).log())
        return before @ SE2.exp(share * step)
