"""Arming the board: only on request, and never again automatically."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.hardware.controller_board import ANSWERS, STOP, ArmSwitch
from tsd_twin.hardware.dynamixel.control_table import BoardMode, Refusal, Telemetry, Trip
from tsd_twin.messages.codes import Code, because

UNPLUGGED = because(Code.BOARD_LOST)

OFF = Telemetry(mode=BoardMode.DISARMED)
ON = Telemetry(mode=BoardMode.ARMED)


def armed() -> ArmSwitch:
    switch = ArmSwitch()
    assert switch.turn(True) == 1
    switch.update(ON)
    return switch


def test_a_robot_that_is_not_armed_asks_for_nothing() -> None:
    switch = ArmSwitch()
    assert switch.turn(False) == 0
    switch.update(OFF)
    assert switch.lost is None


def test_it_stays_on_while_the_board_is() -> None:
    switch = armed()
    for _ in range(100):
        assert switch.turn(True) == 1
        switch.update(ON)
    assert switch.lost is None
    assert switch.turn(False) == 0


def test_a_board_that_trips_is_not_asked_again_until_the_robot_was_disarmed() -> None:
    switch = armed()
    switch.update(Telemetry(trip=Trip.HEARTBEAT))
    assert switch.lost == because(Code.BOARD_TRIP, trip="heartbeat")
    for _ in range(100):
        assert switch.turn(True) == 0
        switch.update(ON)
    assert switch.turn(False) == 0
    assert switch.lost is None
    assert switch.turn(True) == 1


def test_a_refusal_is_said_once_there_was_time_for_an_answer() -> None:
    switch = ArmSwitch()
    switch.turn(True)
    refused = Telemetry(refusal=Refusal.SERVO)
    for _ in range(ANSWERS - 1):
        switch.update(refused)
        assert switch.lost is None
    switch.update(refused)
    assert switch.lost == because(Code.BOARD_REFUSES, what="servo")
    assert switch.turn(True) == 0


def test_a_stop_is_written_as_such_and_is_no_loss() -> None:
    switch = armed()
    assert switch.turn(False, stop=True) == STOP
    switch.update(Telemetry(trip=Trip.STOPPED))
    assert switch.lost is None
    assert switch.turn(False) == 0, "the reset releases it"
    assert switch.turn(True) == 1


def test_a_board_that_is_lost_while_off_is_no_loss() -> None:
    switch = ArmSwitch()
    switch.mark_lost(UNPLUGGED)
    assert switch.lost is None
    assert switch.turn(True) == 1
    switch.mark_lost(UNPLUGGED)
    assert switch.lost == UNPLUGGED
    assert switch.turn(True) == 0


def test_unknown_trip_is_no_error() -> None:
    switch = armed()
    switch.update(Telemetry(trip=77))
    assert switch.lost == because(Code.BOARD_TRIP, trip="trip 77")


EVENTS = st.lists(st.sampled_from(["arm", "disarm", "on", "off", "lose", "cycle"]), max_size=60)


@given(EVENTS)
def test_between_two_times_off_it_is_asked_for_on_at_most_once(events: list[str]) -> None:
    """Whatever happens in between: 0 to 1 is written only right after the robot was disarmed."""
    switch, wanted = ArmSwitch(), False
    before, rises_allowed = 0, True
    for event in events:
        if event in ("arm", "disarm"):
            wanted = event == "arm"
        elif event in ("on", "off"):
            switch.update(ON if event == "on" else OFF)
        elif event == "lose":
            switch.mark_lost(UNPLUGGED)
        written = switch.turn(wanted)
        if not wanted:
            assert written == 0
            rises_allowed = True
        elif written > before:
            assert rises_allowed
            rises_allowed = False
        elif written < before:
            assert switch.lost
        before = written
