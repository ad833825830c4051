"""Lease client of one page: acquire, renew, hand over and release control of a robot."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Coroutine, Sequence
from enum import StrEnum
from functools import partial
from typing import Any, Literal

import numpy as np

from tsd_twin.dashboard.robot_client import LeaseHolder, RobotClient, RpcExecutor
from tsd_twin.dashboard.server.protocol import ActionReply, LeaseAction
from tsd_twin.errors import BusError
from tsd_twin.messages.ros import BASE
from tsd_twin.messages.services import HolderRequest, LeaseRequest, Reply, SpeedRequest
from tsd_twin.messages.status import LeaseStatus, Status
from tsd_twin.messages.topics import Service

_LOG = logging.getLogger(__name__)

ZERO_PERIOD_S = 0.02
ZERO_REPEATS = 25
"""A zero is sent again so often, unless a status shows before that it counted."""
_LEASE_GRACE_S = 0.3
"""A status sent before the lease was granted does not contain it."""


class Lease:
    """Lease of one robot: publishes commands and calls services with it."""

    def __init__(self, link: RobotClient, holder: LeaseHolder, executor: RpcExecutor) -> None:
        self.link = link
        self._holder = holder
        self._executor = executor
        self._acquired_s = time.monotonic()
        self._components = list(link.kinematics.twist_axes)
        self.max_age_s = holder.max_age_s
        """Limit of the command age of this lease."""
        self._zero_timer: asyncio.TimerHandle | None = None

    def send_twist(self, twist: Sequence[float], seen: int, frame: str = BASE) -> None:
        """Send a twist (3,) at once, with the number of the newest state that the page has seen."""
        self._cancel_zeros()
        self._send_command(twist, seen, frame)

    def send_zero(self) -> None:
        """Send a zero, repeated every 20 ms until a status of the robot confirms it.

        It is said now, so it counts, whatever the page has seen. The bus may lose any command, and
        the one before the zero would stand until it runs out. The next `drive` ends it, as does the
        end of the lease, or half a second.
        """
        self._cancel_zeros()
        self._repeat_zero(ZERO_REPEATS, None)

    def _repeat_zero(self, left: int, first: int | None) -> None:
        self._zero_timer = None
        status = self.link.snapshot.status
        if first is not None and status is not None:
            if status.command.seq >= first and status.lease.holder == self._holder.operator:
                return
            if self.is_lost(status):
                return
        number = self._send_command((0.0, 0.0, 0.0), self.link.snapshot.status_seq, BASE)
        if left > 0:
            again = partial(self._repeat_zero, left - 1, number if first is None else first)
            self._zero_timer = asyncio.get_running_loop().call_later(ZERO_PERIOD_S, again)

    def _cancel_zeros(self) -> None:
        if self._zero_timer is not None:
            self._zero_timer.cancel()
            self._zero_timer = None

    def _send_command(self, twist: Sequence[float], seen: int, frame: str) -> int:
        """Send a twist, and return its number; 0 when the bus is closed."""
        spatial = np.zeros(6)
        spatial[self._components] = twist
        try:
            return self.link.publish_twist(self._holder, spatial, seen, frame)
        except BusError as error:
            _LOG.warning("%s: %s", self.link.id, error)  # The robot stops by itself.
            return 0

    def is_lost(self, status: Status) -> bool:
        """Return whether the status names another lease holder or none."""
        settled = time.monotonic() - self._acquired_s > _LEASE_GRACE_S
        return settled and status.lease.holder != self._holder.operator

    async def call_service(self, service: Service) -> Reply:
        """Call a service that requires the lease."""
        return await self._executor.call(
            self.link.call_service, service, HolderRequest(self._holder.lease_hex)
        )

    async def set_wheel_speed(self, cruise_speed_rpm: float) -> Reply:
        """Request another speed of wheels that always spin."""
        request = SpeedRequest(self._holder.lease_hex, cruise_speed_rpm)
        return await self._executor.call(self.link.call_service, Service.SPEED, request)

    async def renew(self) -> None:
        """Renew the lease; the status shows the result."""
        await self._executor.call(
            self.link.call_lease_service,
            LeaseRequest(op="renew", operator=self._holder.operator, lease=self._holder.lease_hex),
        )

    async def release(self) -> None:
        """Release the lease; if that fails, it expires."""
        await self._executor.call(
            self.link.call_lease_service,
            LeaseRequest(
                op="release", operator=self._holder.operator, lease=self._holder.lease_hex
            ),
        )
        self._cancel_zeros()

    async def answer_request(self, op: Literal["grant", "deny"], asker: str | None) -> Reply:
        """Grant or deny the pending request."""
        holder = self._holder
        request = LeaseRequest(op=op, operator=holder.operator, lease=holder.lease_hex, asker=asker)
        reply = await self._executor.call(self.link.call_lease_service, request)
        return Reply(reply.done, reply.reason)


async def acquire_lease(
    link: RobotClient,
    operator: str,
    executor: RpcExecutor,
    *,
    take_over: bool,
    max_age_s: float | None,
    reason: str = "",
) -> Lease | str:
    """Return the lease of a robot, or the reason of the refusal."""
    request = LeaseRequest(
        op="acquire", operator=operator, take_over=take_over, max_age_s=max_age_s, reason=reason
    )
    reply = await executor.call(link.call_lease_service, request)
    if not reply.granted or reply.lease is None:
        return reply.reason or "the robot refuses"
    return Lease(link, LeaseHolder(operator, reply.lease, reply.max_age_s), executor)


_REQUEST_GRACE_S = 0.3
"""A status sent before the request does not contain it."""


class LeaseRequestState(StrEnum):
    """State of a pending lease request."""

    WAITING = "waiting"
    GRANTED = "ours"
    """The lease is reserved for this operator, or free: acquire it."""
    ENDED = "over"
    """Denied, timed out, or granted to another operator."""


class PendingLeaseRequest:
    """Pending lease request; the status of the robot contains its progress."""

    def __init__(
        self, link: RobotClient, operator: str, options: LeaseAction, executor: RpcExecutor
    ) -> None:
        self.link = link
        self.options = options
        """Options for the acquisition of the lease."""
        self._operator = operator
        self._executor = executor
        self._sent_s = time.monotonic()

    async def send(self) -> Reply:
        """Send the request to the holder."""
        reply = await self._send(LeaseRequest(op="request", operator=self._operator))
        self._sent_s = time.monotonic()
        return reply

    async def withdraw(self) -> Reply:
        """Withdraw the request; it times out if that fails."""
        return await self._send(LeaseRequest(op="withdraw", operator=self._operator))

    def state(self, lease: LeaseStatus) -> LeaseRequestState:
        """Return the state of the request."""
        if lease.asked_by == self._operator:
            return LeaseRequestState.WAITING
        if lease.reserved_for == self._operator:
            return LeaseRequestState.GRANTED
        if lease.holder is None and lease.reserved_for is None:
            return LeaseRequestState.GRANTED
        settled = time.monotonic() - self._sent_s > _REQUEST_GRACE_S
        return LeaseRequestState.ENDED if settled else LeaseRequestState.WAITING

    async def _send(self, request: LeaseRequest) -> Reply:
        reply = await self._executor.call(self.link.call_lease_service, request)
        return Reply(reply.done, reply.reason)


HEARTBEAT_TIMEOUT_S = 2.0
"""A page without a heartbeat for this long loses the lease."""
RENEW_PERIOD_S = 0.5
"""The lease is renewed this often."""


class LeaseClient:
    """Lease client of one page: one request at a time, each with a reply, without blocking other
    pages.
    """

    def __init__(
        self,
        operator: str,
        executor: RpcExecutor,
        send_reply: Callable[[ActionReply], None],
        release_controls: Callable[[str], None],
    ) -> None:
        self.lease: Lease | None = None
        """Lease that the page holds."""
        self._pending: PendingLeaseRequest | None = None
        self._operator = operator
        self._executor = executor
        self._send_reply = send_reply
        self._release_controls = release_controls
        self._heartbeat_s = time.monotonic()
        self._request: asyncio.Task[None] | None = None
        self._renewing: asyncio.Task[None] | None = None

    def on_heartbeat(self) -> None:
        """Register a heartbeat of the page."""
        self._heartbeat_s = time.monotonic()

    def start_request(self, what: str, work: Coroutine[Any, Any, Reply]) -> bool:
        """Start `work` and reply with its result; return False if a request is already running."""
        if self._request is not None and not self._request.done():
            work.close()
            self._send_reply(
                ActionReply(to=what, ok=False, reason="the last request is still under way")
            )
            return False
        self._request = asyncio.create_task(self._run_request(what, work))
        return True

    async def _run_request(self, what: str, work: Coroutine[Any, Any, Reply]) -> None:
        reply = await work
        self._send_reply(ActionReply(to=what, ok=reply.ok, reason=reply.reason))

    async def close(self) -> None:
        """Finish the running request, which may acquire the lease, and release the lease."""
        if self._request is not None:
            await asyncio.wait([self._request])
        await self.release_lease()

    def on_lease_status(self, lease: LeaseStatus) -> None:
        """Acquire the lease once the holder has granted it, if the page is alive."""
        pending = self._pending
        if pending is None or (self._request is not None and not self._request.done()):
            return
        if time.monotonic() - self._heartbeat_s > HEARTBEAT_TIMEOUT_S:
            self.start_request("lease", self.withdraw())
            return
        match pending.state(lease):
            case LeaseRequestState.GRANTED:
                self._pending = None
                self.start_request("lease", self.acquire(pending.link, pending.options))
            case LeaseRequestState.ENDED:
                self._pending = None
            case LeaseRequestState.WAITING:
                pass

    # Requests.

    async def acquire(self, link: RobotClient | None, options: LeaseAction) -> Reply:
        """Acquire the lease."""
        if link is None:
            return Reply(False, "no robot is shown")
        self._release_controls("control is asked for")
        await self.release_lease()
        control = await acquire_lease(
            link,
            self._operator,
            self._executor,
            take_over=options.take_over,
            max_age_s=options.max_age_s,
            reason=options.reason,
        )
        if isinstance(control, str):
            return Reply(False, control)
        self.lease = control
        self._renewing = asyncio.create_task(self._renew_while_alive(control))
        return Reply(True)

    async def request(self, link: RobotClient | None, options: LeaseAction) -> Reply:
        """Request the lease from its holder; `on_lease_status` acquires it once granted."""
        if link is None:
            return Reply(False, "no robot is shown")
        self._release_controls("control is asked for")
        await self.release_lease()
        pending = PendingLeaseRequest(link, self._operator, options, self._executor)
        reply = await pending.send()
        if reply.ok:
            self._pending = pending
        return reply

    async def withdraw(self) -> Reply:
        """Withdraw the pending request."""
        pending, self._pending = self._pending, None
        if pending is None:
            return Reply(False, "you do not ask for control")
        return await pending.withdraw()

    async def answer_request(self, op: Literal["grant", "deny"], asker: str | None) -> Reply:
        """Grant or deny a pending request; a grant releases the controls first."""
        control = self.lease
        if control is None:
            return Reply(False, "take control first")
        if op == "grant":
            self._release_controls("control is handed over")
        reply = await control.answer_request(op, asker)
        if reply.ok and op == "grant" and self.lease is control:
            self.forget_lease()
        return reply

    async def release(self) -> Reply:
        """Release control."""
        self._release_controls("control was released")
        await self.release_lease()
        return Reply(True)

    async def call_service(self, service: Service) -> Reply:
        """Call a service that requires the lease."""
        if self.lease is None:
            return Reply(False, "take control first")
        return await self.lease.call_service(service)

    async def set_wheel_speed(self, cruise_speed_rpm: float) -> Reply:
        """Request another wheel speed; the reply states the range."""
        if self.lease is None:
            return Reply(False, "take control first")
        return await self.lease.set_wheel_speed(cruise_speed_rpm)

    # Control.

    async def release_lease(self) -> None:
        """Release the lease, if held, and withdraw a pending request."""
        control, pending = self.lease, self._pending
        self._pending = None
        self.forget_lease()
        if pending is not None:
            await pending.withdraw()
        if control is not None:
            await control.release()

    def forget_lease(self) -> None:
        """Forget the lease, which has ended already."""
        self.lease = None
        if self._renewing is not None:
            self._renewing.cancel()
            self._renewing = None

    async def _renew_while_alive(self, control: Lease) -> None:
        """Renew the lease while heartbeats of the page arrive."""
        while time.monotonic() - self._heartbeat_s <= HEARTBEAT_TIMEOUT_S:
            await control.renew()
            await asyncio.sleep(RENEW_PERIOD_S)
        self._release_controls("no sign of life from the page")
        self._renewing = None  # Releasing cancels this task.
        await self.release_lease()
