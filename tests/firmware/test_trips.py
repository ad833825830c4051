"""The last trips in EEPROM, and the light of the board that shows the last one."""

from __future__ import annotations

import numpy as np
import pytest

from tests.firmware.source_rules import STOP
from tests.firmware.trip_rules import CAUSES, shown, tripped
from tests.support.firmware_host import HOLD_S, Bench, FirmwareHost
from tsd_twin.hardware.dynamixel.control_table import (
    PAST_TRIPS,
    BoardMode,
    Trip,
    TripHistory,
    blinks,
)

FIRST, SIZE = 192, 7
"""In EEPROM."""
FIRST_FREE = FIRST + PAST_TRIPS * SIZE


def test_all_trips_are_caused_and_fit_into_their_bits() -> None:
    assert set(CAUSES) == set(Trip) - {Trip.NONE}
    assert max(Trip) < 32
    assert len({blinks(trip) for trip in Trip}) == len(Trip)


@pytest.mark.parametrize("trip", CAUSES)
def test_the_light_blinks_each_cause(trip: Trip, native_bench: Bench) -> None:
    blinks_its_cause(trip, native_bench)


@pytest.mark.parametrize("trip", [Trip.WATCHDOG, Trip.BATTERY])
def test_the_light_of_the_chip_blinks_the_cause(trip: Trip, bench: Bench) -> None:
    blinks_its_cause(trip, bench)


def blinks_its_cause(trip: Trip, bench: Bench) -> None:
    pilot = tripped(bench, trip)
    assert shown(pilot) == blinks(trip)
    assert pilot.history().past_trip == (trip, *(0,) * (PAST_TRIPS - 1))


def stop(pilot: FirmwareHost) -> None:
    """Arm and stop, in the shortest time."""
    pilot.simulation.run(HOLD_S)
    assert pilot.arm(at_once=True).mode == BoardMode.ARMED
    pilot.ask(pilot.command(STOP))
    pilot.cycle(0)


def cells(pilot: FirmwareHost) -> list[bytes]:
    peek = pilot.simulation.board.peek_eeprom
    return [bytes(peek(FIRST + SIZE * i + j) for j in range(SIZE)) for i in range(PAST_TRIPS)]


def test_the_ring_keeps_the_last_eight_over_many_turns_and_wears_all_cells_alike(
    native_bench: Bench,
) -> None:
    pilot = native_bench.pilot().get_ready()
    board = pilot.simulation.board
    kept = [bytes(map(board.peek_eeprom, range(FIRST))), board.peek_eeprom(FIRST_FREE)]
    written, starts = np.zeros(PAST_TRIPS, dtype=int), list[int]()
    for count in range(1, 10 * PAST_TRIPS + 4):  # The turn of the ring has three bits.
        before = cells(pilot)
        stop(pilot)
        starts.insert(0, pilot.telemetry().nonce[0] % 256)
        pilot.simulation.run(0.05)
        written += [cell != old for cell, old in zip(cells(pilot), before, strict=True)]
        seen = pilot.history()
        assert seen.past_trip == (Trip.STOPPED,) * min(count, PAST_TRIPS) + (0,) * (
            PAST_TRIPS - count
        )
        assert seen.past_start[: len(starts)] == tuple(starts[:PAST_TRIPS])
        if count % 3 == 0:
            pilot.simulation.power_cycle()
            pilot.simulation.run(0.1)
            assert pilot.history() == seen
            pilot.get_ready()
    assert written.max() - written.min() <= 1
    now = bytes(map(board.peek_eeprom, range(128)))
    assert [now, board.peek_eeprom(FIRST_FREE)] == [kept[0][:128], kept[1]]


def test_any_cut_of_a_write_leaves_the_other_trips(native_bench: Bench) -> None:
    """The bytes behind the cut are as before, and the one at the cut is anything."""
    random = np.random.default_rng(3)
    pilot = native_bench.pilot().get_ready()
    board = pilot.simulation.board
    for _ in range(24):
        pilot.simulation.run(0.1)
        before, old = pilot.history(), cells(pilot)
        stop(pilot)
        pilot.simulation.run(0.1)
        after, new = pilot.history(), cells(pilot)
        (changed,) = (i for i in range(PAST_TRIPS) if old[i] != new[i])
        for cut in range(SIZE):
            torn = bytearray(new[changed][:cut] + old[changed][cut:])
            torn[cut] = int(random.integers(256))
            for j, byte in enumerate(torn):
                board.poke_eeprom(FIRST + SIZE * changed + j, byte)
            pilot.simulation.power_cycle()
            pilot.simulation.run(0.05)
            seen, oldest = pilot.history(), before.past_trip[-1]
            if bytes(torn) == new[changed]:
                assert seen == after
            elif bytes(torn) == old[changed]:
                assert seen == before
            else:
                assert seen.past_trip == (*before.past_trip[:-1], 0), oldest
        for j, byte in enumerate(new[changed]):
            board.poke_eeprom(FIRST + SIZE * changed + j, byte)
        pilot.simulation.power_cycle()
        pilot.get_ready()
        assert pilot.history() == after


def test_memory_that_never_held_trips_holds_none(native_bench: Bench) -> None:
    for byte in (0x00, 0xFF, 0x5A):
        pilot = native_bench.pilot()
        for address in range(FIRST, FIRST_FREE):
            pilot.simulation.board.poke_eeprom(address, byte)
        pilot.simulation.power_cycle()
        pilot.simulation.run(0.1)
        assert pilot.history() == TripHistory()
        pilot.get_ready()
        stop(pilot)
        assert pilot.history().past_trip == (Trip.STOPPED, *(0,) * (PAST_TRIPS - 1))
