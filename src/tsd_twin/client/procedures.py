"""Operator procedures as sans-I/O generators: lease, arming, stop, settings.

See `port` for the steps they yield and for running them. All raise `RequestRefused`, or
`ControlDenied` for the lease, with the reason if the robot or its operator refuses, `RobotSilent`
if no response or status arrives, and `ControlLost` if they need the lease and it is not held.
"""

from __future__ import annotations

import math
from enum import StrEnum
from typing import Any, TypeVar

import msgspec

from tsd_twin.client.errors import ControlDenied, RequestRefused, RobotSilent, RobotStopped
from tsd_twin.client.port import Call, NextStatus, Procedure, SendStop
from tsd_twin.client.protocol import STATUS_TIMEOUT_S, ZERO_TWIST, ControlProtocol
from tsd_twin.messages.cdr import BASE
from tsd_twin.messages.commands import why_of
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.modes import LATCHED, Mode
from tsd_twin.messages.services import (
    HolderRequest,
    LeaseReply,
    LeaseRequest,
    Reply,
    SetOrientationRequest,
    SetPoseRequest,
    SpeedRequest,
    StopRequest,
    decode_json,
)
from tsd_twin.messages.status import LeaseStatus, RobotStatus
from tsd_twin.messages.topics import Service

ReplyT = TypeVar("ReplyT", Reply, LeaseReply)

_ARMING_S = 60.0
_IN_FLIGHT_S = 0.1
"""A status that arrives this soon after a response may predate it; on slow links, later ones."""
_REST_S = 10.0
_SETTLE_S = 3.0
"""The latest status shows a new holder or a centred stick well before this timeout."""
_TRIES = 3
_ANSWER_S = 0.5
STOP_TRIES, STOP_ANSWER_S = 20, 0.1


# Requests.


def request(
    protocol: ControlProtocol, service: Service, message: msgspec.Struct, what: str
) -> Procedure[float]:
    """Send a request, named `what` in errors; return the time of the response."""
    outcome = yield Call(service, protocol.encode(service, message))
    reply = _reply(protocol, outcome.answer, Reply)
    if not reply.ok:
        raise RequestRefused(protocol.robot_id, what, reply.reason, why_of(reply))
    return outcome.now_s


def disarm(protocol: ControlProtocol, now_s: float) -> Procedure[None]:
    """Disarm, after a controlled stop if driving; wait until the status confirms it."""
    message = HolderRequest(protocol.lease_hex)
    yield from request(protocol, Service.DISARM, message, "disarm")
    yield from _until_mode(protocol, now_s, Mode.DISARMED, *LATCHED)


def reset(protocol: ControlProtocol, now_s: float, *, renews: bool = False) -> Procedure[None]:
    """Unlatch a stopped or faulty robot; wait until the status shows it disarmed.

    Robots refuse this for 0.5 s after the last nonzero command. Set `renews` to renew the lease
    while waiting, unless a background thread does so.
    """
    end_s = now_s + _SETTLE_S
    while now_s < end_s and _refuses_reset(protocol.status):
        now_s = (yield NextStatus(end_s)).now_s
        if renews:
            yield from renew(protocol, now_s)
    yield from request(protocol, Service.RESET, HolderRequest(protocol.lease_hex), "reset")
    yield from _until_mode(protocol, now_s, Mode.DISARMED)


def reset_without_control(protocol: ControlProtocol, now_s: float) -> Procedure[None]:
    """Acquire the lease, reset and release; the robot is then disarmed."""
    yield from acquire(protocol)
    try:
        yield from reset(protocol, now_s, renews=True)
    except BaseException as error:
        if not isinstance(error, GeneratorExit):
            yield from release_lease(protocol)
        raise
    yield from release_lease(protocol)


def _refuses_reset(status: RobotStatus | None) -> bool:
    return status is not None and status.refusals is not None and bool(status.refusals.reset)


def _until_mode(protocol: ControlProtocol, now_s: float, *modes: Mode) -> Procedure[None]:
    end_s = now_s + _REST_S
    while protocol.mode not in modes:
        now_s = (yield NextStatus(end_s)).now_s
        if now_s >= end_s:
            raise RobotSilent(
                f"{protocol.robot_id} does not show that it is {modes[0]}", "mode_not_shown"
            )


def set_pose(
    protocol: ControlProtocol, x_m: float, y_m: float, heading_rad: float
) -> Procedure[None]:
    """Set the pose estimate; the robot must be at rest."""
    message = SetPoseRequest(protocol.lease_hex, x_m, y_m, heading_rad)
    yield from request(protocol, Service.SET_POSE, message, "set the pose")


def set_orientation(
    protocol: ControlProtocol, x: float, y: float, z: float, w: float
) -> Procedure[None]:
    """Set the orientation estimate of a sphere; the robot must be at rest."""
    message = SetOrientationRequest(protocol.lease_hex, (x, y, z, w))
    yield from request(protocol, Service.SET_POSE, message, "set the orientation")


def set_wheel_speed(protocol: ControlProtocol, rpm: float) -> Procedure[None]:
    """Set the speed of continuously spinning wheels until they are switched off."""
    message = SpeedRequest(protocol.lease_hex, rpm)
    yield from request(protocol, Service.SPEED, message, "change the wheel speed")


def stop(robot_id: str, operator: str, reason: str, name: str = "") -> Procedure[None]:
    """Stop and latch the robot, retrying until acknowledged."""
    payload = stop_payload(operator, reason, name)
    for _ in range(STOP_TRIES):
        yield SendStop(payload)
        answer = (yield Call(Service.STOP, payload, STOP_ANSWER_S)).answer
        reply = _decoded(answer, Reply)
        if reply is not None and reply.ok:
            return
    raise RobotSilent(f"{robot_id} did not acknowledge the stop", "stop_unconfirmed")


def stop_payload(operator: str, reason: str = "", name: str = "") -> bytes:
    """Return the payload of a stop request; `name` is the display name of the operator."""
    return msgspec.json.encode(StopRequest(operator, reason, name))


def _ask(
    protocol: ControlProtocol,
    service: Service,
    message: msgspec.Struct,
    kind: type[ReplyT],
    timeout_s: float = 1.0,
) -> Procedure[ReplyT | None]:
    answer = (yield Call(service, protocol.encode(service, message), timeout_s)).answer
    return _decoded(answer, kind)


def _reply(protocol: ControlProtocol, answer: bytes | None, kind: type[ReplyT]) -> ReplyT:
    if (reply := _decoded(answer, kind)) is None:
        raise RobotSilent(f"{protocol.robot_id} does not answer", "no_answer")
    return reply


def _decoded(answer: bytes | None, kind: type[ReplyT]) -> ReplyT | None:
    if answer is None:
        return None
    try:
        return decode_json(answer, kind, "an answer")
    except MessageError:
        return None


# The lease.


def request_lease(
    protocol: ControlProtocol,
    *,
    take_over: bool = False,
    max_age_s: float | None = None,
    reason: str = "",
) -> Procedure[float]:
    """Request the lease; return the time of the grant."""
    wish = LeaseRequest(
        op="acquire",
        operator=protocol.operator,
        take_over=take_over,
        max_age_s=max_age_s,
        reason=reason,
        name=protocol.name,
    )
    outcome = yield Call(Service.LEASE, protocol.encode(Service.LEASE, wish))
    reply = _reply(protocol, outcome.answer, LeaseReply)
    if not reply.granted:
        raise ControlDenied(protocol.robot_id, reply.reason, reply.holder, why_of(reply))
    protocol.grant(reply, outcome.now_s)
    return outcome.now_s


def acquire(protocol: ControlProtocol, **wish: Any) -> Procedure[None]:
    """Acquire the lease and wait until the status shows it."""
    now_s = yield from request_lease(protocol, **wish)
    end_s = now_s + _SETTLE_S
    # A status in flight still shows the mode under the previous holder.
    while protocol.status is None or protocol.status.lease.holder != protocol.operator:
        now_s = (yield NextStatus(end_s)).now_s
        protocol.check_lease()
        if now_s >= end_s:
            raise RobotSilent(
                f"{protocol.robot_id} does not show who has control", "mode_not_shown"
            )


def renew(protocol: ControlProtocol, now_s: float) -> Procedure[None]:
    """Renew the lease if due; a refusal ends the lease."""
    renewal = protocol.renewal(now_s)
    if renewal is not None:
        outcome = yield Call(Service.LEASE, renewal)
        protocol.receive_renewal(renewal, outcome.answer, outcome.now_s - now_s)


def release_lease(protocol: ControlProtocol) -> Procedure[None]:
    """Release the lease; the robot keeps its mode. Without a response, the lease expires."""
    if protocol.has_lease:
        lease = protocol.lease_hex
        message = LeaseRequest(op="release", operator=protocol.operator, lease=lease)
        try:
            yield from _ask(protocol, Service.LEASE, message, LeaseReply, _ANSWER_S)
        finally:
            protocol.release()


def peek(operator: str, timeout_s: float = 1.0) -> Call:
    """Return a call that queries the lease holder without side effects."""
    message = LeaseRequest(op="peek", operator=operator)
    return Call(Service.LEASE, msgspec.json.encode(message), timeout_s)


def ask_holder(protocol: ControlProtocol) -> Procedure[LeaseReply]:
    """Request the lease from its holder; the reply is `done` if the request is pending."""
    message = LeaseRequest(op="request", operator=protocol.operator, name=protocol.name)
    outcome = yield Call(Service.LEASE, protocol.encode(Service.LEASE, message))
    return _reply(protocol, outcome.answer, LeaseReply)


def withdraw_request(
    protocol: ControlProtocol, timeout_s: float = 1.0
) -> Procedure[LeaseReply | None]:
    """Withdraw the pending request; without a response, it times out."""
    message = LeaseRequest(op="withdraw", operator=protocol.operator)
    return (yield from _ask(protocol, Service.LEASE, message, LeaseReply, timeout_s))


class LeaseRequestState(StrEnum):
    """State of a pending request for control."""

    WAITING = "waiting"
    GRANTED = "granted"
    """The lease is free or reserved for this operator and can be acquired."""
    ENDED = "ended"
    """Denied, timed out or granted to another operator."""


def request_state(lease: LeaseStatus, operator: str, *, settled: bool) -> LeaseRequestState:
    """Return the state of a request; `settled` means that the status postdates it."""
    if lease.requested_by == operator:
        return LeaseRequestState.WAITING
    free = lease.holder is None and lease.reserved_for is None
    if free or lease.reserved_for == operator:
        return LeaseRequestState.GRANTED
    return LeaseRequestState.ENDED if settled else LeaseRequestState.WAITING


def ask_for_control(
    protocol: ControlProtocol, now_s: float, timeout_s: float, **wish: Any
) -> Procedure[None]:
    """Request the lease from its holder; acquire it once granted or free."""
    reply = yield from ask_holder(protocol)
    if not reply.done and reply.holder is not None:
        raise ControlDenied(protocol.robot_id, reply.reason, reply.holder, why_of(reply))
    if reply.holder is not None:
        yield from _until_granted(protocol, now_s, timeout_s, reply.holder)
    yield from acquire(protocol, **wish)


def _until_granted(
    protocol: ControlProtocol, now_s: float, timeout_s: float, holder: str
) -> Procedure[None]:
    """Wait until the lease is granted or free; withdraw the request on errors."""
    operator, settled_s, end_s = protocol.operator, now_s + _SETTLE_S, now_s + timeout_s
    try:
        while True:
            if protocol.status is not None:
                lease = protocol.status.lease
                state = request_state(lease, operator, settled=now_s > settled_s)
                if state is LeaseRequestState.GRANTED:
                    return
                if state is LeaseRequestState.ENDED:
                    raise ControlDenied(protocol.robot_id, f"{holder} keeps control", holder)
                if lease.requested_by == operator:
                    settled_s = now_s  # A later status without the request implies a decision.
            if now_s >= end_s:
                raise ControlDenied(protocol.robot_id, f"{holder} does not answer", holder)
            now_s = (yield NextStatus(min(end_s, now_s + 0.5))).now_s
    except BaseException as error:
        if not isinstance(error, GeneratorExit):
            yield from withdraw_request(protocol, _ANSWER_S)
        raise


def answer_request(protocol: ControlProtocol, *, grant: bool, asker: str | None) -> Procedure[None]:
    """Grant or deny the request for control.

    Raises:
        RequestRefused: If there is no request, or it is from another operator.
        ControlLost: If the lease is not held.
    """
    status = protocol.status
    asker = asker or (status.lease.requested_by if status is not None else None)
    message = LeaseRequest(
        op="grant" if grant else "deny",
        operator=protocol.operator,
        lease=protocol.lease_hex,
        requester=asker,
    )
    outcome = yield Call(Service.LEASE, protocol.encode(Service.LEASE, message))
    reply = _reply(protocol, outcome.answer, LeaseReply)
    if not reply.done:
        what = "hand over control" if grant else "keep control"
        raise RequestRefused(protocol.robot_id, what, reply.reason, why_of(reply))
    if grant:
        protocol.release()


def give_back(protocol: ControlProtocol, now_s: float) -> Procedure[None]:
    """Command zero, disarm and release; do nothing without the lease.

    If disarming fails, the robot is stopped, unless another operator has control.

    Raises:
        RobotSilent: If no response arrives; the robot then stops automatically.
    """
    if not protocol.has_lease:
        return
    lease = protocol.lease_hex
    protocol.end_motion()
    try:
        yield protocol.command(ZERO_TWIST, BASE, now_s)
        for _ in range(_TRIES):
            reply = yield from _ask(
                protocol, Service.DISARM, HolderRequest(lease), Reply, _ANSWER_S
            )
            if reply is not None and reply.ok:
                break
            seen = _decoded((yield peek(protocol.operator, _ANSWER_S)).answer, LeaseReply)
            if seen is not None and seen.holder is not None:
                return
        else:
            yield from _stop_instead(protocol)
            return
        yield from release_lease(protocol)
    finally:
        protocol.release()


def _stop_instead(protocol: ControlProtocol) -> Procedure[None]:
    try:
        yield from stop(protocol.robot_id, protocol.operator, "it could not be disarmed")
    except RobotSilent:
        raise RobotSilent(
            f"{protocol.robot_id} could not be disarmed, nor stopped: it does not answer",
            "not_disarmed",
        ) from None


# Arming.


def arm(protocol: ControlProtocol, now_s: float) -> Procedure[None]:
    """Arm and wait until the robot is ready; returns immediately if it already is.

    Raises:
        RequestRefused: If the robot refuses or aborts arming, with its reason.
        RobotStopped: If it is stopped or faulty and needs a reset first.
        RobotSilent: If it sends no status.
    """
    end_s, settles_s = now_s + _ARMING_S, math.inf
    asked = begun = False
    while (mode := protocol.mode) is not Mode.READY:
        protocol.check_lease()
        if latched := protocol.latch_reason():
            why = protocol.latest_status.stop
            raise RobotStopped(f"{latched}; reset it first", f"robot_{mode}", why)
        if mode is Mode.DISARMED and not asked:
            lease = HolderRequest(protocol.lease_hex)
            now_s = yield from request(protocol, Service.ARM, lease, "arm")
            # A status sent before the response still shows a disarmed robot.
            asked, settles_s = True, now_s + max(_IN_FLIGHT_S, protocol.max_age_s)
            continue
        begun = begun or mode is not Mode.DISARMED
        if (mode is Mode.DISARMED and (begun or now_s >= settles_s)) or now_s >= end_s:
            status = protocol.latest_status
            reason = status.stop_reason or "it does not get ready"
            raise RequestRefused(protocol.robot_id, "arm", reason, status.stop)
        now_s = yield from _next_status(protocol, now_s)


def stay_ready(protocol: ControlProtocol, now_s: float, duration_s: float) -> Procedure[None]:
    """Check for `duration_s` that the robot stays ready, without commanding it."""
    end_s = now_s + duration_s
    while now_s < end_s:
        protocol.check_ready(now_s)
        now_s = yield from _next_status(protocol, now_s)


def _next_status(protocol: ControlProtocol, now_s: float) -> Procedure[float]:
    before = protocol.status_seq
    now_s = (yield NextStatus(now_s + STATUS_TIMEOUT_S)).now_s
    if protocol.status_seq == before:
        raise RobotSilent(
            f"{protocol.robot_id} has sent no status for {STATUS_TIMEOUT_S:g} s", "no_status"
        )
    return now_s
