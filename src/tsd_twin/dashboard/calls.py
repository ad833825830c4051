"""Calls that wait for a robot's answer, kept off the event loop."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from typing import ParamSpec, TypeVar

from tsd_twin.dashboard.link import RobotLink
from tsd_twin.errors import BusError
from tsd_twin.messages.service import Reply

_Args = ParamSpec("_Args")
_Answer = TypeVar("_Answer")

_ASKING = 8
_STOPPING = 32


class Calls:
    """Three pools of threads: a stop never waits behind a question to a robot that is gone.

    One thread plans for all pages; what nobody waits for any more is not begun.
    """

    def __init__(self) -> None:
        self._asking = ThreadPoolExecutor(_ASKING, "ask")
        self._stopping = ThreadPoolExecutor(_STOPPING, "stop")
        self._planning = ThreadPoolExecutor(1, "plan")
        self._stops: dict[str, asyncio.Task[Reply]] = {}
        self._next_stops: dict[str, asyncio.Task[Reply]] = {}

    def close(self) -> None:
        """Begin nothing any more; what is under way ends by itself."""
        self._asking.shutdown(wait=False, cancel_futures=True)
        self._stopping.shutdown(wait=False)
        self._planning.shutdown(wait=False, cancel_futures=True)

    async def ask(
        self, call: Callable[_Args, _Answer], *args: _Args.args, **kwargs: _Args.kwargs
    ) -> _Answer:
        """Return what `call` returns."""
        return await _run(self._asking, call, *args, **kwargs)

    async def plan(
        self, call: Callable[_Args, _Answer], *args: _Args.args, **kwargs: _Args.kwargs
    ) -> _Answer:
        """Return what `call` returns, which takes a while without asking anybody."""
        return await _run(self._planning, call, *args, **kwargs)

    async def stop(self, link: RobotLink, operator: str) -> Reply:
        """Stop a robot.

        A stop under way repeats itself until it is acknowledged. All that come in meanwhile share
        the one that follows it, so however often the button is hit, a stop begins after each hit
        and no robot takes more than one thread.
        """
        if (under_way := self._stops.get(link.id)) is None or under_way.done():
            self._stops[link.id] = asyncio.create_task(self._stop(link, operator))
            return await asyncio.shield(self._stops[link.id])
        if link.id not in self._next_stops:
            self._next_stops[link.id] = asyncio.create_task(self._after(under_way, link, operator))
        return await asyncio.shield(self._next_stops[link.id])

    async def _after(self, before: asyncio.Task[Reply], link: RobotLink, operator: str) -> Reply:
        await before
        self._stops[link.id] = self._next_stops.pop(link.id)
        return await self._stop(link, operator)

    async def _stop(self, link: RobotLink, operator: str) -> Reply:
        try:
            return await _run(self._stopping, link.stop, operator)
        except BusError as error:
            return Reply(False, str(error))


async def _run(
    pool: Executor, call: Callable[_Args, _Answer], *args: _Args.args, **kwargs: _Args.kwargs
) -> _Answer:
    return await asyncio.get_running_loop().run_in_executor(pool, lambda: call(*args, **kwargs))
