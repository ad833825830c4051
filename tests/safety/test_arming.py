"""From standstill to an armed robot, and back without an operator."""

from __future__ import annotations

import pytest

from tests.safety.supervisor_harness import SupervisorHarness, disarm
from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.modes import Mode


def test_arming_holds_zero_throttle_for_two_seconds_before_the_wheels_turn(
    stage: SupervisorHarness,
) -> None:
    stage.bring_to(Mode.ARMING)
    stage.hold(1.98, at_speed=False)
    assert stage.mode is Mode.ARMING
    assert not stage.supervisor.wheels_spin
    assert stage.supervisor.arming(stage.now_s).phase == "hold"
    stage.hold(0.04)
    assert stage.supervisor.wheels_spin
    assert stage.supervisor.arming(stage.now_s).phase == "spin_up"
    stage.hold(0.5)
    assert stage.mode is Mode.ARMING
    stage.wait(0.01, at_speed=True)
    assert stage.mode is Mode.READY
    assert stage.supervisor.arming(stage.now_s) is None


def test_arming_shows_how_far_it_is(stage: SupervisorHarness) -> None:
    stage.bring_to(Mode.ARMING)
    progress = []
    for _ in range(20):
        stage.hold(0.1, at_speed=False)
        status = stage.supervisor.arming(stage.now_s)
        progress.append((status.phase, status.progress))
    assert progress == sorted(progress)
    assert progress[9] == ("hold", pytest.approx(0.5))


def test_the_hold_starts_again_after_a_disarm(stage: SupervisorHarness) -> None:
    stage.bring_to(Mode.ARMING)
    stage.hold(1.5)
    disarm(stage)
    stage.supervisor.arm(stage.lease, stage.now_s)
    stage.hold(1.5)
    assert not stage.supervisor.wheels_spin


def test_gimbals_that_do_not_come_to_neutral_end_arming(stage: SupervisorHarness) -> None:
    stage.bring_to(Mode.ARMING)
    stage.hold(0.98, neutral=False)
    assert stage.mode is Mode.ARMING
    stage.hold(0.04)
    assert stage.mode is Mode.DISARMED
    assert stage.supervisor.why == because(Code.NOT_NEUTRAL)


def test_gimbals_that_come_to_neutral_late_may_be_armed(stage: SupervisorHarness) -> None:
    stage.bring_to(Mode.ARMING)
    stage.hold(0.5, neutral=False)
    stage.hold(2.0, neutral=True)
    assert stage.mode is Mode.READY


def test_wheels_that_do_not_come_to_speed_end_arming(stage: SupervisorHarness) -> None:
    stage.bring_to(Mode.ARMING)
    stage.hold(6.9, at_speed=False)
    assert stage.mode is Mode.ARMING
    stage.hold(0.2)
    assert stage.mode is Mode.DISARMED
    assert not stage.supervisor.wheels_spin
    assert stage.supervisor.why == because(Code.NOT_AT_SPEED)


def test_only_the_holder_arms(stage: SupervisorHarness) -> None:
    refused = stage.supervisor.arm("00" * 16, stage.now_s)
    assert refused.why == because(Code.TAKE_CONTROL_FIRST)
    stage.acquire("alice")
    refused = stage.supervisor.arm("00" * 16, stage.now_s)
    assert refused.why == because(Code.HELD_BY, holder="alice")
    assert stage.mode is Mode.DISARMED


@pytest.mark.parametrize("mode", [mode for mode in Mode if mode is not Mode.DISARMED])
def test_arming_starts_from_disarmed_only(stage: SupervisorHarness, mode: Mode) -> None:
    stage.bring_to(mode)
    reply = stage.supervisor.arm(stage.lease, stage.now_s)
    assert not reply.ok
    assert reply.why.params["mode"] == mode
    assert stage.mode is mode
    assert stage.supervisor.take_events()[-1].kind == "refusal"


def test_without_commands_for_200_ms_the_robot_stops_by_itself(stage: SupervisorHarness) -> None:
    stage.bring_to(Mode.DRIVING)
    stage.send(1.0)
    stage.wait(0.19)
    assert stage.mode is Mode.DRIVING
    stage.wait(0.03)
    assert stage.mode is Mode.STOPPING
    assert stage.supervisor.why == because(Code.NO_COMMAND, ms=210, limit_ms=200)
    assert stage.supervisor.command is None


def test_commands_that_do_not_count_keep_nothing_going(stage: SupervisorHarness) -> None:
    stage.bring_to(Mode.DRIVING)
    for _ in range(30):
        stage.send(float("nan"))
        stage.send(1.0, operator="bob")
        stage.wait(0.01)
    assert stage.mode is Mode.STOPPING


def test_a_zero_while_stopping_does_not_drive_on(stage: SupervisorHarness) -> None:
    stage.bring_to(Mode.STOPPING)
    assert stage.send()
    assert stage.mode is Mode.STOPPING


def test_a_zero_makes_a_ready_robot_no_driving_one(stage: SupervisorHarness) -> None:
    stage.bring_to(Mode.READY)
    stage.hold(1.0)
    assert stage.mode is Mode.READY


@pytest.mark.parametrize("mode", [Mode.READY, Mode.ARMING])
def test_ten_seconds_without_an_operator_end_in_standing_wheels(
    stage: SupervisorHarness, mode: Mode
) -> None:
    stage.bring_to(mode)
    stage.ask("release", lease=stage.lease)
    stage.wait(9.9, at_speed=mode is Mode.READY, neutral=True)
    if mode is Mode.READY:
        assert stage.mode is Mode.READY
        stage.wait(0.2)
        assert stage.supervisor.why == because(Code.UNATTENDED, s=10)
    assert stage.mode is Mode.DISARMED
    assert not stage.supervisor.wheels_spin


def test_an_operator_who_only_renews_keeps_the_wheels_turning(stage: SupervisorHarness) -> None:
    stage.bring_to(Mode.READY)
    for _ in range(15):
        assert stage.ask("renew", lease=stage.lease).granted
        stage.wait(1.0)
    assert stage.mode is Mode.READY


def test_commands_renew_the_lease(stage: SupervisorHarness) -> None:
    stage.bring_to(Mode.READY)
    stage.hold(5.0)
    assert stage.supervisor.holder_refusal(stage.lease, stage.now_s) is None
    stage.wait(2.1)
    refusal = stage.supervisor.holder_refusal(stage.lease, stage.now_s)
    assert refusal == because(Code.TAKE_CONTROL_FIRST)
