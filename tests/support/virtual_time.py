"""Virtual time: a replacement for the machine's clock, and an event loop that advances it."""

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
_LAST_TURNS = 50
_TURN_S = 1e-7
"""Time added per iteration of the event loop, so that every timer advances the clock."""


class VirtualClock:
    """Clock of a test; it advances in `advance` and in sleeps."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.now_s = START_S
        self.machines: list[Callable[[float], None]] = []
        """Functions that are called with each new time."""
        self.wait: Callable[[float], None] = self.advance
        """Advances all users of this clock by seconds."""
        patch.setattr(time, "monotonic", lambda: self.now_s)
        patch.setattr(time, "time_ns", self.wall_ns)
        real_sleep, real_wait = time.sleep, threading.Condition.wait
        # Threads of earlier tests must not advance this clock.
        others = set(threading.enumerate()) - {threading.current_thread()}

        def sleep(seconds: float) -> None:
            is_other = threading.current_thread() in others
            (real_sleep if is_other else self.wait)(seconds)

        def wait(condition: threading.Condition, timeout: float | None = None) -> bool:
            if threading.current_thread() in others:
                return real_wait(condition, timeout)
            return self._pause(timeout)

        patch.setattr(time, "sleep", sleep)
        patch.setattr(threading.Condition, "wait", wait)

    def _pause(self, timeout: float | None) -> bool:
        self.wait(_LONGEST_WAIT_S if timeout is None else min(timeout, _LONGEST_WAIT_S))
        return False

    def wall_ns(self) -> int:
        """Return the wall clock."""
        return _WALL_NS + round((self.now_s - START_S) * 1e9)

    def advance(self, seconds: float) -> None:
        """Advance the machines only."""
        self.now_s += seconds
        for machine in self.machines:
            machine(self.now_s)

    def run(self, work: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine to its end in virtual time."""
        loop = _Loop(self)
        try:
            return loop.run_until_complete(work)
        finally:
            for task in asyncio.all_tasks(loop):
                task.cancel()
            for _ in range(_LAST_TURNS):
                loop.call_soon(loop.stop)
                loop.run_forever()
            loop.close()


class _Selector(selectors.DefaultSelector):
    """Selector that advances virtual time instead of waiting."""

    def __init__(self, clock: VirtualClock) -> None:
        super().__init__()
        self._clock = clock

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        self._clock.now_s += _TURN_S
        ready = super().select(0)
        if not ready and timeout != 0:
            assert self._clock.now_s < START_S + _LONGEST_TEST_S, "it waits for ever"
            wait_s = _LONGEST_WAIT_S if timeout is None else min(timeout, _LONGEST_WAIT_S)
            self._clock.wait(max(wait_s, 1e-6))
            ready = super().select(0)
        return ready


class _Loop(asyncio.SelectorEventLoop):
    """Event loop in virtual time that runs executor jobs at once.

    Other tasks run before the result is used, as with a thread.
    """

    def __init__(self, clock: VirtualClock) -> None:
        super().__init__(_Selector(clock))

    def run_in_executor(  # type: ignore[override]
        self, _executor: Executor | None, func: Callable[..., T], *args: Any
    ) -> asyncio.Future[T]:
        future: asyncio.Future[T] = self.create_future()
        try:
            self.call_soon(_settle, future, func(*args))
        except Exception as error:
            future.set_exception(error)
        return future


def _settle(future: asyncio.Future[T], result: T) -> None:
    if not future.done():  # It may have been cancelled.
        future.set_result(result)
