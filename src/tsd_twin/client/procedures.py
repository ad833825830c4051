"""Procedures of an operator as generators, without I/O: take control, arm, drive, give back.

A procedure yields what it needs (`Call`, `Send`, `Sleep`, `NextStatus`, `Compute`) and is resumed
with an `Outcome`. A face that performs these steps runs every procedure: in a thread, on an event
loop, or in virtual time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeVar

import msgspec

from tsd_twin.client.errors import (
    ClientError,
    ControlDenied,
    MotionFailed,
    RequestRefused,
    RobotSilent,
    RobotStopped,
)
from tsd_twin.client.navigation import PlanLimits, plan
from tsd_twin.client.protocol import COMMAND_PERIOD_S, SILENCE_S, ControlProtocol, TwistCommand
from tsd_twin.errors import MessageError
from tsd_twin.lie import Array
from tsd_twin.messages.ros import BASE
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
from tsd_twin.messages.topics import Service
from tsd_twin.motion import TwistLimiter
from tsd_twin.motion.routes import NavigationGoal
from tsd_twin.motion.tracking import ExecutionPhase, TrajectoryExecutor
from tsd_twin.safety import LATCHED, Mode

T = TypeVar("T")
ReplyT = TypeVar("ReplyT", Reply, LeaseReply)

REST = (0.0, 0.0, 0.0)
_ARMING_S = 60.0
_REST_S = 10.0
_STILL_S = 0.5
_SETTLE_S = 3.0
"""The newest status shows the new holder long before that, or the robot is silent."""
_TRIES = 3
_ANSWER_S = 0.5
_STOP_TRIES, _STOP_ANSWER_S = 20, 0.1


@dataclass(frozen=True, slots=True)
class Call:
    """Step: call a service of the robot and wait for the response."""

    service: Service
    payload: bytes
    timeout_s: float = 1.0


@dataclass(frozen=True, slots=True)
class Send:
    """Step: publish a command."""

    command: TwistCommand


@dataclass(frozen=True, slots=True)
class SendStop:
    """Step: publish a stop without waiting for an acknowledgement."""

    payload: bytes


@dataclass(frozen=True, slots=True)
class Sleep:
    """Step: wait until a time."""

    until_s: float


@dataclass(frozen=True, slots=True)
class NextStatus:
    """Step: wait for the next status, or until a time."""

    until_s: float


@dataclass(frozen=True, slots=True)
class Compute:
    """Step: run a function that takes tens of milliseconds."""

    function: Callable[[], Any]


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of a step, with which a procedure is resumed."""

    now_s: float
    answer: bytes | None = None
    """Of a `Call`: None when there was no answer."""
    value: Any = None
    """Of a `Compute`."""


Step: TypeAlias = Call | Send | SendStop | Sleep | NextStatus | Compute
Procedure: TypeAlias = Generator[Step, Outcome, T]


# Requests.


def request(
    protocol: ControlProtocol, service: Service, message: msgspec.Struct, what: str
) -> Procedure[float]:
    """Send a request that the robot may refuse; `what` names it in the error. Return the time.

    Raises:
        RequestRefused: with the robot's own sentence.
        RobotSilent: there is no answer.
    """
    outcome = yield Call(service, msgspec.json.encode(message))
    reply = _decoded(outcome.answer, Reply)
    if reply is None:
        raise RobotSilent(f"{protocol.robot_id} does not answer")
    if not reply.ok:
        raise RequestRefused(protocol.robot_id, what, reply.reason)
    return outcome.now_s


def disarm(protocol: ControlProtocol, now_s: float) -> Procedure[None]:
    """Disarm, after a controlled stop when the robot drives; wait until the status shows it."""
    message = HolderRequest(protocol.lease_hex)
    yield from request(protocol, Service.DISARM, message, "disarm")
    yield from _until_mode(protocol, now_s, Mode.DISARMED, *LATCHED)


def reset(protocol: ControlProtocol, now_s: float) -> Procedure[None]:
    """Unlatch a stopped or faulty robot; wait until the status shows that it is disarmed."""
    yield from request(protocol, Service.RESET, HolderRequest(protocol.lease_hex), "reset")
    yield from _until_mode(protocol, now_s, Mode.DISARMED)


def _until_mode(protocol: ControlProtocol, now_s: float, *modes: Mode) -> Procedure[None]:
    end_s = now_s + _REST_S
    while protocol.mode not in modes:
        now_s = (yield NextStatus(end_s)).now_s
        if now_s >= end_s:
            raise RobotSilent(f"{protocol.robot_id} does not show that it is {modes[0]}")


def set_pose(
    protocol: ControlProtocol, x_m: float, y_m: float, heading_rad: float
) -> Procedure[None]:
    """Set the pose estimate; at rest only."""
    message = SetPoseRequest(protocol.lease_hex, x_m, y_m, heading_rad)
    yield from request(protocol, Service.SET_POSE, message, "set the pose")


def set_orientation(
    protocol: ControlProtocol, x: float, y: float, z: float, w: float
) -> Procedure[None]:
    """Set the orientation estimate of a sphere; at rest only."""
    message = SetOrientationRequest(protocol.lease_hex, (x, y, z, w))
    yield from request(protocol, Service.SET_POSE, message, "set the orientation")


def set_wheel_speed(protocol: ControlProtocol, rpm: float) -> Procedure[None]:
    """Set the speed of wheels that always spin, until they are shut off."""
    message = SpeedRequest(protocol.lease_hex, rpm)
    yield from request(protocol, Service.SPEED, message, "change the wheel speed")


def stop(robot_id: str, operator: str, reason: str) -> Procedure[None]:
    """Stop the robot and latch it; repeated until it is acknowledged.

    Raises:
        RobotSilent: it was not acknowledged.
    """
    message = StopRequest(operator, reason)
    for _ in range(_STOP_TRIES):
        yield SendStop(msgspec.json.encode(message))
        reply = yield from _ask(Service.STOP, message, Reply, _STOP_ANSWER_S)
        if reply is not None and reply.ok:
            return
    raise RobotSilent(f"{robot_id} did not acknowledge the stop")


def _ask(
    service: Service, message: msgspec.Struct, kind: type[ReplyT], timeout_s: float = 1.0
) -> Procedure[ReplyT | None]:
    answer = (yield Call(service, msgspec.json.encode(message), timeout_s)).answer
    return _decoded(answer, kind)


def _decoded(answer: bytes | None, kind: type[ReplyT]) -> ReplyT | None:
    if answer is None:
        return None
    try:
        return decode_json(answer, kind, "an answer")
    except MessageError:
        return None


# The lease.


def acquire(
    protocol: ControlProtocol,
    *,
    take_over: bool = False,
    max_age_s: float | None = None,
    reason: str = "",
) -> Procedure[None]:
    """Acquire the lease, and wait until the robot's status shows it.

    Raises:
        ControlDenied: another operator has it.
        RobotSilent: there is no answer.
    """
    wish = LeaseRequest(
        op="acquire",
        operator=protocol.operator,
        take_over=take_over,
        max_age_s=max_age_s,
        reason=reason,
    )
    outcome = yield Call(Service.LEASE, msgspec.json.encode(wish))
    reply, now_s = _decoded(outcome.answer, LeaseReply), outcome.now_s
    if reply is None:
        raise RobotSilent(f"{protocol.robot_id} does not answer")
    if not reply.granted:
        raise ControlDenied(protocol.robot_id, reply.reason, reply.holder)
    protocol.grant(reply, now_s)
    end_s = now_s + _SETTLE_S
    # A status in transit still shows the mode under the previous holder.
    while protocol.status is None or protocol.status.lease.holder != protocol.operator:
        now_s = (yield NextStatus(end_s)).now_s
        protocol.check_lease()
        if now_s >= end_s:
            raise RobotSilent(f"{protocol.robot_id} does not show who has control")


def ask_for_control(
    protocol: ControlProtocol, now_s: float, timeout_s: float, **wish: Any
) -> Procedure[None]:
    """Ask the holder for the lease, and acquire it once it is granted or free.

    Raises:
        ControlDenied: the holder keeps it, or does not answer in time.
        RobotSilent: the robot does not answer.
    """
    message = LeaseRequest(op="request", operator=protocol.operator)
    reply = yield from _ask(Service.LEASE, message, LeaseReply)
    if reply is None:
        raise RobotSilent(f"{protocol.robot_id} does not answer")
    if not reply.done and reply.holder is not None:
        raise ControlDenied(protocol.robot_id, reply.reason, reply.holder)
    if reply.holder is not None:
        yield from _until_granted(protocol, now_s, timeout_s, reply.holder)
    yield from acquire(protocol, **wish)


def _until_granted(
    protocol: ControlProtocol, now_s: float, timeout_s: float, holder: str
) -> Procedure[None]:
    """Wait until the lease is granted or free; an error withdraws the request."""
    settled_s, end_s = now_s + _SETTLE_S, now_s + timeout_s
    try:
        while not _is_free(protocol):
            if _is_asked(protocol):
                settled_s = now_s  # From now on, a status without the request is an answer.
            elif now_s > settled_s:
                raise ControlDenied(protocol.robot_id, f"{holder} keeps control", holder)
            if now_s >= end_s:
                raise ControlDenied(protocol.robot_id, f"{holder} does not answer", holder)
            now_s = (yield NextStatus(min(end_s, now_s + 0.5))).now_s
    except BaseException as error:
        if not isinstance(error, GeneratorExit):
            withdraw = LeaseRequest(op="withdraw", operator=protocol.operator)
            yield from _ask(Service.LEASE, withdraw, LeaseReply, _ANSWER_S)
        raise


def _is_asked(protocol: ControlProtocol) -> bool:
    status = protocol.status
    return status is not None and status.lease.asked_by == protocol.operator


def _is_free(protocol: ControlProtocol) -> bool:
    """Return whether the lease is free, or reserved for this operator."""
    if protocol.status is None:
        return False
    lease = protocol.status.lease
    free = lease.holder is None and lease.reserved_for is None
    return free or lease.reserved_for == protocol.operator


def answer_request(protocol: ControlProtocol, *, grant: bool, asker: str | None) -> Procedure[None]:
    """Hand control over to the operator who asks for it, or keep it.

    Raises:
        RequestRefused: no operator asks for it, or another one.
        ControlLost: the lease is not held.
    """
    status = protocol.status
    asker = asker or (status.lease.asked_by if status is not None else None)
    message = LeaseRequest(
        op="grant" if grant else "deny",
        operator=protocol.operator,
        lease=protocol.lease_hex,
        asker=asker,
    )
    reply = yield from _ask(Service.LEASE, message, LeaseReply)
    if reply is None:
        raise RobotSilent(f"{protocol.robot_id} does not answer")
    if not reply.done:
        what = "hand over control" if grant else "keep control"
        raise RequestRefused(protocol.robot_id, what, reply.reason)
    if grant:
        protocol.release()


def give_back(protocol: ControlProtocol, now_s: float) -> Procedure[None]:
    """Command zero, disarm and release; without the lease, do nothing.

    A robot that cannot be disarmed is stopped, unless another operator has control of it.

    Raises:
        RobotSilent: it does not answer, so it stops by itself, or has stopped.
    """
    if not protocol.has_lease:
        return
    lease = protocol.lease_hex
    protocol.end_motion()
    try:
        yield Send(protocol.command(REST, BASE, now_s))
        for _ in range(_TRIES):
            reply = yield from _ask(Service.DISARM, HolderRequest(lease), Reply, _ANSWER_S)
            if reply is not None and reply.ok:
                break
            peek = LeaseRequest(op="peek", operator=protocol.operator)
            seen = yield from _ask(Service.LEASE, peek, LeaseReply, _ANSWER_S)
            if seen is not None and seen.holder is not None:
                return
        else:
            yield from _stop_instead(protocol)
            return
        release = LeaseRequest(op="release", operator=protocol.operator, lease=lease)
        yield from _ask(Service.LEASE, release, LeaseReply, _ANSWER_S)
    finally:
        protocol.release()


def _stop_instead(protocol: ControlProtocol) -> Procedure[None]:
    try:
        yield from stop(protocol.robot_id, protocol.operator, "it could not be disarmed")
    except RobotSilent:
        raise RobotSilent(
            f"{protocol.robot_id} could not be disarmed, nor stopped: it does not answer"
        ) from None


# Arming.


def arm(protocol: ControlProtocol, now_s: float) -> Procedure[None]:
    """Arm, and wait until the robot is ready; a robot whose wheels spin already is ready.

    Raises:
        RequestRefused: the robot refuses, or gives arming up; with its own sentence.
        RobotStopped: it is stopped or faulty, and wants a reset first.
        RobotSilent: it says nothing.
    """
    end_s = now_s + _ARMING_S
    asked = False
    while (mode := protocol.mode) is not Mode.READY:
        protocol.check_lease()
        if latched := protocol.latch_reason():
            raise RobotStopped(f"{latched}; reset it first")
        if mode is Mode.DISARMED and not asked:
            lease = HolderRequest(protocol.lease_hex)
            now_s = yield from request(protocol, Service.ARM, lease, "arm")
            # A status from before the answer still shows a disarmed robot.
            asked = True
            now_s = yield from _next_status(protocol, now_s)
            now_s = yield from _next_status(protocol, now_s)
            continue
        if mode is Mode.DISARMED or now_s >= end_s:
            reason = protocol.status.stop_reason if protocol.status is not None else ""
            raise RequestRefused(protocol.robot_id, "arm", reason or "it does not get ready")
        now_s = yield from _next_status(protocol, now_s)


def _next_status(protocol: ControlProtocol, now_s: float) -> Procedure[float]:
    before = protocol.status_seq
    now_s = (yield NextStatus(now_s + SILENCE_S)).now_s
    if protocol.status_seq == before:
        raise RobotSilent(f"{protocol.robot_id} has sent no status for {SILENCE_S:g} s")
    return now_s


# Motions.


def drive(
    protocol: ControlProtocol, now_s: float, twist: Sequence[float], duration_s: float, frame: str
) -> Procedure[None]:
    """Command a twist for a time, then zero until the robot is at rest.

    Raises:
        ClientError: as `ControlProtocol.check_motion`, or the duration is no such number.
    """
    if not 0.0 <= duration_s < math.inf:
        raise ClientError(f"a duration is a number of seconds, not {duration_s}")
    now_s = yield from _finish_setpoint(protocol, now_s)
    protocol.begin_motion(now_s)
    end_s = now_s + duration_s
    try:
        while now_s < end_s - 1e-9:
            protocol.check_motion(now_s)
            yield Send(protocol.command(twist, frame, now_s))
            now_s = (yield Sleep(min(now_s + COMMAND_PERIOD_S, end_s))).now_s
        yield from _come_to_rest(protocol, now_s)
    except BaseException as error:
        yield from _zero(protocol, now_s, error)
        raise
    finally:
        protocol.end_motion()


def rest(protocol: ControlProtocol, now_s: float) -> Procedure[None]:
    """Command zero until the robot is at rest, whatever set-point is in force."""
    yield from drive(protocol, now_s, REST, 0.0, BASE)


def follow(
    protocol: ControlProtocol, now_s: float, goal: NavigationGoal, speed_mps: float | None
) -> Procedure[None]:
    """Follow a planned path closed loop over the odometry, until the goal.

    Raises:
        PathError: there is no such path.
        MotionFailed: the robot left the path, or did not get there.
        ClientError: as `ControlProtocol.check_motion`.
    """
    if speed_mps is not None and not 0.0 < speed_mps < math.inf:
        raise ClientError(f"a speed is a positive number of m/s, not {speed_mps}")
    now_s = yield from _finish_setpoint(protocol, now_s)
    protocol.begin_motion(now_s)
    try:
        start = protocol.pose(now_s)
        if goal.is_done(start):
            return
        limits = PlanLimits.in_force(protocol, speed_mps)
        outcome = yield Compute(lambda: plan(goal, start, limits))
        now_s = outcome.now_s
        follower = TrajectoryExecutor(
            outcome.value,
            lambda twist: _cap(protocol, twist, speed_mps),
            lag_s=protocol.robot.lag_s,
            delay_s=protocol.round_trip_s,
        )
        while True:
            protocol.check_motion(now_s)
            step = follower.advance(now_s, protocol.pose(now_s))
            if step.phase is not ExecutionPhase.GOING:
                break
            yield Send(protocol.command(step.twist, BASE, now_s))
            now_s = (yield Sleep(now_s + COMMAND_PERIOD_S)).now_s
        yield from _come_to_rest(protocol, now_s)
        if step.phase is ExecutionPhase.LOST:
            raise MotionFailed(f"{protocol.robot_id} stopped on its way: {step.reason}")
    except BaseException as error:
        yield from _zero(protocol, now_s, error)
        raise
    finally:
        protocol.end_motion()


def _cap(protocol: ControlProtocol, twist: Array, speed_mps: float | None) -> Array:
    limits = PlanLimits.in_force(protocol, speed_mps)
    return TwistLimiter(limits.kinematics, limits.limits).cap(twist)


def _zero(protocol: ControlProtocol, now_s: float, error: BaseException) -> Procedure[None]:
    """Send one zero after an error; a generator that is closed cannot send any more."""
    if protocol.has_lease and protocol.in_motion and not isinstance(error, GeneratorExit):
        yield Send(protocol.command(REST, BASE, now_s))


def _come_to_rest(protocol: ControlProtocol, now_s: float) -> Procedure[None]:
    first, still_s, end_s = None, None, now_s + _REST_S
    while True:
        protocol.check_motion(now_s)
        command = protocol.command(REST, BASE, now_s)
        first = command.seq if first is None else first
        yield Send(command)
        now_s = (yield Sleep(now_s + COMMAND_PERIOD_S)).now_s
        if protocol.at_rest_since(first):
            # The joints follow late; a noisy estimate never shows zero.
            still_s = now_s + _STILL_S if still_s is None else still_s
            if protocol.is_still() or now_s >= still_s:
                return
        if now_s > end_s:
            raise MotionFailed(f"{protocol.robot_id} does not come to rest")


def _finish_setpoint(protocol: ControlProtocol, now_s: float) -> Procedure[float]:
    """Let a velocity set-point end before another motion begins."""
    protocol.end_setpoint()
    end_s = now_s + _REST_S
    while protocol.has_setpoint:
        now_s = (yield Sleep(now_s + COMMAND_PERIOD_S)).now_s
        if now_s > end_s:
            raise MotionFailed(f"{protocol.robot_id} does not come to rest")
    protocol.raise_failure()
    return now_s
