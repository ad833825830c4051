"""Delay of the control loop over the link, measured with the numbers of commands."""

from __future__ import annotations

import math
import statistics
from collections import deque

from tsd_twin.messages.status import CommandStatus

_MOST_S = 5.0
"""Largest delay that counts as one."""
_ROUNDING_S = 1e-3
"""Ages in a status are rounded."""
_SENT_KEPT = 256
_MEASURED_KEPT = 5
_LASTS_S = 2.0


class CommandDelay:
    """Time from sending a command to receiving a state that includes its effect.

    A status names the newest command that has counted, and how long ago that was. So the way there,
    the wait for the next period of the robot and the way back are measured together, and no clocks
    have to agree. The status comes from the network: what is no number, or no possible delay, does
    not count, and one wrong value in five changes nothing.
    """

    def __init__(self) -> None:
        self._sent: deque[tuple[int, float]] = deque(maxlen=_SENT_KEPT)
        self._measured: deque[tuple[float, float]] = deque(maxlen=_MEASURED_KEPT)

    def add_sent(self, seq: int, now_s: float) -> None:
        """Add a command that is sent now."""
        self._sent.append((seq, now_s))

    def add_status(self, command: CommandStatus, now_s: float) -> None:
        """Measure with a status that is received now."""
        age_s = command.age_s
        if age_s is None or not 0.0 <= age_s < math.inf:
            return
        for seq, sent_s in reversed(self._sent):
            if seq == command.seq:
                delay_s = now_s - sent_s - age_s
                if -_ROUNDING_S <= delay_s <= _MOST_S:
                    self._measured.append((now_s, max(delay_s, 0.0)))
                return

    def median_s(self, now_s: float) -> float | None:
        """Return the median of the newest delays; None without any in the last two seconds."""
        recent = [delay_s for at_s, delay_s in self._measured if now_s - at_s <= _LASTS_S]
        return statistics.median(recent) if recent else None
