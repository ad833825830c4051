"""Virtual time: a clock in place of that of the machine, and an event loop that lets it pass."""

from __future__ import annotations

import asyncio
import selectors
import threading
import time
from collections.abc import Callable, Coroutine
from concurrent.futures import Executor
from typing import Any, TypeVar

import pytest

T = TypeVar("T")
START_S = 1000.0
_WALL_NS = 1_700_000_000_000_000_000
_LONGEST_WAIT_S = 0.01
_LONGEST_TEST_S = 60.0
_MOST_TURNS = 1000


class VirtualClock:
    """Clock of everything in a test; time passes in `advance` and in what sleeps."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.now_s = START_S
        self.machines: list[Callable[[float], None]] = []
        """Each is called with the time, whenever it has changed."""
        self.wait: Callable[[float], None] = self.advance
        """Lets seconds pass for all that lives in this time."""
        patch.setattr(time, "monotonic", lambda: self.now_s)
        patch.setattr(time, "time_ns", self.wall_ns)
        patch.setattr(time, "sleep", lambda seconds: self.wait(seconds))
        patch.setattr(threading.Condition, "wait", lambda _, *timeout: self._pause(*timeout))

    def _pause(self, timeout: float | None = None) -> bool:
        self.wait(_LONGEST_WAIT_S if timeout is None else min(timeout, _LONGEST_WAIT_S))
        return False

    def wall_ns(self) -> int:
        """Return the wall clock."""
        return _WALL_NS + round((self.now_s - START_S) * 1e9)

    def advance(self, seconds: float) -> None:
        """Let time pass for the machines alone."""
        self.now_s += seconds
        for machine in self.machines:
            machine(self.now_s)

    def run(self, work: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine to its end in virtual time."""
        loop = _Loop(self)
        try:
            return loop.run_until_complete(work)
        finally:
            left = asyncio.all_tasks(loop)
            for task in left:
                task.cancel()
            try:
                if left:
                    done = loop.create_task(asyncio.wait(left, timeout=1.0))
                    loop.run_until_complete(done)
            finally:
                loop.close()


class _Selector(selectors.DefaultSelector):
    """Selector that lets virtual time pass where others wait."""

    def __init__(self, clock: VirtualClock) -> None:
        super().__init__()
        self._clock = clock
        self._last_s, self._turns = 0.0, 0
        """Time of the last turn of the loop, and turns at that time."""

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        ready = super().select(0)
        if self._clock.now_s > self._last_s:
            self._last_s, self._turns = self._clock.now_s, 0
        self._turns += 1
        assert self._turns < _MOST_TURNS, "it works without end, and no time passes"
        if not ready and timeout != 0:
            assert self._clock.now_s < START_S + _LONGEST_TEST_S, "it waits for ever"
            wait_s = _LONGEST_WAIT_S if timeout is None else min(timeout, _LONGEST_WAIT_S)
            self._clock.wait(max(wait_s, 1e-6))
            ready = super().select(0)
        return ready


class _Loop(asyncio.SelectorEventLoop):
    """Event loop in virtual time, which does at once what others give to a thread."""

    def __init__(self, clock: VirtualClock) -> None:
        super().__init__(_Selector(clock))
        self._clock_resolution = 0.0  # Time does not pass by itself until a timer is due.

    def run_in_executor(  # type: ignore[override]
        self, _executor: Executor | None, func: Callable[..., T], *args: Any
    ) -> asyncio.Future[T]:
        future: asyncio.Future[T] = self.create_future()
        try:
            future.set_result(func(*args))
        except Exception as error:
            future.set_exception(error)
        return future
