"""Asyncio client: the same interface as `robot`, with coroutines instead of blocking calls.

All objects belong to one event loop, which also sends the setpoints. If the loop is blocked, no
commands are sent and the robot stops. Bus calls run in worker threads.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable, Coroutine, Sequence
from pathlib import Path
from typing import Any, Self, TypeAlias

from tsd_twin.client import procedures
from tsd_twin.client.arguments import check_numbers, check_optional
from tsd_twin.client.base_control import BaseControl
from tsd_twin.client.bus_port import BusLink
from tsd_twin.client.core import QUEUE, Acquire, BaseClient
from tsd_twin.client.discovery import open_link
from tsd_twin.client.held_lease import RENEW_PERIOD_S
from tsd_twin.client.port import (
    Call,
    Compute,
    NextStatus,
    Outcome,
    Procedure,
    SendStop,
    Sleep,
    Step,
    run_async,
)
from tsd_twin.client.protocol import TwistCommand
from tsd_twin.client.state import RobotState, Subscription
from tsd_twin.messages.events import Event

_Done: TypeAlias = Coroutine[Any, Any, None]


class AsyncRobotClient(BaseClient["AsyncRobotControl", _Done]):
    """Robot on the bus for use in one event loop; returned by `connect_async`."""

    def __init__(self, link: BusLink, operator: str) -> None:
        super().__init__(link, operator)
        self._loop = asyncio.get_running_loop()
        self._changed = asyncio.Event()
        self._woken = False
        link.on_change(self._wake_from_thread)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Release any held control and disconnect from the bus."""
        link = self.link
        try:
            for control in list(self._controls):
                await control.release()
        finally:
            await asyncio.to_thread(link.close)

    async def sleep(self, seconds: float) -> None:
        """Sleep."""
        check_numbers(seconds=seconds)
        await asyncio.sleep(seconds)

    async def states(
        self, duration_s: float | None = None, *, maxlen: int = QUEUE
    ) -> AsyncIterator[RobotState]:
        """Yield new states at 50 Hz for `duration_s`, or until the robot is closed.

        If the consumer is slow, all but the latest `maxlen` states are dropped.
        """
        check_optional(duration_s=duration_s)
        end_s = None if duration_s is None else self.time_s + duration_s
        with self.link.subscribe_states(Subscription[RobotState](maxlen)) as subscription:
            while not self.link.closed and (end_s is None or self.time_s < end_s):
                for state in subscription.take():
                    yield state
                await self.changed(0.1)

    async def events(self, *, maxlen: int = QUEUE) -> AsyncIterator[Event]:
        """Yield the latest past event and each new one until the robot is closed."""
        with self.link.subscribe_events(Subscription[Event](maxlen)) as subscription:
            while not self.link.closed:
                for event in subscription.take():
                    yield event
                await self.changed(0.1)

    async def changed(self, timeout_s: float) -> None:
        """Wait for a new message, at most `timeout_s`."""
        self._changed.clear()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._changed.wait(), timeout_s)

    def _wake_from_thread(self) -> None:
        # Called with the link's lock held. Queue at most one wake-up, even if the loop is slow.
        if not self._woken:
            self._woken = True
            with contextlib.suppress(RuntimeError):  # The loop is closed.
                self._loop.call_soon_threadsafe(self._wake)

    def _wake(self) -> None:
        self._woken = False
        self._changed.set()

    async def _step(self, step: Step) -> Outcome:
        answer, value, link = None, None, self.link
        match step:
            case Call(service, payload, timeout_s):
                answer = await asyncio.to_thread(link.call, service, payload, timeout_s)
            case SendStop(payload):
                link.send_stop(payload)
            case Sleep(until_s):
                await asyncio.sleep(max(0.0, until_s - link.now_s()))
            case NextStatus(until_s):
                await self._next_status(until_s)
            case Compute(function):
                value = await asyncio.to_thread(function)
            case TwistCommand():  # `advance` has published it.
                pass
        return Outcome(link.now_s(), answer, value)

    async def _next_status(self, until_s: float) -> None:
        seen = self.state.status
        while self.state.status is seen and (left_s := until_s - self.time_s) > 0.0:
            await self.changed(left_s)

    async def perform(self, begin: Callable[[], Procedure[None]]) -> None:
        """Begin a procedure and run it (internal)."""
        await run_async(self.link, begin(), self._step)

    def _new_control(self, operator: str, arm: bool, acquire: Acquire) -> AsyncRobotControl:
        return AsyncRobotControl(self, operator, arm, acquire)


class AsyncRobotControl(BaseControl[AsyncRobotClient, _Done]):
    """Asyncio counterpart of `RobotControl`.

    If the task of a motion is cancelled, a zero command is sent first.
    """

    def __init__(self, robot: AsyncRobotClient, operator: str, arm: bool, acquire: Acquire) -> None:
        super().__init__(robot, operator, arm, acquire)
        self._tasks: list[asyncio.Task[None]] = []
        self._has_setpoint = asyncio.Event()

    async def __aenter__(self) -> Self:
        await self.acquire()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.release()

    async def acquire(self) -> None:
        """Acquire the lease and arm, like `RobotControl.acquire`."""
        self._link.attach(self._protocol)
        self.robot.add_control(self, active=True)
        try:
            await self._perform_now(self._acquire)
            for work in (self._renew(), self._send_setpoints()):
                self._tasks.append(asyncio.create_task(work))
            if self._arm:
                await self.arm()
        except BaseException:
            await self.release()
            raise

    async def release(self) -> None:
        """Command zero, disarm and release, even if the task is cancelled."""
        await _uncancelled(self._release())

    async def _release(self) -> None:
        try:
            await self._perform_now(procedures.give_back)
        finally:
            for task in self._tasks:
                task.cancel()
            self._tasks = []
            self._link.detach(self._protocol)
            self.robot.add_control(self, active=False)

    def _wake_sender(self) -> None:
        self._has_setpoint.set()

    async def _renew(self) -> None:
        while True:
            await asyncio.sleep(0.5 * RENEW_PERIOD_S)
            await self._perform_now(procedures.renew)

    async def _send_setpoints(self) -> None:
        while await self._has_setpoint.wait():
            with self._link.lock:
                until_s = self._send_due()
                if not self._protocol.has_setpoint:
                    self._has_setpoint.clear()
            await asyncio.sleep(max(0.0, until_s - self._now_s))


class _Connecting:
    """Pending connection; await it or use it in `async with`."""

    def __init__(self, opening: Coroutine[Any, Any, AsyncRobotClient]) -> None:
        self._opening = opening
        self._robot: AsyncRobotClient | None = None

    def __await__(self) -> Any:
        return self._opening.__await__()

    async def __aenter__(self) -> AsyncRobotClient:
        self._robot = await self._opening
        return self._robot

    async def __aexit__(self, *_: object) -> None:
        if self._robot is not None:
            await self._robot.close()


def connect_async(
    endpoint: str | Sequence[str] | None = None,
    *,
    robot: str | None = None,
    certificate: str | Path | None = None,
    zenoh_config: str | Path | None = None,
) -> _Connecting:
    """Connect to a robot; await the result or use it in `async with`.

    Same arguments and errors as `connect`.
    """

    async def opening() -> AsyncRobotClient:
        link, operator = await asyncio.to_thread(
            open_link, endpoint, robot, certificate, zenoh_config
        )
        return AsyncRobotClient(link, operator)

    return _Connecting(opening())


async def _uncancelled(work: Coroutine[Any, Any, None]) -> None:
    """Run `work` to completion, then re-raise any cancellation."""
    task = asyncio.ensure_future(work)
    cancelled: asyncio.CancelledError | None = None
    while not task.done():
        try:
            await asyncio.shield(task)
        except asyncio.CancelledError as error:
            cancelled = error
    task.result()
    if cancelled is not None:
        raise cancelled
