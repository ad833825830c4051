"""How often something is done at most."""

from __future__ import annotations

import math


class Rate:
    """Tells when the next turn is due; the time is an argument."""

    def __init__(self, hz: float) -> None:
        self._period_s = 1.0 / hz
        self._last_s = -math.inf

    def due(self, now_s: float) -> bool:
        """Return whether a period has passed since this last returned True."""
        # A little early counts: callers come in steps of their own period.
        if now_s - self._last_s < self._period_s - 1e-3:
            return False
        self._last_s = now_s
        return True
