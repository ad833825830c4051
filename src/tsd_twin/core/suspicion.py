"""Whom the others contradict, said each time that it is another."""

from __future__ import annotations

import math

from tsd_twin.messages.service import Event

_REPORT_S = 1.0


class Suspicion:
    """Remembers who was suspected last, and keeps reports from becoming a flood."""

    def __init__(self) -> None:
        self._last: str | None = None
        self._reported_s = -math.inf

    def step(self, suspect: str | None, now_s: float) -> Event | None:
        """Return what is worth telling about who is suspected now."""
        if suspect in (None, self._last) or now_s - self._reported_s < _REPORT_S:
            return None
        self._last, self._reported_s = suspect, now_s
        text = f"{suspect} contradicts the others."
        return Event("conflict", text, rule="conflict monitor", robot_s=now_s)
