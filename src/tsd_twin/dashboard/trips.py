"""How long messages take there and back, and how evenly."""

from __future__ import annotations

import math
from collections import deque

KEPT = 40
"""Round trips that count: the last ten seconds."""


class RoundTrips:
    """The newest round trips; written by one thread, read by any."""

    def __init__(self) -> None:
        self._trips_s: deque[float] = deque(maxlen=KEPT)

    def add(self, trip_s: float) -> None:
        """Take in one."""
        self._trips_s.append(trip_s)

    def forget(self) -> None:
        """There was no answer: nothing is known any more."""
        self._trips_s.clear()

    def typical_s(self) -> float | None:
        """Return the median, None when nothing is known."""
        return self._quantile(0.5)

    def late_s(self) -> float | None:
        """Return what one in twenty exceeds, None when nothing is known."""
        return self._quantile(0.95)

    def jitter_s(self) -> float | None:
        """Return how much longer than usual one in twenty takes, None when nothing is known."""
        typical_s, late_s = self.typical_s(), self.late_s()
        return None if typical_s is None or late_s is None else late_s - typical_s

    def _quantile(self, share: float) -> float | None:
        ordered = sorted(self._trips_s)
        if not ordered:
            return None
        return ordered[max(0, math.ceil(share * len(ordered)) - 1)]
