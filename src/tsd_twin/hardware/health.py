"""How well a line works, in figures."""

from __future__ import annotations

import math
from collections import deque

from tsd_twin.hardware.noise import Noise

_REMEMBERED = 500


class LinkHealth:
    """Round trips of the last cycles, how many had no answer, and how clean the line is."""

    def __init__(self, line: str) -> None:
        """Take what people call the line."""
        self.noise = Noise(line)
        self._trips_ms: deque[float] = deque(maxlen=_REMEMBERED)
        self.cycles = 0
        self.missed = 0
        self.reconnects = 0

    def note(self, trip_s: float) -> None:
        """Take in a cycle that was answered after `trip_s`."""
        self.cycles += 1
        self._trips_ms.append(1000.0 * trip_s)

    def miss(self) -> None:
        """Take in a cycle that was not answered, or not wholly."""
        self.cycles += 1
        self.missed += 1

    def status(self) -> dict[str, object]:
        """Return figures for the status; round trips in milliseconds."""
        # Copied first: another thread may add to it.
        trips = sorted(self._trips_ms.copy())
        figures: dict[str, object] = {"cycles": self.cycles, "missed": self.missed}
        figures["broken"] = self.noise.spoilt
        figures["reconnects"] = self.reconnects
        if trips:
            figures["round_trip_ms"] = round(trips[len(trips) // 2], 2)
            figures["round_trip_p99_ms"] = round(trips[math.ceil(0.99 * len(trips)) - 1], 2)
        return figures
