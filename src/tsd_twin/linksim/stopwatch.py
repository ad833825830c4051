"""The time that a link has run, which stands still while the link stalls."""

from __future__ import annotations

import math

from tsd_twin.linksim.spec import Stall

TICK_S = 1e-6
"""Times closer than this are the same: clocks count large numbers, and those are rounded."""


class Stopwatch:
    """Turns time into the time that a link has run, and back; both in seconds.

    A link that counts in this time needs no further thought for stalls: whatever is on its way is
    late by as long as the stall lasts, and keeps its order and its distance.
    """

    def __init__(self, start_s: float, stall: Stall | None) -> None:
        self._start_s = start_s
        self._stall = stall
        self._seen_s = start_s
        self._ran_s = 0.0
        self._held_until_s = start_s

    def read(self, now_s: float) -> float:
        """Return how long the link has run; time that went back counts as time that stood."""
        if now_s > self._seen_s:
            # What was held is over at the latest when the time that is asked for comes.
            since_s = min(now_s, max(self._seen_s, self._held_until_s))
            self._ran_s += self._ran(now_s) - self._ran(since_s)
            self._seen_s = now_s
        return self._ran_s

    def hold(self, length_s: float, now_s: float) -> None:
        """Stand still for `length_s` from now on; of two holds at a time the later end counts."""
        self.read(now_s)
        self._held_until_s = max(self._held_until_s, now_s + length_s)

    def change(self, stall: Stall | None, now_s: float) -> None:
        """Stall in another rhythm from now on, still counted from the start."""
        self.read(now_s)
        self._stall = stall

    def stands(self, now_s: float) -> bool:
        """Return whether the link stalls now."""
        if now_s < self._held_until_s - TICK_S:
            return True
        if self._stall is None:
            return False
        periods, into_s = divmod(now_s - self._start_s, self._stall.period_s)
        return periods >= 1.0 and into_s < self._stall.length_s - TICK_S

    def when(self, ran_s: float) -> float:
        """Return when the link will have run for `ran_s`, if nobody holds it before."""
        from_s = max(self._seen_s, self._held_until_s)
        ran_s = self._ran(from_s) + max(0.0, ran_s - self._ran_s)
        stalls = 0.0
        if self._stall is not None and ran_s >= self._stall.period_s - TICK_S:
            between_s = self._stall.period_s - self._stall.length_s
            stalls = 1.0 + math.floor((ran_s + TICK_S - self._stall.period_s) / between_s)
        stalled_s = stalls * self._stall.length_s if self._stall is not None else 0.0
        return self._start_s + ran_s + stalled_s

    def _ran(self, at_s: float) -> float:
        """Return how long it would have run since its start, had nobody held it."""
        since_start_s = at_s - self._start_s
        if self._stall is None or since_start_s < self._stall.period_s:
            return since_start_s
        periods, into_s = divmod(since_start_s, self._stall.period_s)
        stalled_s = (periods - 1.0) * self._stall.length_s + min(self._stall.length_s, into_s)
        return since_start_s - stalled_s
