"""Goals of gimbals that nobody drives: torque near neutral only, and a slow approach. Pure.

For servos at the computer; the board has the same rules in gimbals.c and approach.c.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

NEAR_STEPS = 100
"""A servo further from its neutral position gets no torque: a typo would turn it into its stop."""
SLOW_STEPS_PER_S = 1000.0 / 3.0
"""29 degrees per second."""
RUN_DOWN_S = 2.0
"""Wheels may spin for this long after the robot was last armed."""
_LONGEST_S = 0.1
"""Time of one step at most: after a pause, goals do not jump."""


class Approach:
    """Newest goals of some servos, steps from neutral; time is an argument."""

    def __init__(self, count: int) -> None:
        self.far = (1 << count) - 1
        """Mask of servos that were not near neutral yet."""
        self._goals = [0.0] * count
        self._armed_s = self._stepped_s = -math.inf

    def see(self, servo: int, steps: int, *, holds: bool) -> None:
        """Note a measured position; a servo that does not hold stays there when it gets torque."""
        if abs(steps) <= NEAR_STEPS:
            self.far &= ~(1 << servo)
        if not holds:
            self._goals[servo] = float(steps)

    def step(self, wanted: Sequence[int], now_s: float, *, armed: bool) -> list[int]:
        """Return the goals for now: slow on the way to `wanted` if wheels are at rest."""
        if armed:
            self._armed_s = now_s
        slow = now_s - self._armed_s >= RUN_DOWN_S
        most = SLOW_STEPS_PER_S * min(now_s - self._stepped_s, _LONGEST_S) if slow else math.inf
        self._stepped_s = now_s
        self._goals = [
            goal + min(max(to - goal, -most), most)
            for goal, to in zip(self._goals, wanted, strict=True)
        ]
        return [round(goal) for goal in self._goals]
