"""Acceptance of commands, and effects of stop, fault and reset."""

from __future__ import annotations

import pytest

from tests.safety.supervisor_harness import SupervisorHarness, disarm, stop
from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.modes import LATCHED, Mode
from tsd_twin.messages.services import StopRequest

NOT_NOW = because(Code.AT_REST_ONLY)


def test_a_take_over_stops_the_robot_until_the_new_holder_drives(stage: SupervisorHarness) -> None:
    stage.bring_to(Mode.DRIVING)
    old = stage.lease
    stage.acquire("bob", take_over=True)
    assert stage.supervisor.take_events()[-1].why == because(
        Code.LEASE_TAKEN_OVER, operator="bob", other="alice"
    )
    stage.wait(0.01)
    assert stage.mode is Mode.STOPPING
    new, stage.lease = stage.lease, old
    assert not stage.send(1.0, operator="alice")
    stage.lease = new
    assert stage.send(1.0, operator="bob")
    assert stage.mode is Mode.STOPPING, "not out of the motion of another"
    stage.wait(0.01, at_rest=True)
    assert stage.mode is Mode.READY
    assert stage.send(1.0, operator="bob")
    assert stage.mode is Mode.DRIVING
    assert stage.supervisor.command.operator == "bob"


def test_who_releases_control_stops_the_robot(stage: SupervisorHarness) -> None:
    stage.bring_to(Mode.DRIVING)
    stage.ask("release", lease=stage.lease)
    stage.wait(0.01)
    assert stage.mode is Mode.STOPPING


def test_every_refused_lease_is_reported(stage: SupervisorHarness) -> None:
    stage.acquire("alice")
    stage.supervisor.take_events()
    for op, fields in (
        ("acquire", {}),
        ("renew", {"lease": "ff" * 16}),
        ("release", {"lease": "ff" * 16}),
    ):
        assert not stage.ask(op, "bob", **fields).granted
        (event,) = stage.supervisor.take_events()
        assert event.why.code == Code.REQUEST_REFUSED
        assert event.why.params == {"request": op}


# Disarming.


def test_disarmed_while_driving_it_stops_first_and_obeys_no_more(stage: SupervisorHarness) -> None:
    stage.bring_to(Mode.DRIVING)
    disarm(stage)
    assert stage.mode is Mode.STOPPING
    stage.hold(0.1, 1.0, at_rest=False)
    assert stage.mode is Mode.STOPPING
    stage.wait(0.01, at_rest=True)
    assert stage.mode is Mode.DISARMED


def test_only_the_holder_disarms(stage: SupervisorHarness) -> None:
    stage.bring_to(Mode.READY)
    assert not stage.supervisor.disarm("00" * 16, stage.now_s).ok
    assert stage.mode is Mode.READY


# Stop, fault and reset.


@pytest.mark.parametrize("mode", list(Mode))
def test_anybody_stops_it_from_every_mode(stage: SupervisorHarness, mode: Mode) -> None:
    stage.bring_to(mode)
    stage.ask("release", lease=stage.lease)
    assert stage.supervisor.stop(StopRequest("bob"), stage.now_s).ok
    assert stage.mode in LATCHED
    assert not stage.supervisor.wheels_spin
    assert stage.supervisor.command is None


def test_a_second_stop_does_not_hide_why_the_first_was_made(stage: SupervisorHarness) -> None:
    stage.bring_to(Mode.READY)
    stage.supervisor.stop(StopRequest("bob", "smoke"), stage.now_s)
    assert stage.supervisor.stop(StopRequest("carol"), stage.now_s).ok
    assert stage.supervisor.why == because(Code.STOP_WITH_TEXT, by="bob", text="smoke")


def test_a_stop_in_a_fault_is_a_stop_and_keeps_what_broke(stage: SupervisorHarness) -> None:
    stage.bring_to(Mode.READY)
    stage.wait(0.01, fault="it broke")
    assert (stage.mode, stage.supervisor.heartbeat.stopped) == (Mode.FAULT, False)
    stop(stage)
    assert (stage.mode, stage.supervisor.heartbeat.stopped) == (Mode.STOPPED, True)
    broke = because(Code.HARDWARE, text="it broke")
    assert stage.supervisor.why == because(Code.STOP_REQUESTED, broke, by="bob")


def test_a_stop_says_who_made_it(stage: SupervisorHarness) -> None:
    stop(stage)
    assert stage.supervisor.why == because(Code.STOP_REQUESTED, by="bob")


@pytest.mark.parametrize("mode", sorted(LATCHED))
def test_what_is_latched_stays_whatever_is_sent(stage: SupervisorHarness, mode: Mode) -> None:
    stage.bring_to(mode)
    stage.hold(3.0, 1.0, at_rest=True)
    assert not stage.supervisor.arm(stage.lease, stage.now_s).ok
    stage.supervisor.disarm(stage.lease, stage.now_s)
    stage.wait(20.0)
    assert stage.mode is mode


def test_a_reset_needs_the_lease(stage: SupervisorHarness) -> None:
    stage.bring_to(Mode.STOPPED)
    assert not stage.supervisor.reset("00" * 16, stage.now_s).ok
    assert stage.mode is Mode.STOPPED


def test_a_reset_needs_half_a_second_without_a_push(stage: SupervisorHarness) -> None:
    stage.bring_to(Mode.STOPPED)
    stage.send(0.1)
    stage.wait(0.49)
    refused = stage.supervisor.reset(stage.lease, stage.now_s)
    assert refused.why == because(Code.RELEASE_FIRST)
    stage.send()
    stage.wait(0.02)
    assert stage.supervisor.reset(stage.lease, stage.now_s).ok


@pytest.mark.parametrize("mode", [mode for mode in Mode if mode not in LATCHED])
def test_only_what_is_latched_is_reset(stage: SupervisorHarness, mode: Mode) -> None:
    stage.bring_to(mode)
    assert stage.supervisor.reset(stage.lease, stage.now_s).why.code == Code.NOT_LATCHED
    assert stage.mode is mode


@pytest.mark.parametrize("mode", [Mode.DISARMED, Mode.STOPPED])
def test_a_fault_of_a_robot_at_rest_latches_nothing(stage: SupervisorHarness, mode: Mode) -> None:
    stage.bring_to(mode)
    stage.wait(1.0, fault="it broke")
    assert stage.mode is mode


def test_a_fault_says_what_broke_and_outlives_its_cause(stage: SupervisorHarness) -> None:
    stage.bring_to(Mode.DRIVING)
    stage.wait(0.01, fault="it broke")
    stage.wait(5.0, fault="")
    assert stage.mode is Mode.FAULT
    assert stage.supervisor.why == because(Code.HARDWARE, text="it broke")


# Events.


def test_drops_are_told_five_times_a_second_at_most(stage: SupervisorHarness) -> None:
    stage.acquire()
    stage.supervisor.take_events()
    for _ in range(100):
        stage.send(float("nan"))
        stage.send(1.0, operator="bob")
        stage.wait(0.01)
    events = [event for event in stage.supervisor.take_events() if event.kind == "drop"]
    by_rule = [[e for e in events if e.rule == rule] for rule in ("nonfinite", "lease")]
    assert [4 <= len(of_rule) <= 6 for of_rule in by_rule] == [True, True]
    assert len(events) == sum(map(len, by_rule))
    assert stage.supervisor.gate.dropped.nonfinite == 100


def test_refusals_are_told_five_times_a_second_at_most_and_answered_each(
    stage: SupervisorHarness,
) -> None:
    stage.supervisor.take_events()
    for _ in range(100):
        assert not stage.supervisor.arm("00" * 16, stage.now_s).ok
        assert not stage.supervisor.refuse("set_pose", NOT_NOW, stage.now_s).ok
        stage.wait(0.01)
    events = [event for event in stage.supervisor.take_events() if event.kind == "refusal"]
    by_rule = [[e for e in events if e.rule == rule] for rule in ("arm", "set_pose")]
    assert [4 <= len(of_rule) <= 6 for of_rule in by_rule] == [True, True]
