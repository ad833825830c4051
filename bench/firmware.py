"""Firmware simulator in virtual time, compared with a board without a bridge; and its limits."""

from __future__ import annotations

import time
from collections.abc import Iterator

from bench.table import Row, Run
from firmware.simulator.board import build
from tests.support.firmware_host import CRUISE, CYCLE_S, Bench
from tsd_twin.hardware.dynamixel.control_table import BoardMode

_BYTE_CYCLES, _ROOM_CYCLES, _STACK = 160, 320, 600


def rows(run: Run) -> Iterator[Row]:
    """Measure driving at 100 Hz with six servos; cycles and stack are measured on the board."""
    cycles = round(run.pick(5.0, 1.0) / CYCLE_S)
    bench = Bench(build())
    pilot = bench.pilot(receiver=True).get_ready()
    pilot.arm()
    alone = bench.pilot(receiver=True)

    def driving() -> list[float]:
        start_s = time.thread_time()
        for cycle in range(cycles):
            pilot.cycle(1, CRUISE, (cycle % 100,) * 6)
        return [1e3 * (time.thread_time() - start_s) / (cycles * CYCLE_S)]

    def idle() -> list[float]:
        start_s = time.thread_time()
        alone.simulation.run(cycles * CYCLE_S)
        return [1e3 * (time.thread_time() - start_s) / (cycles * CYCLE_S)]

    yield from run.alternate(["firmware.simulator"], driving, idle)
    if not run.wants("firmware.interrupt", "firmware.wait", "firmware.stack"):
        return
    driving()
    if pilot.mode() is not BoardMode.ARMED or pilot.missed:
        raise RuntimeError("the board did not drive")
    bench.finish()
    timing = pilot.simulation.board.timing()
    bench.close()
    longest = max(timing.interrupts, key=lambda name: timing.interrupts[name])
    for name, value, bound, note in (
        ("firmware.interrupt", timing.interrupts[longest], _BYTE_CYCLES, longest),
        ("firmware.wait", max(timing.longest_wait), _ROOM_CYCLES, f"lost: {sum(timing.lost)}"),
        ("firmware.stack", timing.stack, _STACK, ""),
    ):
        if run.wants(name):
            yield Row(name, [value], [bound], note=note)
