"""Rules of the firmware for what it keeps of trips, and for the light that shows them."""

from __future__ import annotations

from collections.abc import Callable

from firmware.simulator.mx64 import Mx64
from tests.firmware.source_rules import BATTERY, STOP, Source, jam
from tests.firmware.wheel_rules import PULSES, SENSORS
from tests.support.firmware_host import CRUISE, HOLD_S, Bench, FirmwareHost, number
from tsd_twin.hardware.dynamixel.control_table import (
    BoardMode,
    Telemetry,
    Trip,
    TripHistory,
    blinks,
)

_STORED_S = 0.06
"""After this a trip is in EEPROM, or in flash."""
_DIP_V = 10.9
_LIMIT_S = 0.5
"""Longer blinks are long ones, and darker times are pauses."""
_LOOK_S = 0.02
_PERIOD_S = 8.0
"""No code takes longer."""


def _before(new: tuple[Trip, ...], old: TripHistory) -> tuple[int, ...]:
    return (*new, *old.past_trip)[: len(old.past_trip)]


def _stop(pilot: FirmwareHost) -> None:
    assert pilot.arm().mode == BoardMode.ARMED
    pilot.drive(0.1)
    pilot.ask(pilot.command(STOP))
    assert pilot.telemetry().trip == Trip.STOPPED


def trips_are_kept_over_arming_and_without_power(bench: Bench) -> None:
    pilot = bench.pilot(receiver=True).get_ready()
    assert pilot.history() == TripHistory()
    assert pilot.arm().mode == BoardMode.ARMED
    pilot.simulation.set_battery(_DIP_V)
    pilot.drive(0.2)
    pilot.simulation.set_battery(12.0)
    pilot.drive(0.1)
    pilot.simulation.run(0.6)
    at_s = pilot.telemetry().millis // 1000
    first = pilot.history()
    assert first.past_trip == _before((Trip.HEARTBEAT,), TripHistory())
    assert abs(first.past_lowest[0] - 10.0 * _DIP_V) <= 1
    assert 0 <= at_s - first.past_uptime_s[0] <= 1
    assert first.past_start[0] == pilot.telemetry().nonce[0] % 256
    # The radio control takes over, and is switched off before the first trip is stored.
    pilot.cycle(0)
    assert pilot.arm().mode == BoardMode.ARMED
    pilot.drive(0.1)
    pilot.simulation.set_switches(manual=True)
    while number(pilot, "mode") != BoardMode.RC:
        pilot.simulation.run(0.001)
    pilot.ask(pilot.command(STOP))
    seen = pilot.history()
    assert seen.past_trip == _before((Trip.STOPPED, Trip.RC_TOOK_OVER), first)
    assert abs(seen.past_lowest[0] - 120) <= 1, "since it got the robot"
    pilot.simulation.run(_STORED_S)
    pilot.simulation.power_cycle()
    pilot.simulation.run(0.1)
    assert pilot.history() == seen
    assert pilot.telemetry().nonce[0] % 256 == seen.past_start[0] + 1
    pilot.simulation.board.hang()
    pilot.simulation.run(0.5)
    assert pilot.history().past_trip == _before((Trip.WATCHDOG,), seen)


def a_trip_that_was_not_completely_stored_is_none(bench: Bench) -> None:
    pilot = bench.pilot()
    for stored_s in (0.0, 0.004, 0.012, 0.022):
        pilot.get_ready()
        before = pilot.history()
        _stop(pilot)
        after = pilot.history()
        assert after.past_trip == _before((Trip.STOPPED,), before)
        pilot.simulation.run(stored_s)
        pilot.simulation.power_cycle()
        pilot.simulation.run(0.1)
        assert pilot.history() in (before, after), stored_s


def storing_a_trip_delays_nothing(bench: Bench) -> None:
    pilot = bench.pilot(receiver=True).get_driving()
    pilot.simulation.set_switches(manual=True)
    while number(pilot, "mode") != BoardMode.RC:
        pilot.cycle(1, CRUISE)
    errors = number(pilot, "servo_errors", 2)
    behind = number(pilot, "millis", 4) - 1000.0 * pilot.simulation.board.now_s
    pilot.simulation.set_switches(kill=True, manual=True)
    start_s = pilot.simulation.board.now_s
    while pilot.simulation.board.now_s < start_s + _STORED_S:
        pilot.simulation.run(0.0005)
        late = number(pilot, "millis", 4) - 1000.0 * pilot.simulation.board.now_s - behind
        assert abs(late) <= 1.6, "the control loop waited"
    seen = pilot.telemetry()
    assert (seen.mode, seen.trip, seen.overruns) == (BoardMode.DISARMED, Trip.KILL, 0)
    assert seen.servo_errors == errors
    pilot.simulation.power_cycle()
    pilot.simulation.run(0.1)
    assert pilot.history().past_trip[:2] == (Trip.KILL, Trip.RC_TOOK_OVER)


def _took_over(pilot: FirmwareHost) -> None:
    """Let the radio control take over, and be refused because its speed is not zero."""
    pilot.simulation.set_sticks(0.0, 0.0, 0.0, 1.0)
    pilot.simulation.set_switches(manual=True)


def _disturbed(pilot: FirmwareHost) -> None:
    pilot.simulation.servos[1].dead = True
    for _ in range(8):
        pilot.simulation.board.send(b"\xff\xff\xfd\x00")
        pilot.simulation.run(0.02)


def _set(name: str, value: object) -> Callable[[FirmwareHost], None]:
    return lambda pilot: setattr(pilot.simulation.servos[1], name, value)


CAUSES: dict[Trip, Callable[[FirmwareHost], object]] = {
    Trip.HEARTBEAT: lambda pilot: pilot.simulation.run(0.6),
    Trip.KILL: lambda pilot: pilot.simulation.set_switches(kill=True),
    Trip.RC_LOST: lambda pilot: pilot.simulation.lose_receiver(),
    Trip.RC_TOOK_OVER: _took_over,
    Trip.SERVO: _set("dead", value=True),
    Trip.WATCHDOG: lambda pilot: pilot.simulation.board.hang(),
    Trip.DRIVE: lambda pilot: pilot.simulation.set_contactor(closed=False),
    Trip.BATTERY: lambda pilot: pilot.simulation.set_battery(9.8),
    Trip.TORQUE: lambda pilot: Mx64.switch_off(pilot.simulation.servos[1]),
    Trip.FOLLOWING: lambda pilot: jam(pilot, Source.PC, 45),
    Trip.HOT: _set("temperature_c", value=75),
    Trip.LINE: _disturbed,
    Trip.STOPPED: lambda pilot: pilot.ask(pilot.command(STOP)),
    Trip.WHEEL: lambda pilot: pilot.simulation.plant.stuck.add(1),
}
"""How each trip is caused."""


def tripped(bench: Bench, trip: Trip) -> FirmwareHost:
    """Drive a robot until it trips for a reason."""
    setup, sensors = (SENSORS, PULSES) if trip is Trip.WHEEL else (BATTERY, 0)
    pilot = bench.pilot(receiver=True, wheel_pulses=sensors).get_ready(setup)
    assert pilot.arm().mode == BoardMode.ARMED
    pilot.drive(2.0 if trip is Trip.WHEEL else 0.3)
    CAUSES[trip](pilot)
    end_s = pilot.simulation.board.now_s + 1.5
    while number(pilot, "trip") == Trip.NONE and pilot.simulation.board.now_s < end_s:
        pilot.cycle(1, CRUISE)
    seen: Telemetry = pilot.telemetry()
    assert (seen.mode, seen.trip) == (BoardMode.DISARMED, trip)
    return pilot


def shown(pilot: FirmwareHost, *, dark: bool = False) -> tuple[int, int]:
    """Watch the light for two periods; return its long and short blinks, the same in both.

    `dark`: count the times when it is out.
    """
    board, periods = pilot.simulation.board, list[list[float]]()
    level, since_s, end_s = board.light != dark, board.now_s, board.now_s + 3.0 * _PERIOD_S
    while board.now_s < end_s and len(periods) < 3:
        pilot.simulation.run(_LOOK_S)
        if (board.light != dark) == level:
            continue
        took_s, since_s, level = board.now_s - since_s, board.now_s, not level
        if level and took_s > _LIMIT_S:
            periods.append([])
        elif not level and periods:
            periods[-1].append(took_s)
    assert len(periods) == 3, "it does not blink"
    counts = {(sum(it > _LIMIT_S for it in each), len(each)) for each in periods[:2]}
    assert len(counts) == 1, counts
    ((longs, count),) = counts
    return longs, count - longs


def the_light_blinks_who_has_the_robot_and_why_it_stopped(bench: Bench) -> None:
    pilot = bench.pilot(receiver=True).get_driving()
    for _ in range(20):
        pilot.drive(0.1)
        assert pilot.simulation.board.light
    pilot.simulation.set_switches(manual=True)
    assert pilot.drive(0.1).mode == BoardMode.RC
    assert shown(pilot, dark=True) == (0, 1)
    pilot.simulation.board.hang()
    pilot.simulation.run(0.5)
    assert pilot.telemetry().trip == Trip.WATCHDOG
    assert shown(pilot) == blinks(Trip.WATCHDOG) == (1, 1)
    pilot.cycle(0)
    pilot.simulation.set_switches()
    pilot.simulation.run(HOLD_S)
    assert pilot.arm().mode == BoardMode.ARMED
    pilot.cycle(0)
    for _ in range(20):
        pilot.simulation.run(0.1)
        assert not pilot.simulation.board.light, "no trip"


LAWS: dict[str, Callable[[Bench], None]] = {
    law.__name__: law
    for law in (
        trips_are_kept_over_arming_and_without_power,
        a_trip_that_was_not_completely_stored_is_none,
        storing_a_trip_delays_nothing,
        the_light_blinks_who_has_the_robot_and_why_it_stopped,
    )
}
