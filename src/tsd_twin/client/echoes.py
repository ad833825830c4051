"""Sequence numbers of received statuses by arrival time (pure).

A command echoes the status that was current when its input was given. The robot checks the age of
that status against the limit of the lease. This bounds the time from the input to the end of the
motion, even if the command is repeated in between.
"""

from __future__ import annotations

import math
from collections import deque

_KEPT = 64
"""3 s at 20 Hz; no lease accepts commands older than 1 s."""
NEVER_SENT: tuple[int, float] = (0, -math.inf)
"""Placeholder for a status before all known ones; robots count from 1."""


class Echoes:
    """Status sequence numbers of a robot with their arrival times."""

    def __init__(self) -> None:
        self._received: deque[tuple[int, float]] = deque(maxlen=_KEPT)

    def add(self, seq: int, now_s: float) -> None:
        """Add a status that is newer than all others, or the first after a robot restart."""
        self._received.append((seq, now_s))

    def at(self, time_s: float) -> tuple[int, float]:
        """Return the sequence number that was current at `time_s` and its arrival time.

        Returns `NEVER_SENT` if `time_s` precedes all known statuses, so the command is rejected.
        """
        for seq, received_s in reversed(self._received):
            if received_s <= time_s:
                return seq, received_s
        return NEVER_SENT
