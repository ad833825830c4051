"""Detection of control-loop pauses, during which the robot's computer was busy.

To the controller, a pause looks like missing commands or measurements. This distinction lets the
stop reason name the computer; it affects no decision.
"""

from __future__ import annotations

import math

from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.events import Event

LATE_S = 0.05
"""Pauses above this are reported: five periods, half of the fault threshold."""
_REPORT_S = 1.0
"""Minimum time between events, unless the pause exceeds the last reported one."""


class LoopWatch:
    """Monitors the periods of a control loop."""

    def __init__(self) -> None:
        self._now_s = math.nan
        self._pause = (-math.inf, -math.inf)
        """Start and end of the latest pause."""
        self._reported_s = -math.inf
        self._reported_pause_s = 0.0

    def step(self, now_s: float) -> Event | None:
        """Record the start of a period; return an event after a pause."""
        before_s, self._now_s = self._now_s, now_s
        if not now_s - before_s >= LATE_S:
            return None
        self._pause, pause_s = (before_s, now_s), now_s - before_s
        if now_s - self._reported_s < _REPORT_S and pause_s <= self._reported_pause_s:
            return None
        self._reported_s, self._reported_pause_s = now_s, pause_s
        rule = f"periods of the control loop below {LATE_S * 1000:.0f} ms"
        return Event.of("loop", _busy(pause_s), rule, now_s)

    def explains(self, since_s: float, limit_s: float, now_s: float) -> Reason | None:
        """Return the latest pause if it explains a silence that began at `since_s`, else None.

        This is the case if the silence without the pause would be at most `limit_s`.
        """
        begin_s, end_s = self._pause
        pause_s = end_s - max(begin_s, since_s)
        silence_s = now_s - since_s
        explained = pause_s > 0.0 and silence_s > limit_s >= silence_s - pause_s
        return _busy(end_s - begin_s) if explained else None


def _busy(pause_s: float) -> Reason:
    return because(Code.LOOP_LATE, ms=1000.0 * pause_s)
