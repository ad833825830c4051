"""Non-blocking calls to robots, and lease handling per page."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Coroutine, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, ParamSpec, TypeVar

from tsd_twin.client import ControlDenied, RequestRefused, procedures
from tsd_twin.client.held_lease import RENEW_PERIOD_S
from tsd_twin.client.monitor import RobotMonitor
from tsd_twin.client.port import Call, Outcome, Procedure, SendStop, Step, run_async
from tsd_twin.client.procedures import LeaseRequestState
from tsd_twin.client.protocol import ControlProtocol
from tsd_twin.dashboard.wire.from_page import LeaseAction
from tsd_twin.dashboard.wire.to_page import ActionReply
from tsd_twin.errors import PathError, TwinError
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.commands import why_of
from tsd_twin.messages.errors import reason_of_path
from tsd_twin.messages.services import HolderRequest, LeaseReply, Reply
from tsd_twin.messages.status import LeaseStatus
from tsd_twin.messages.topics import Service

_Args = ParamSpec("_Args")
_Answer = TypeVar("_Answer")
_Result = TypeVar("_Result")

_RPC_THREADS = 8
_STOP_THREADS = 64
"""One for each robot that a dashboard shows, so that silent ones delay no other."""


def reason_of(error: TwinError) -> Reason:
    """Return the reason of an error: that of the robot if it refused, otherwise the text."""
    if isinstance(error, ControlDenied | RequestRefused) and isinstance(error.why, Reason):
        return error.why
    if isinstance(error, PathError):
        return reason_of_path(error)
    return because(Code.TEXT, text=str(error))


class RpcExecutor:
    """Thread pools for blocking calls; stops have a separate pool.

    Stops therefore never wait for a call to an unresponsive robot. One thread plans for all pages.
    Cancelled calls are not started.
    """

    def __init__(self) -> None:
        self._rpc_pool = ThreadPoolExecutor(_RPC_THREADS, "ask")
        self._stop_pool = ThreadPoolExecutor(_STOP_THREADS, "stop")
        self._planning_pool = ThreadPoolExecutor(1, "plan")
        self._stops: dict[str, asyncio.Task[Reply]] = {}
        self._next_stops: dict[str, asyncio.Task[Reply]] = {}

    def close(self) -> None:
        """Accept no further calls; running ones finish."""
        self._rpc_pool.shutdown(wait=False, cancel_futures=True)
        self._stop_pool.shutdown(wait=False)
        self._planning_pool.shutdown(wait=False, cancel_futures=True)

    async def run(self, link: RobotMonitor, procedure: Procedure[_Result]) -> _Result:
        """Run a procedure that calls services of a robot."""
        return await _run(link, procedure, self._rpc_pool)

    async def measure(self, link: RobotMonitor, call: Call) -> float | None:
        """Return the round-trip time of a call, or None without a response."""

        def timed() -> float | None:
            start_s = time.perf_counter()
            answer = link.call(call.service, call.payload, call.timeout_s)
            return None if answer is None else time.perf_counter() - start_s

        return await asyncio.get_running_loop().run_in_executor(self._rpc_pool, timed)

    async def plan(
        self, compute: Callable[_Args, _Answer], *args: _Args.args, **kwargs: _Args.kwargs
    ) -> _Answer:
        """Return the result of a long computation."""
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._planning_pool, lambda: compute(*args, **kwargs))

    async def stop(self, link: RobotMonitor, operator: str, name: str = "") -> Reply:
        """Repeat a published stop until the robot acknowledges it.

        A stop requested during another stop starts after it, and later requests share that second
        one. Each press is therefore followed by a stop, and each robot uses at most one thread.
        """
        if (under_way := self._stops.get(link.id)) is None or under_way.done():
            self._stops[link.id] = asyncio.create_task(self._stop(link, operator, name))
            return await asyncio.shield(self._stops[link.id])
        if link.id not in self._next_stops:
            following = self._after(under_way, link, operator, name)
            self._next_stops[link.id] = asyncio.create_task(following)
        return await asyncio.shield(self._next_stops[link.id])

    async def stop_all(self, links: Sequence[RobotMonitor], operator: str, name: str = "") -> Reply:
        """Repeat published stops until every robot acknowledges."""
        replies = await asyncio.gather(*(self.stop(link, operator, name) for link in links))
        refused = [reply for reply in replies if not reply.ok]
        return refused[0] if refused else Reply(True) if links else _NO_ROBOT_THERE

    async def _after(
        self, before: asyncio.Task[Reply], link: RobotMonitor, operator: str, name: str
    ) -> Reply:
        await before
        self._stops[link.id] = self._next_stops.pop(link.id)
        return await self._stop(link, operator, name)

    async def _stop(self, link: RobotMonitor, operator: str, name: str) -> Reply:
        try:
            await _run(link, procedures.stop(link.id, operator, "", name), self._stop_pool)
        except TwinError as error:
            return Reply.refused(reason_of(error))
        return Reply(True)


async def _run(link: RobotMonitor, procedure: Procedure[_Result], pool: Executor) -> _Result:
    async def perform(step: Step) -> Outcome:
        answer = None
        if isinstance(step, Call):
            call = partial(link.call, step.service, step.payload, step.timeout_s)
            answer = await asyncio.get_running_loop().run_in_executor(pool, call)
        elif isinstance(step, SendStop):
            link.send_stop(step.payload)
        return Outcome(link.now_s(), answer)

    return await run_async(link, procedure, perform)


@dataclass(slots=True, eq=False)
class Lease:
    """Lease of a robot; valid as long as `protocol` holds it."""

    link: RobotMonitor
    protocol: ControlProtocol


@dataclass(frozen=True, slots=True)
class _PendingRequest:
    """Pending request for control; its progress is in the robot's status."""

    link: RobotMonitor
    protocol: ControlProtocol
    options: LeaseAction
    """Options for the acquisition of the lease."""
    sent_s: float


HEARTBEAT_TIMEOUT_S = 2.0
"""A page without a heartbeat for this time loses the lease."""
_REQUEST_GRACE_S = 0.3
"""A status received this soon after the request may predate it."""
_NO_LEASE = Reply.refused(because(Code.TAKE_CONTROL_FIRST))
_NO_ROBOT = Reply.refused(because(Code.NO_ROBOT_SHOWN))
_NO_ROBOT_THERE = Reply.refused(because(Code.NO_ROBOT_THERE))


class LeaseClient:
    """Lease client for a page, with one request at a time and a reply to each.

    Other pages are not blocked.
    """

    def __init__(
        self,
        operator: str,
        executor: RpcExecutor,
        send_reply: Callable[[ActionReply], None],
        release_controls: Callable[[Reason], None],
    ) -> None:
        self.lease: Lease | None = None
        """Lease held by the page."""
        self._name = ""
        self._pending: _PendingRequest | None = None
        self._operator = operator
        self._executor = executor
        self._send_reply = send_reply
        self._release_controls = release_controls
        self._heartbeat_s = time.monotonic()
        self._request: asyncio.Task[None] | None = None
        self._renewing: asyncio.Task[None] | None = None

    def set_name(self, name: str) -> None:
        """Set the display name of the operator; a held lease sends it with its next renewal."""
        self._name = name
        if self.lease is not None:
            self.lease.protocol.name = name

    def on_heartbeat(self) -> None:
        """Record a heartbeat of the page."""
        self._heartbeat_s = time.monotonic()

    def start_request(self, what: str, work: Coroutine[Any, Any, Reply]) -> bool:
        """Start `work` and send its result as the reply; return False if another request is
        running.
        """
        if self._request is not None and not self._request.done():
            work.close()
            under_way = because(Code.REQUEST_UNDER_WAY)
            self._send_reply(ActionReply(to=what, ok=False, why=under_way))
            return False
        self._request = asyncio.create_task(self._run_request(what, work))
        return True

    async def _run_request(self, what: str, work: Coroutine[Any, Any, Reply]) -> None:
        try:
            reply = await work
        except TwinError as error:
            reply = Reply.refused(reason_of(error))
        self._send_reply(ActionReply(to=what, ok=reply.ok, why=why_of(reply)))

    async def close(self) -> None:
        """Finish the running request, which may acquire the lease, then release the lease."""
        if self._request is not None:
            await asyncio.wait([self._request])
        await self.release_lease()

    # Robot status.

    def lost_lease(self) -> Reason | None:
        """Clear the lease if the robot reports its end; return the reason."""
        lease = self.lease
        if lease is None:
            return None
        snapshot = lease.link.snapshot
        if snapshot.status is not None:
            lease.protocol.receive_status(snapshot.status, snapshot.status_seq, snapshot.received_s)
        if lease.protocol.has_lease:
            return None
        self._forget_lease()
        return lease.protocol.lost_why

    def on_lease_status(self, lease: LeaseStatus) -> None:
        """Acquire the lease once its holder has granted it, if the page is alive."""
        pending = self._pending
        if pending is None or (self._request is not None and not self._request.done()):
            return
        if time.monotonic() - self._heartbeat_s > HEARTBEAT_TIMEOUT_S:
            self.start_request("lease", self.withdraw())
            return
        settled = time.monotonic() - pending.sent_s > _REQUEST_GRACE_S
        match procedures.request_state(lease, self._operator, settled=settled):
            case LeaseRequestState.GRANTED:
                self._pending = None
                self.start_request("lease", self.acquire(pending.link, pending.options))
            case LeaseRequestState.ENDED:
                self._pending = None
            case LeaseRequestState.WAITING:
                pass

    # Requests.

    async def acquire(self, link: RobotMonitor | None, options: LeaseAction) -> Reply:
        """Acquire the lease."""
        if link is None:
            return _NO_ROBOT
        protocol = await self._begin(link)
        acquiring = procedures.request_lease(
            protocol,
            take_over=options.take_over,
            max_age_s=options.max_age_s,
            reason=options.reason,
        )
        await self._executor.run(link, acquiring)
        self.lease = lease = Lease(link, protocol)
        self._renewing = asyncio.create_task(self._renew_while_alive(lease))
        return Reply(True)

    async def request(self, link: RobotMonitor | None, options: LeaseAction) -> Reply:
        """Request the lease from its holder; `on_lease_status` acquires it once granted."""
        if link is None:
            return _NO_ROBOT
        protocol = await self._begin(link)
        reply = await self._executor.run(link, procedures.ask_holder(protocol))
        if reply.done:
            self._pending = _PendingRequest(link, protocol, options, time.monotonic())
        return _done(reply)

    async def _begin(self, link: RobotMonitor) -> ControlProtocol:
        """Release the current lease and return the protocol for a new one."""
        self._release_controls(because(Code.CONTROL_ASKED_FOR))
        await self.release_lease()
        protocol = link.protocol(self._operator, self._name)
        snapshot = link.snapshot
        if snapshot.status is not None:
            protocol.receive_status(snapshot.status, snapshot.status_seq, snapshot.received_s)
        return protocol

    async def withdraw(self) -> Reply:
        """Withdraw the pending request."""
        pending, self._pending = self._pending, None
        if pending is None:
            return Reply.refused(because(Code.NOT_ASKING))
        withdrawing = procedures.withdraw_request(pending.protocol)
        reply = await self._executor.run(pending.link, withdrawing)
        return Reply.refused(because(Code.NO_ANSWER)) if reply is None else _done(reply)

    async def answer_request(self, op: Literal["grant", "deny"], asker: str | None) -> Reply:
        """Grant or deny a pending request; before a grant, release the controls."""
        lease = self.lease
        if lease is None:
            return _NO_LEASE
        if op == "grant":
            self._release_controls(because(Code.CONTROL_HANDED_OVER))
        answering = procedures.answer_request(lease.protocol, grant=op == "grant", asker=asker)
        await self._executor.run(lease.link, answering)
        if op == "grant" and self.lease is lease:
            self._forget_lease()
        return Reply(True)

    async def release(self) -> Reply:
        """Release control."""
        self._release_controls(because(Code.CONTROL_RELEASED))
        await self.release_lease()
        return Reply(True)

    async def call_service(self, service: Service) -> Reply:
        """Call a service that requires the lease."""
        if self.lease is None:
            return _NO_LEASE
        protocol = self.lease.protocol
        message = HolderRequest(protocol.lease_hex)
        calling = procedures.request(protocol, service, message, service.name.lower())
        await self._executor.run(self.lease.link, calling)
        return Reply(True)

    async def set_wheel_speed(self, cruise_speed_rpm: float) -> Reply:
        """Request a wheel speed; the reply states the range."""
        if self.lease is None:
            return _NO_LEASE
        setting = procedures.set_wheel_speed(self.lease.protocol, cruise_speed_rpm)
        await self._executor.run(self.lease.link, setting)
        return Reply(True)

    async def release_lease(self) -> None:
        """Release the lease, if held, and withdraw a pending request."""
        lease, pending = self.lease, self._pending
        self._pending = None
        self._forget_lease()
        if pending is not None:
            await self._executor.run(pending.link, procedures.withdraw_request(pending.protocol))
        if lease is not None:
            await self._executor.run(lease.link, procedures.release_lease(lease.protocol))

    def _forget_lease(self) -> None:
        self.lease = None
        if self._renewing is not None:
            self._renewing.cancel()
            self._renewing = None

    async def _renew_while_alive(self, lease: Lease) -> None:
        """Renew the lease while heartbeats of the page arrive."""
        while time.monotonic() - self._heartbeat_s <= HEARTBEAT_TIMEOUT_S:
            renewing = procedures.renew(lease.protocol, lease.link.now_s())
            await self._executor.run(lease.link, renewing)
            await asyncio.sleep(0.5 * RENEW_PERIOD_S)
        self._release_controls(because(Code.PAGE_SILENT, s=HEARTBEAT_TIMEOUT_S))
        self._renewing = None  # Releasing cancels this task.
        await self.release_lease()


def _done(reply: LeaseReply) -> Reply:
    return Reply(reply.done, reply.reason, reply.why)
