"""A paused control loop is blamed on its computer, not on joints or operators."""

from __future__ import annotations

import pytest

from tests.support.controller_harness import PERIOD_S, ControllerHarness
from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.modes import Mode

AHEAD = (0.5, 0.0, 0.0)


@pytest.fixture
def rig() -> ControllerHarness:
    return ControllerHarness()


def test_joints_that_a_paused_loop_has_not_measured_are_a_fault_with_its_cause(
    rig: ControllerHarness,
) -> None:
    pilot = rig.get_ready()
    rig.drive(pilot, AHEAD, 0.2)
    rig.controller.take_events()
    rig.measures = False  # The watchdog of the board has tripped.
    rig.tick(0.34)
    assert rig.mode is Mode.FAULT
    assert rig.status().stop == because(Code.JOINTS_SILENT_LOOP_LATE, ms=340)
    kinds = [event.kind for event in rig.controller.take_events()]
    assert sorted(kinds) == ["loop", "mode"]


def test_joints_that_are_not_measured_by_a_punctual_loop_are_a_fault_as_before(
    rig: ControllerHarness,
) -> None:
    pilot = rig.get_ready()
    rig.drive(pilot, AHEAD, 0.2)
    rig.measures = False
    rig.drive(pilot, AHEAD, 0.12)
    assert rig.mode is Mode.FAULT
    assert rig.status().stop == because(Code.JOINTS_SILENT, ms=100)


def test_a_shorter_pause_is_a_warning_and_the_robot_goes_on(rig: ControllerHarness) -> None:
    pilot = rig.get_ready()
    rig.drive(pilot, AHEAD, 0.2)
    rig.controller.take_events()
    rig.send(pilot, AHEAD)
    rig.tick(0.08)
    assert rig.mode is Mode.DRIVING
    (event,) = rig.controller.take_events()
    assert (event.kind, event.why) == ("loop", because(Code.LOOP_LATE, ms=80))


@pytest.mark.parametrize("arrived", [True, False])
def test_a_stop_after_a_pause_names_the_pause_whether_commands_waited_or_not(
    rig: ControllerHarness, arrived: bool
) -> None:
    pilot = rig.get_ready()
    rig.drive(pilot, AHEAD, 0.2)
    if arrived:
        rig.send(pilot, AHEAD)
    rig.tick(0.3)
    assert rig.mode is Mode.STOPPING
    assert rig.status().stop == because(Code.LOOP_LATE, ms=300)


def test_an_operator_who_is_gone_is_not_excused_by_a_pause_long_before(
    rig: ControllerHarness,
) -> None:
    pilot = rig.get_ready()
    rig.drive(pilot, AHEAD, 0.2)
    rig.tick(0.08)
    rig.drive(pilot, AHEAD, 0.3)
    while rig.mode is Mode.DRIVING:
        rig.tick(PERIOD_S)
    assert rig.status().stop.code in (Code.NO_COMMAND, Code.ECHO_TOO_OLD)
