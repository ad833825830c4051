"""Goals of undriven gimbals: torque only near neutral, and a slow approach. Pure.

For servos connected to the PC; gimbals.c and approach.c have the same rules for the board.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

NEAR_STEPS = 100
"""Maximum distance from neutral for torque; a typo would drive a servo into its stop."""
SLOW_STEPS_PER_S = 1000.0 / 3.0
"""29 degrees per second."""
RUN_DOWN_S = 2.0
"""Maximum time that wheels spin after the robot was last armed."""
_LONGEST_S = 0.1
"""Maximum step time, so that goals do not jump after a pause."""


class Approach:
    """Latest goals of the servos, in steps from neutral; time is an argument."""

    def __init__(self, count: int) -> None:
        self.far = (1 << count) - 1
        """Mask of servos that have not been near neutral yet."""
        self._goals = [0.0] * count
        self._armed_s = self._stepped_s = -math.inf

    def see(self, servo: int, steps: int, *, holds: bool) -> None:
        """Record a measured position, which becomes the goal unless the servo holds torque."""
        if abs(steps) <= NEAR_STEPS:
            self.far &= ~(1 << servo)
        if not holds:
            self._goals[servo] = float(steps)

    def step(self, wanted: Sequence[int], now_s: float, *, armed: bool) -> list[int]:
        """Return the next goals towards `wanted`; slow if the wheels are at rest."""
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
