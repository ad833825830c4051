"""Numbers of received statuses, by time of arrival. Pure.

A command echoes the status that was current when its input was given. The robot compares the age
of that status with the limit of the lease, so it bounds the time from the input to the end of the
motion, whatever repeats the command in between.
"""

from __future__ import annotations

import math
from collections import deque

_KEPT = 64
"""Three seconds at 20 Hz; no lease lets a command count that is older than one second."""
NEVER_SENT: tuple[int, float] = (0, -math.inf)
"""Stands for a status from before all that are known; robots number from 1."""


class Echoes:
    """Status numbers of one robot with their times of arrival, oldest first."""

    def __init__(self) -> None:
        self._received: deque[tuple[int, float]] = deque(maxlen=_KEPT)

    def add(self, seq: int, now_s: float) -> None:
        """Add a status that is newer than all before, or the first one of a restarted robot."""
        self._received.append((seq, now_s))

    def at(self, time_s: float) -> tuple[int, float]:
        """Return the number that was current at a time, and when it arrived.

        `NEVER_SENT` for a time before all known statuses, so that the command does not count.
        """
        for seq, received_s in reversed(self._received):
            if received_s <= time_s:
                return seq, received_s
        return NEVER_SENT
