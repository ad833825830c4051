"""Benchmark of the firmware simulator: firmware and hardware in virtual time."""

from __future__ import annotations

import gc
import time
from collections.abc import Iterator

from bench.table import Row
from firmware.simulator.board import build
from tests.support.firmware_host import CRUISE, CYCLE_S, Bench
from tsd_twin.hardware.dynamixel.control_table import BoardMode

_DRIVEN_S = 60.0
_SMALLEST_S = 1.0
_LONGEST_S = 15.0
_BYTE_CYCLES, _ROOM_CYCLES, _STACK = 160, 320, 600


def rows(*, smallest: bool = False) -> Iterator[Row]:
    """Measure a minute of driving, or a second if `smallest`."""
    driven_s = _SMALLEST_S if smallest else _DRIVEN_S
    bench = Bench(build())
    pilot = bench.pilot(receiver=True).get_ready()
    pilot.arm()
    gc.collect()
    started_s = time.perf_counter()
    for cycle in range(round(driven_s / CYCLE_S)):
        pilot.cycle(1, CRUISE, (cycle % 100,) * 6)
    took_s = time.perf_counter() - started_s
    if pilot.mode() is not BoardMode.ARMED or pilot.missed:
        raise RuntimeError(f"the board did not drive for {driven_s:g} s")
    bench.finish()
    timing = pilot.simulation.board.timing()
    bench.close()
    yield Row(
        f"firmware: {driven_s:g} s at 100 Hz with six servos",
        took_s, _LONGEST_S, "s", "the clock of the board",
    )  # fmt: skip
    longest = max(timing.interrupts, key=lambda name: timing.interrupts[name])
    yield Row(
        "firmware: longest interrupt", timing.interrupts[longest], _BYTE_CYCLES, "cycles",
        f"{longest}; a byte at 1 Mbaud",
    )  # fmt: skip
    yield Row(
        "firmware: longest wait of a byte", max(timing.longest_wait), _ROOM_CYCLES, "cycles",
        f"two bytes have room; lost: {sum(timing.lost)}",
    )  # fmt: skip
    yield Row("firmware: stack, high water", timing.stack, _STACK, "B", "an eighth of what is free")
