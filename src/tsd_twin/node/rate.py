"""Keeping a loop at its rate, and knowing how well that goes."""

from __future__ import annotations

import math
import threading
import time
from collections import deque

from tsd_twin.messages.status import LoopStatus

_REMEMBERED = 500


class RateKeeper:
    """Waits for the next period; a period that is missed altogether is an overrun, not a burst."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._next_s = time.monotonic()
        self._last_s = self._next_s
        self._periods_s: deque[float] = deque(maxlen=_REMEMBERED)
        self._overruns = 0

    def wait(self, stop: threading.Event) -> float:
        """Wait for the next period, or for `stop`, and return the monotonic time."""
        self._next_s += self._period_s
        ahead_s = self._next_s - time.monotonic()
        if ahead_s > 0.0:
            stop.wait(ahead_s)
        elif ahead_s < -self._period_s:
            self._overruns += 1
            self._next_s = time.monotonic()
        now_s = time.monotonic()
        self._periods_s.append(now_s - self._last_s)
        self._last_s = now_s
        return now_s

    def status(self) -> LoopStatus:
        """Return rate, overruns, and how far the periods are from what they should be."""
        if not self._periods_s:
            return LoopStatus()
        periods = sorted(abs(p - self._period_s) for p in self._periods_s)
        p99 = periods[min(len(periods) - 1, math.ceil(0.99 * len(periods)))]
        mean_s = sum(self._periods_s) / len(self._periods_s)
        return LoopStatus(round(1.0 / mean_s, 1), self._overruns, round(1000.0 * p99, 2))
