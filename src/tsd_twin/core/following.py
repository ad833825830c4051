"""Whether gimbals go where they are told: one that sticks pushes for as long as its wheel spins."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from tsd_twin.core.estimator import NEUTRAL_RAD
from tsd_twin.lie import Array

ASIDE_RAD = NEUTRAL_RAD
"""What is too far from neutral to arm is too far to go on; more than what load does to a servo."""
REMEMBERED_S = 0.3
"""What a servo was told longer ago it has done, or never will."""
PATIENCE_S = 0.7
"""For so long a gimbal may be away from all that: a second in all, from when it sticks."""


class Following:
    """Compares where joints are with everything that they were told lately, so lag is no fault."""

    def __init__(self, names: Sequence[str]) -> None:
        """Take the names of the joints that are looked at, in their order."""
        self._names = names
        self._told: deque[tuple[float, Array]] = deque()
        self._since_s: Array | None = None

    def forget(self) -> None:
        """Begin anew: nobody tells them anything that counts."""
        self._told.clear()
        self._since_s = None

    def step(self, now_s: float, told: Array, measured: Array) -> str:
        """Return which joint has not followed for too long and how far it is off; "" if none.

        `told` (k,) and `measured` (k,) are angles in radians; what is not finite says nothing.
        """
        while self._told and now_s - self._told[0][0] > REMEMBERED_S:
            self._told.popleft()
        self._told.append((now_s, told))
        if not any(np.abs(measured - told) > ASIDE_RAD):
            self._since_s = None
            return ""
        lately = np.array([angles for _, angles in self._told])
        nearest = np.clip(measured, lately.min(axis=0), lately.max(axis=0))
        aside = np.abs(measured - nearest) > ASIDE_RAD
        if self._since_s is None:
            self._since_s = np.full(len(told), np.inf)
        self._since_s = np.where(aside, np.minimum(self._since_s, now_s), np.inf)
        worst = int(np.argmin(self._since_s))
        if now_s - self._since_s[worst] < PATIENCE_S:
            return ""
        off_deg = float(np.degrees(measured[worst] - told[worst]))
        return f"{self._names[worst]} does not follow: it is {off_deg:+.1f}° from where it was told"
