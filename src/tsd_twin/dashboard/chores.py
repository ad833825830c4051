"""Work for one thread, off the event loop, of which nothing piles up."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

_LOG = logging.getLogger(__name__)
_Answer = TypeVar("_Answer")


class Chores:
    """Done one after the other; from any thread."""

    def __init__(self, name: str) -> None:
        self._pool = ThreadPoolExecutor(1, name)
        self._lock = threading.Lock()
        self._waiting: dict[Hashable, Callable[[], None]] = {}

    @property
    def waiting(self) -> int:
        """Number of pieces of work that wait under a key."""
        with self._lock:
            return len(self._waiting)

    def soon(self, key: Hashable, work: Callable[[], None]) -> None:
        """Do `work` soon; it replaces what still waits under the same key."""
        with self._lock:
            waits = key in self._waiting
            self._waiting[key] = work
            if not waits:
                self._pool.submit(self._do, key)

    def submit(self, work: Callable[[], _Answer]) -> Future[_Answer]:
        """Do `work` for a caller who wants its answer."""
        return self._pool.submit(work)

    def close(self) -> None:
        """Finish what waits, and take nothing more."""
        self._pool.shutdown()

    def _do(self, key: Hashable) -> None:
        with self._lock:
            work = self._waiting.pop(key)
        try:
            work()
        except Exception:  # The next piece of work is another page's.
            _LOG.exception("%s was not done", key)
