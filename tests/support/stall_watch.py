"""Stalls of the machine: for how long the process of a test got no time."""

from __future__ import annotations

import threading
import time
from types import TracebackType
from typing import Self

STALL_S = 0.15
"""A robot that gets no time for longer is in a fault, and commands that wait as long are stale."""
_LOOK_S = 0.02


class StallWatch:
    """Longest time for which this process got no time, while the context is open."""

    def __init__(self) -> None:
        self.longest_s = 0.0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._look)

    @property
    def stalled(self) -> bool:
        """Whether there was a stall that also changes what robots and pages do."""
        return self.longest_s > STALL_S

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._ended.set()
        self._thread.join()

    def _look(self) -> None:
        last_s = time.monotonic()
        while not self._ended.wait(_LOOK_S):
            now_s = time.monotonic()
            self.longest_s = max(self.longest_s, now_s - last_s - _LOOK_S)
            last_s = now_s
