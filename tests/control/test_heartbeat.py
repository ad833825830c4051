"""Operator activity feeds the timeout of a board; a running control loop alone does not."""

from __future__ import annotations

from typing import cast

import pytest

from tests.support.controller_harness import ControllerHarness
from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.modes import ARMED, Mode
from tsd_twin.messages.services import Reply
from tsd_twin.messages.topics import Service
from tsd_twin.node import PERIOD_S

HAS_IT = because(Code.RADIO_CONTROL)


def words(rig: ControllerHarness) -> int:
    return rig.controller.supervisor.heartbeat.counter


def longest_silence_s(rig: ControllerHarness, seconds: float) -> float:
    """Return the longest time without a heartbeat change while the harness runs."""
    longest = silent = 0.0
    before = words(rig)
    for _ in range(round(seconds / PERIOD_S)):
        rig.tick()
        silent = 0.0 if words(rig) != before else silent + PERIOD_S
        before, longest = words(rig), max(longest, silent)
    return longest


def mode_of(rig: ControllerHarness) -> Mode:
    """Return the mode without narrowing its type for the type checker."""
    return cast(Mode, rig.controller.supervisor.mode)


def test_nobody_vouches_for_a_robot_that_is_not_armed(rig: ControllerHarness) -> None:
    before = words(rig)
    rig.wait(3.0)
    assert words(rig) == before
    assert not rig.controller.supervisor.heartbeat.armed


def test_at_rest_with_spinning_wheels_it_is_vouched_for_until_nobody_attends(
    rig: ControllerHarness,
) -> None:
    pilot = rig.get_ready()
    rig.ask(Service.LEASE, op="release", operator="alice", lease=pilot.lease)
    assert longest_silence_s(rig, 9.9) < 0.02
    rig.wait(0.3)
    assert mode_of(rig) is Mode.DISARMED
    assert longest_silence_s(rig, 1.0) > 0.9


def test_while_driving_each_counted_command_is_a_word_and_nothing_else(
    rig: ControllerHarness,
) -> None:
    pilot = rig.get_ready()
    rig.drive(pilot, (0.5, 0.0, 0.0), 1.0)
    assert mode_of(rig) is Mode.DRIVING
    before, accepted = words(rig), rig.controller.supervisor.gate.accepted
    rig.drive(pilot, (0.5, 0.0, 0.0), 1.0)
    rig.wait(0.1)
    counted = rig.controller.supervisor.gate.accepted - accepted
    assert counted > 40
    assert words(rig) - before == counted


def test_commands_that_do_not_count_are_no_words(rig: ControllerHarness) -> None:
    pilot = rig.get_ready()
    rig.drive(pilot, (0.5, 0.0, 0.0), 0.5)
    before = words(rig)
    for _ in range(5):
        rig.inbox.append(rig.sample(pilot, (0.5, 0.0, 0.0), seq=1))
        rig.inbox.append(rig.sample(pilot, (float("nan"), 0.0, 0.0)))
        rig.tick()
    assert mode_of(rig) is Mode.DRIVING
    assert words(rig) == before


def test_the_words_cease_with_the_commands_and_a_controlled_stop_is_one_more(
    rig: ControllerHarness,
) -> None:
    pilot = rig.get_ready()
    rig.drive(pilot, (1.0, 0.0, 0.0), 1.0)
    before, changes = words(rig), 0
    while mode_of(rig) is not Mode.READY:
        rig.tick()
        if mode_of(rig) is not Mode.READY:
            changes += words(rig) != before
            before = words(rig)
    assert changes == 1


@pytest.mark.parametrize("ends", [Service.STOP, Service.DISARM])
def test_who_is_armed_says_so_and_who_is_not_does_not(
    rig: ControllerHarness, ends: Service
) -> None:
    pilot = rig.get_ready()
    assert mode_of(rig) in ARMED
    assert rig.controller.supervisor.heartbeat.armed
    rig.ask(ends, lease=pilot.lease)
    rig.tick()
    assert not rig.controller.supervisor.heartbeat.armed


def test_what_the_board_objects_to_is_a_fault_while_armed_and_refuses_arming(
    rig: ControllerHarness,
) -> None:
    pilot = rig.get_ready()
    rig.controller.step(rig.now_s + PERIOD_S, rig.measure(), (), HAS_IT)
    assert mode_of(rig) is Mode.FAULT
    assert rig.status().stop == HAS_IT
    rig.now_s += 1.0
    assert rig.ask(Service.RESET, lease=pilot.lease).ok
    rig.controller.step(rig.now_s, rig.measure(), (), HAS_IT)
    reply = rig.ask(Service.ARM, lease=pilot.lease)
    assert reply == Reply.refused(HAS_IT)
    rig.tick()
    assert rig.ask(Service.ARM, lease=pilot.lease).ok
