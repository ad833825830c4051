"""Procedures, step by step, against a robot that replies late, wrongly or not at all."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from tests.client.test_protocol import LEASE, ROBOT, granted, speed, status
from tsd_twin.client import (
    ControlDenied,
    ControlLost,
    MotionFailed,
    RequestRefused,
    RobotSilent,
    RobotStopped,
    motions,
)
from tsd_twin.client import procedures as steps
from tsd_twin.client.port import (
    Call,
    Compute,
    NextStatus,
    Outcome,
    Procedure,
    SendStop,
    Sleep,
)
from tsd_twin.client.protocol import ControlProtocol, TwistCommand
from tsd_twin.messages.services import HolderRequest, LeaseReply, LeaseRequest, Reply
from tsd_twin.messages.status import CommandStatus, DropCounts, Refusals
from tsd_twin.messages.topics import Service

OK = msgspec.json.encode(Reply(True))
REFUSED = msgspec.json.encode(Reply(False, "a gimbal is not at neutral"))


def answered(procedure: Procedure[None], *answers: tuple[float, bytes | None]) -> Call:
    """Answer each call in turn at a time, and return the next call."""
    step = next(procedure)
    for now_s, answer in answers:
        step = procedure.send(Outcome(now_s, answer))
    assert isinstance(step, Call)
    return step


def test_a_late_grant_is_not_lost_by_a_status_that_was_under_way() -> None:
    """The reply takes 0.8 s, and the next status was sent before it."""
    protocol = ControlProtocol("tsd", ROBOT, "alice")
    protocol.receive_status(status(holder=None), 1, 0.0)
    procedure = steps.acquire(protocol)
    assert isinstance(next(procedure), Call)
    reply = LeaseReply(True, LEASE, "alice", 2.0, "", 0.25)
    assert isinstance(procedure.send(Outcome(0.8, msgspec.json.encode(reply))), NextStatus)
    protocol.receive_status(status(holder=None), 2, 0.82)
    assert isinstance(procedure.send(Outcome(0.82)), NextStatus)
    protocol.receive_status(status(holder="alice"), 3, 0.87)
    with pytest.raises(StopIteration):
        procedure.send(Outcome(0.87))
    assert protocol.has_lease


def test_a_refused_lease_names_the_holder() -> None:
    procedure = steps.acquire(ControlProtocol("tsd", ROBOT, "alice"), reason="my turn")
    call = answered(procedure)
    assert msgspec.json.decode(call.payload, type=LeaseRequest).reason == "my turn"
    reply = LeaseReply(False, holder="bob", reason="bob drives; ask for control or take over")
    with pytest.raises(ControlDenied, match="bob drives") as denied:
        procedure.send(Outcome(0.1, msgspec.json.encode(reply)))
    assert denied.value.holder == "bob"


@pytest.mark.parametrize("answer", [None, b"", b"[]", b"\xff"])
def test_no_answer_and_one_that_cannot_be_read_are_silence(answer: bytes | None) -> None:
    protocol = ControlProtocol("tsd", ROBOT, "alice")
    for procedure in (steps.acquire(protocol), steps.ask_for_control(protocol, 0.0, 15.0)):
        next(procedure)
        with pytest.raises(RobotSilent):
            procedure.send(Outcome(1.0, answer))


def test_a_refusal_to_arm_has_the_sentence_of_the_robot() -> None:
    protocol = granted()
    protocol.receive_status(status("disarmed"), 2, 0.1)
    procedure = steps.arm(protocol, 0.1)
    assert answered(procedure).service is Service.ARM
    with pytest.raises(RequestRefused, match="tsd refuses to arm: a gimbal is not at neutral"):
        procedure.send(Outcome(0.2, REFUSED))


def test_a_reset_waits_for_the_time_without_a_push_that_the_robot_wants() -> None:
    protocol = granted()
    held = Refusals(reset="let go of the stick first")
    protocol.receive_status(status("stopped", refusals=held), 2, 0.1)
    procedure = steps.reset(protocol, 0.1)
    assert isinstance(next(procedure), NextStatus)
    assert isinstance(procedure.send(Outcome(0.15)), NextStatus)
    protocol.receive_status(status("stopped", refusals=Refusals()), 3, 0.6)
    call = procedure.send(Outcome(0.6))
    assert isinstance(call, Call)
    assert call.service is Service.RESET


def test_a_reset_that_the_robot_refuses_for_long_is_refused() -> None:
    protocol = granted()
    held = Refusals(reset="let go of the stick first")
    protocol.receive_status(status("stopped", refusals=held), 2, 0.1)
    procedure = steps.reset(protocol, 0.1)
    assert isinstance(next(procedure), NextStatus)
    assert isinstance(procedure.send(Outcome(10.0)), Call)
    refusal = Outcome(10.1, msgspec.json.encode(Reply(False, "let go of the stick first")))
    with pytest.raises(RequestRefused, match="let go of the stick first"):
        procedure.send(refusal)


def test_a_robot_that_falls_silent_while_arming_is_not_waited_for() -> None:
    protocol = granted()
    protocol.receive_status(status("disarmed"), 2, 0.1)
    procedure = steps.arm(protocol, 0.1)
    answered(procedure)
    assert isinstance(procedure.send(Outcome(0.2, OK)), NextStatus)
    with pytest.raises(RobotSilent):
        procedure.send(Outcome(1.2))


def test_a_robot_that_gives_arming_up_says_why() -> None:
    protocol = granted()
    protocol.receive_status(status("disarmed"), 2, 0.1)
    procedure = steps.arm(protocol, 0.1)
    answered(procedure)
    step = procedure.send(Outcome(0.2, OK))
    for number, mode in enumerate(("disarmed", "arming", "arming"), start=3):
        assert isinstance(step, NextStatus)
        protocol.receive_status(status(mode), number, 0.05 * number)
        step = procedure.send(Outcome(0.05 * number))
    why = "not armed: the wheels did not come to speed"
    protocol.receive_status(status("disarmed", stop_reason=why), 6, 5.0)
    with pytest.raises(RequestRefused, match=why):
        procedure.send(Outcome(5.0))


@pytest.mark.parametrize("error", [KeyboardInterrupt(), SystemExit(), ValueError("a mistake")])
def test_whatever_interrupts_a_drive_sends_a_zero_first(error: BaseException) -> None:
    protocol = granted()
    procedure = motions.drive(protocol, 0.0, (0.3, 0.0, 0.0), 10.0, "base_link")
    sent = next(procedure)
    assert isinstance(sent, TwistCommand)
    assert speed(sent) == pytest.approx(0.3)
    assert isinstance(procedure.send(Outcome(0.0)), Sleep)
    last = procedure.throw(error)
    assert isinstance(last, TwistCommand)
    assert speed(last) == 0.0
    assert last.seq > sent.seq
    with pytest.raises(type(error)):
        procedure.send(Outcome(0.01))
    assert not protocol.in_motion


def test_who_has_lost_control_sends_no_zero_to_the_robot_of_another() -> None:
    protocol = granted()
    procedure = motions.drive(protocol, 0.0, (0.3, 0.0, 0.0), 10.0, "base_link")
    next(procedure)
    procedure.send(Outcome(0.0))
    protocol.receive_status(status("stopping", holder="bob", stops=1), 2, 1.0)
    with pytest.raises(ControlLost) as lost:
        procedure.send(Outcome(1.0))
    assert (lost.value.code, lost.value.params) == ("has_control_now", {"holder": "bob"})
    assert list(steps.give_back(protocol, 1.0)) == []


def test_a_motion_does_not_go_on_after_the_robot_stopped_by_itself() -> None:
    """Even after a short stop: `stops` has increased, although the mode is ready again."""
    protocol = granted()
    procedure = motions.drive(protocol, 0.0, (0.3, 0.0, 0.0), 10.0, "base_link")
    next(procedure)
    procedure.send(Outcome(0.0))
    protocol.receive_status(status("ready", stops=1, stop_reason="no command for 200 ms"), 2, 0.5)
    step = procedure.send(Outcome(0.5))
    assert isinstance(step, TwistCommand)
    assert speed(step) == 0.0
    with pytest.raises(RobotStopped, match="no command for 200 ms"):
        procedure.send(Outcome(0.51))


@pytest.mark.parametrize("stale", [0, 30])
def test_a_path_without_progress_says_how_many_commands_came_too_late(stale: int) -> None:
    protocol, now_s, sent = granted(), 0.0, 0

    def news(stale: int) -> None:
        command = CommandStatus(seq=sent, dropped=DropCounts(stale=stale))
        protocol.receive_status(status(command=command), protocol.status_seq + 1, now_s)
        protocol.receive_odometry(np.zeros(3), np.zeros(3), now_s)

    news(7)
    procedure = motions.follow(protocol, now_s, motions.goal_at(1.0, 0.0, None), None)
    step, failure = next(procedure), ""
    while not failure:
        if isinstance(step, Sleep):
            now_s = step.until_s
        elif isinstance(step, TwistCommand):
            sent = step.seq
        news(7 + stale)
        value = step.function() if isinstance(step, Compute) else None
        try:
            step = procedure.send(Outcome(now_s, value=value))
        except MotionFailed as error:
            failure = str(error)
    late = f"; {stale} commands came too late and were dropped" if stale else ""
    assert failure.startswith("tsd stopped on its way: ")
    assert failure.endswith(late)
    assert ("came too late" in failure) == bool(stale)


def test_a_robot_that_cannot_be_disarmed_is_stopped() -> None:
    """Two attempts get no reply; the third is refused, and no operator has control."""
    protocol = granted()
    procedure = steps.give_back(protocol, 0.0)
    zero = next(procedure)
    assert isinstance(zero, TwistCommand)
    assert speed(zero) == 0.0
    step, services = procedure.send(Outcome(0.0)), list[Service]()
    free = msgspec.json.encode(LeaseReply(False))
    for answer in (None, None, None, None, REFUSED, free):
        assert isinstance(step, Call)
        services.append(step.service)
        if step.service is Service.DISARM:
            assert msgspec.json.decode(step.payload, type=HolderRequest).lease == LEASE
        step = procedure.send(Outcome(0.0, answer))
    assert services == [Service.DISARM, Service.LEASE] * 3
    assert isinstance(step, SendStop), "it is published before it is asked for"
    step = procedure.send(Outcome(0.0))
    assert isinstance(step, Call)
    assert step.service is Service.STOP
    with pytest.raises(StopIteration):
        procedure.send(Outcome(0.0, OK))
    assert not protocol.has_lease


def test_a_robot_of_another_operator_is_neither_disarmed_nor_stopped() -> None:
    procedure = steps.give_back(granted(), 0.0)
    next(procedure)
    step = procedure.send(Outcome(0.0))
    assert isinstance(step, Call)
    peek = procedure.send(Outcome(0.0, REFUSED))
    assert isinstance(peek, Call)
    assert msgspec.json.decode(peek.payload, type=LeaseRequest).op == "peek"
    with pytest.raises(StopIteration):
        procedure.send(Outcome(0.0, msgspec.json.encode(LeaseReply(False, holder="bob"))))
