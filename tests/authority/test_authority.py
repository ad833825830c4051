"""The modes: each way that the table names can be gone, in its conditions and in no others."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.authority.stage import Stage
from tsd_twin.authority import ARMED, LATCHED, TRANSITIONS, Mode
from tsd_twin.messages.service import StopRequest


def stop(stage: Stage) -> None:
    stage.authority.stop(StopRequest("bob"), stage.now_s)


def disarm(stage: Stage) -> None:
    assert stage.authority.disarm(stage.lease, stage.now_s).ok


def reset(stage: Stage) -> None:
    stage.wait(0.6)
    assert stage.authority.reset(stage.lease, stage.now_s).ok


def disarm_and_come_to_rest(stage: Stage) -> None:
    stage.send()
    disarm(stage)
    stage.wait(0.01, at_rest=True)


WAYS: dict[tuple[Mode, Mode], Callable[[Stage], object]] = {
    (Mode.DISARMED, Mode.ARMING): lambda s: s.authority.arm(s.lease, s.now_s),
    (Mode.ARMING, Mode.READY): lambda s: s.hold(2.1),
    (Mode.ARMING, Mode.DISARMED): disarm,
    (Mode.READY, Mode.DRIVING): lambda s: s.send(0.5),
    (Mode.READY, Mode.DISARMED): disarm,
    (Mode.DRIVING, Mode.READY): lambda s: s.hold(0.1, at_rest=True),
    (Mode.DRIVING, Mode.STOPPING): lambda s: s.wait(0.25),
    (Mode.STOPPING, Mode.DRIVING): lambda s: s.send(0.5),
    (Mode.STOPPING, Mode.READY): lambda s: s.wait(0.01, at_rest=True),
    (Mode.STOPPING, Mode.DISARMED): disarm_and_come_to_rest,
    (Mode.STOPPED, Mode.DISARMED): reset,
    (Mode.FAULT, Mode.DISARMED): reset,
    **{(mode, Mode.STOPPED): stop for mode in set(Mode) - LATCHED},
    **{(mode, Mode.FAULT): lambda s: s.wait(0.01, fault="it broke") for mode in ARMED},
}


@pytest.mark.parametrize(
    ("way", "go"), WAYS.items(), ids=lambda v: "-".join(v) if isinstance(v, tuple) else ""
)
def test_every_way_of_the_table_can_be_gone(
    way: tuple[Mode, Mode], go: Callable[[Stage], object], stage: Stage
) -> None:
    stage.bring_to(way[0])
    stage.authority.take_events()
    go(stage)
    assert stage.mode is way[1]
    changes = [event for event in stage.authority.take_events() if event.kind == "mode"]
    assert changes[-1].rule == TRANSITIONS[way]
    assert changes[-1].text.startswith(f"From {way[0]} to {way[1]}")


def test_the_table_names_these_ways_and_no_others() -> None:
    assert set(WAYS) == set(TRANSITIONS)


# Arming.


def test_arming_holds_zero_throttle_for_two_seconds_before_the_wheels_turn(stage: Stage) -> None:
    stage.bring_to(Mode.ARMING)
    stage.hold(1.98, at_speed=False)
    assert stage.mode is Mode.ARMING
    assert not stage.authority.wheels_spin
    assert stage.authority.arming(stage.now_s).phase == "hold"
    stage.hold(0.04)
    assert stage.authority.wheels_spin
    assert stage.authority.arming(stage.now_s).phase == "spin_up"
    stage.hold(0.5)
    assert stage.mode is Mode.ARMING
    stage.wait(0.01, at_speed=True)
    assert stage.mode is Mode.READY
    assert stage.authority.arming(stage.now_s) is None


def test_arming_shows_how_far_it_is(stage: Stage) -> None:
    stage.bring_to(Mode.ARMING)
    progress = []
    for _ in range(20):
        stage.hold(0.1, at_speed=False)
        status = stage.authority.arming(stage.now_s)
        progress.append((status.phase, status.progress))
    assert progress == sorted(progress)
    assert progress[9] == ("hold", pytest.approx(0.5))


def test_the_hold_starts_again_after_a_disarm(stage: Stage) -> None:
    stage.bring_to(Mode.ARMING)
    stage.hold(1.5)
    disarm(stage)
    stage.authority.arm(stage.lease, stage.now_s)
    stage.hold(1.5)
    assert not stage.authority.wheels_spin


def test_gimbals_that_do_not_come_to_neutral_end_arming(stage: Stage) -> None:
    stage.bring_to(Mode.ARMING)
    stage.hold(0.98, neutral=False)
    assert stage.mode is Mode.ARMING
    stage.hold(0.04)
    assert stage.mode is Mode.DISARMED
    assert "neutral" in stage.authority.reason


def test_gimbals_that_come_to_neutral_late_may_be_armed(stage: Stage) -> None:
    stage.bring_to(Mode.ARMING)
    stage.hold(0.5, neutral=False)
    stage.hold(2.0, neutral=True)
    assert stage.mode is Mode.READY


def test_wheels_that_do_not_come_to_speed_end_arming(stage: Stage) -> None:
    stage.bring_to(Mode.ARMING)
    stage.hold(6.9, at_speed=False)
    assert stage.mode is Mode.ARMING
    stage.hold(0.2)
    assert stage.mode is Mode.DISARMED
    assert not stage.authority.wheels_spin
    assert "speed" in stage.authority.reason


def test_only_the_holder_arms(stage: Stage) -> None:
    refused = stage.authority.arm("00" * 16, stage.now_s)
    assert (refused.ok, refused.reason) == (False, "take control first")
    stage.acquire("alice")
    refused = stage.authority.arm("00" * 16, stage.now_s)
    assert (refused.ok, refused.reason) == (False, "alice has control")
    assert stage.mode is Mode.DISARMED


@pytest.mark.parametrize("mode", [mode for mode in Mode if mode is not Mode.DISARMED])
def test_arming_starts_from_disarmed_only(stage: Stage, mode: Mode) -> None:
    stage.bring_to(mode)
    reply = stage.authority.arm(stage.lease, stage.now_s)
    assert not reply.ok
    assert str(mode) in reply.reason
    assert stage.mode is mode
    assert stage.authority.take_events()[-1].kind == "refusal"


# The deadman.


def test_without_commands_for_200_ms_the_robot_stops_by_itself(stage: Stage) -> None:
    stage.bring_to(Mode.DRIVING)
    stage.send(1.0)
    stage.wait(0.19)
    assert stage.mode is Mode.DRIVING
    stage.wait(0.03)
    assert stage.mode is Mode.STOPPING
    assert "200 ms" in stage.authority.reason
    assert stage.authority.command is None


def test_commands_that_do_not_count_keep_nothing_going(stage: Stage) -> None:
    stage.bring_to(Mode.DRIVING)
    for _ in range(30):
        stage.send(float("nan"))
        stage.send(1.0, operator="bob")
        stage.wait(0.01)
    assert stage.mode is Mode.STOPPING


def test_a_zero_while_stopping_does_not_drive_on(stage: Stage) -> None:
    stage.bring_to(Mode.STOPPING)
    assert stage.send()
    assert stage.mode is Mode.STOPPING


def test_a_zero_makes_a_ready_robot_no_driving_one(stage: Stage) -> None:
    stage.bring_to(Mode.READY)
    stage.hold(1.0)
    assert stage.mode is Mode.READY


@pytest.mark.parametrize("mode", [Mode.READY, Mode.ARMING])
def test_ten_seconds_without_an_operator_end_in_standing_wheels(stage: Stage, mode: Mode) -> None:
    stage.bring_to(mode)
    stage.ask("release", lease=stage.lease)
    stage.wait(9.9, at_speed=mode is Mode.READY, neutral=True)
    if mode is Mode.READY:
        assert stage.mode is Mode.READY
        stage.wait(0.2)
        assert "nobody" in stage.authority.reason
    assert stage.mode is Mode.DISARMED
    assert not stage.authority.wheels_spin


def test_an_operator_who_only_renews_keeps_the_wheels_turning(stage: Stage) -> None:
    stage.bring_to(Mode.READY)
    for _ in range(15):
        assert stage.ask("renew", lease=stage.lease).granted
        stage.wait(1.0)
    assert stage.mode is Mode.READY


def test_commands_renew_the_lease(stage: Stage) -> None:
    stage.bring_to(Mode.READY)
    stage.hold(5.0)
    assert stage.authority.holds(stage.lease, stage.now_s)
    stage.wait(2.1)
    assert not stage.authority.holds(stage.lease, stage.now_s)


# Changing hands.


def test_a_take_over_stops_the_robot_until_the_new_holder_drives(stage: Stage) -> None:
    stage.bring_to(Mode.DRIVING)
    old = stage.lease
    stage.acquire("bob", take_over=True)
    assert "bob took control over from alice" in stage.authority.take_events()[-1].text
    stage.wait(0.01)
    assert stage.mode is Mode.STOPPING
    new, stage.lease = stage.lease, old
    assert not stage.send(1.0, operator="alice")
    stage.lease = new
    assert stage.send(1.0, operator="bob")
    assert stage.mode is Mode.DRIVING
    assert stage.authority.command.operator == "bob"


def test_who_releases_control_stops_the_robot(stage: Stage) -> None:
    stage.bring_to(Mode.DRIVING)
    stage.ask("release", lease=stage.lease)
    stage.wait(0.01)
    assert stage.mode is Mode.STOPPING


def test_every_refused_lease_is_reported(stage: Stage) -> None:
    stage.acquire("alice")
    stage.authority.take_events()
    for op, fields in (
        ("acquire", {}),
        ("renew", {"lease": "ff" * 16}),
        ("release", {"lease": "ff" * 16}),
    ):
        assert not stage.ask(op, "bob", **fields).granted
        (event,) = stage.authority.take_events()
        assert (event.kind, op in event.text) == ("refusal", True)


# Disarming.


def test_disarmed_while_driving_it_stops_first_and_obeys_no_more(stage: Stage) -> None:
    stage.bring_to(Mode.DRIVING)
    disarm(stage)
    assert stage.mode is Mode.STOPPING
    stage.hold(0.1, 1.0, at_rest=False)
    assert stage.mode is Mode.STOPPING
    stage.wait(0.01, at_rest=True)
    assert stage.mode is Mode.DISARMED


def test_only_the_holder_disarms(stage: Stage) -> None:
    stage.bring_to(Mode.READY)
    assert not stage.authority.disarm("00" * 16, stage.now_s).ok
    assert stage.mode is Mode.READY


# Stop, fault and reset.


@pytest.mark.parametrize("mode", list(Mode))
def test_anybody_stops_it_from_every_mode(stage: Stage, mode: Mode) -> None:
    stage.bring_to(mode)
    stage.ask("release", lease=stage.lease)
    assert stage.authority.stop(StopRequest("bob"), stage.now_s).ok
    assert stage.mode in LATCHED
    assert not stage.authority.wheels_spin
    assert stage.authority.command is None


def test_a_second_stop_does_not_hide_why_the_first_was_made(stage: Stage) -> None:
    stage.bring_to(Mode.READY)
    stage.authority.stop(StopRequest("bob", "smoke"), stage.now_s)
    assert stage.authority.stop(StopRequest("carol"), stage.now_s).ok
    assert stage.authority.reason == "smoke"


def test_a_stop_says_who_made_it(stage: Stage) -> None:
    stop(stage)
    assert stage.authority.reason == "software stop by bob"


@pytest.mark.parametrize("mode", sorted(LATCHED))
def test_what_is_latched_stays_whatever_is_sent(stage: Stage, mode: Mode) -> None:
    stage.bring_to(mode)
    stage.hold(3.0, 1.0, at_rest=True)
    assert not stage.authority.arm(stage.lease, stage.now_s).ok
    stage.authority.disarm(stage.lease, stage.now_s)
    stage.wait(20.0)
    assert stage.mode is mode


def test_a_reset_needs_the_lease(stage: Stage) -> None:
    stage.bring_to(Mode.STOPPED)
    assert not stage.authority.reset("00" * 16, stage.now_s).ok
    assert stage.mode is Mode.STOPPED


def test_a_reset_needs_half_a_second_without_a_push(stage: Stage) -> None:
    stage.bring_to(Mode.STOPPED)
    stage.send(0.1)
    stage.wait(0.49)
    assert stage.authority.reset(stage.lease, stage.now_s).reason == "let go of the stick first"
    stage.send()
    stage.wait(0.02)
    assert stage.authority.reset(stage.lease, stage.now_s).ok


@pytest.mark.parametrize("mode", [mode for mode in Mode if mode not in LATCHED])
def test_only_what_is_latched_is_reset(stage: Stage, mode: Mode) -> None:
    stage.bring_to(mode)
    assert "not stopped" in stage.authority.reset(stage.lease, stage.now_s).reason
    assert stage.mode is mode


@pytest.mark.parametrize("mode", [Mode.DISARMED, Mode.STOPPED])
def test_a_fault_of_a_robot_at_rest_latches_nothing(stage: Stage, mode: Mode) -> None:
    stage.bring_to(mode)
    stage.wait(1.0, fault="it broke")
    assert stage.mode is mode


def test_a_fault_says_what_broke_and_outlives_its_cause(stage: Stage) -> None:
    stage.bring_to(Mode.DRIVING)
    stage.wait(0.01, fault="it broke")
    stage.wait(5.0, fault="")
    assert (stage.mode, stage.authority.reason) == (Mode.FAULT, "it broke")


# What is told about it.


def test_drops_are_told_five_times_a_second_at_most(stage: Stage) -> None:
    stage.acquire()
    stage.authority.take_events()
    for _ in range(100):
        stage.send(float("nan"))
        stage.send(1.0, operator="bob")
        stage.wait(0.01)
    events = [event for event in stage.authority.take_events() if event.kind == "drop"]
    by_rule = [[e for e in events if e.rule == rule] for rule in ("nonfinite", "lease")]
    assert [4 <= len(of_rule) <= 6 for of_rule in by_rule] == [True, True]
    assert len(events) == sum(map(len, by_rule))
    assert stage.authority.gate.dropped.nonfinite == 100
