"""History of the newest states of a robot: ten a second, for half a minute."""

from __future__ import annotations

import bisect
from collections import deque
from operator import attrgetter

from tsd_twin.client.connection import Snapshot
from tsd_twin.dashboard.server.messages_from_page import LOOK_BACK_S

SPACING_S = 0.1
_SLACK_S = 1.0
"""Kept for longer, so that the oldest time that can be asked for is there."""


class StateHistory:
    """Snapshots of one robot, at least `SPACING_S` apart."""

    def __init__(self) -> None:
        self._kept: deque[Snapshot] = deque()

    def add(self, snapshot: Snapshot) -> None:
        """Keep a snapshot, if enough time has passed since the last one that was kept."""
        now_s = snapshot.received_s
        # A little early counts: statuses come at a period of their own.
        if self._kept and now_s - self._kept[-1].received_s < SPACING_S - 0.01:
            return
        self._kept.append(snapshot)
        while self._kept[0].received_s < now_s - LOOK_BACK_S - _SLACK_S:
            self._kept.popleft()

    def at(self, received_s: float) -> Snapshot | None:
        """Return the newest snapshot up to a time; None when none is so old."""
        count = bisect.bisect_right(self._kept, received_s, key=attrgetter("received_s"))
        return self._kept[count - 1] if count else None
