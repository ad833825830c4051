"""Torque that a servo loses while armed: how long the board needs to trip; and its settings."""

from __future__ import annotations

import numpy as np
import pytest

from firmware.simulator import protocol1, protocol2
from firmware.simulator.mx64 import Mx64
from firmware.simulator.servo_bus import ServoBusSimulation
from tests.support.firmware_host import CRUISE, CYCLE_S, Bench, FirmwareHost
from tsd_twin.hardware.dynamixel.control_table import ADDRESS, BoardMode, Trip

GOAL = (100, -60, 0, 40, -100, 20)
MOST_S = 0.1


def time_to_trip_s(pilot: FirmwareHost, servo: Mx64, phase_s: float) -> float:
    """Drive on, switch torque off after `phase_s` of a cycle, and return when the board trips."""
    simulation = pilot.simulation
    mode_at = simulation.table_address + ADDRESS["mode"]
    simulation.run(phase_s)
    servo.switch_off()
    start_s = simulation.board.now_s
    due_s = start_s
    while simulation.board.peek(mode_at) != BoardMode.DISARMED:
        if simulation.board.now_s >= due_s:
            simulation.board.send(pilot.command(1, CRUISE, GOAL))
            due_s += CYCLE_S
        simulation.run(0.001)
        assert simulation.board.now_s - start_s < 1.0, "it goes on"
    took_s = simulation.board.now_s - start_s
    simulation.run(CYCLE_S)
    simulation.board.receive()
    return took_s


def times_to_trip_s(bench: Bench, version: int, delay_us: int, seed: int, count: int) -> np.ndarray:
    """Times over random servos and phases."""
    random = np.random.default_rng(seed)
    pilot = bench.pilot(version).get_driving(GOAL)
    for servo in pilot.simulation.servos:
        servo.return_delay_us = delay_us
        servo.goal_enables_torque = False
    took_s = []
    for _ in range(count):
        pilot.drive(0.1 + CYCLE_S * random.integers(8), goal=GOAL)
        servo = pilot.simulation.servos[random.integers(6)]
        took_s.append(time_to_trip_s(pilot, servo, random.uniform(0.0, CYCLE_S)))
        assert pilot.telemetry().trip == Trip.TORQUE
        pilot.simulation.run(0.5)
        assert pilot.arm().mode == BoardMode.ARMED, "it holds again, and nothing else was lost"
    return np.array(took_s)


@pytest.mark.parametrize(("version", "delay_us"), [(2, 100), (2, 500), (1, 100), (1, 500)])
def test_it_trips_within_a_tenth_of_a_second_in_every_phase(
    version: int, delay_us: int, native_bench: Bench
) -> None:
    took_s = times_to_trip_s(native_bench, version, delay_us, seed=3, count=12)
    assert took_s.max() <= MOST_S


def test_the_chip_is_as_fast(bench: Bench) -> None:
    assert times_to_trip_s(bench, 2, 500, seed=4, count=4).max() <= MOST_S


@pytest.mark.parametrize("version", [1, 2, (1, 2, 1, 2, 2, 1)], ids=str)
def test_no_read_covers_a_register_that_the_manual_does_not_list(
    version: int | tuple[int, ...], native_bench: Bench
) -> None:
    pilot = native_bench.pilot(version).get_driving()
    pilot.drive(1.0)
    bus = pilot.simulation.servo_bus
    assert bus.requests > 1000
    assert not bus.reserved


def test_the_simulated_bus_sees_a_read_of_a_reserved_register() -> None:
    bus = ServoBusSimulation([Mx64(1, 1), Mx64(2, 2)])
    bus.answer(protocol1.status(1, bytes([34, 10]), 2))  # A read has the form of a status.
    bus.answer(protocol2.packet(2, protocol2.READ, bytes([126, 0, 21, 0])))
    assert not bus.reserved
    bus.answer(protocol1.status(1, bytes([36, 34]), 2))
    bus.answer(protocol2.packet(2, protocol2.READ, bytes([64, 0, 72, 0])))
    assert bus.reserved == {(36, 34), (64, 72)}
