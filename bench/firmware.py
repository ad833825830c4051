"""Benchmark of the firmware simulator: firmware and hardware in virtual time."""

from __future__ import annotations

import gc
import time
from collections.abc import Iterator

from bench.table import Row
from firmware.simulator.board import build
from tests.support.firmware_host import CRUISE, CYCLE_S, Bench
from tsd_twin.dynamixel.control_table import BoardMode

_DRIVEN_S = 60.0
_LONGEST_S = 15.0


def rows() -> Iterator[Row]:
    """A minute of driving."""
    bench = Bench(build())
    pilot = bench.pilot(receiver=True).get_ready()
    pilot.arm()
    gc.collect()
    started_s = time.perf_counter()
    for cycle in range(round(_DRIVEN_S / CYCLE_S)):
        pilot.cycle(1, CRUISE, (cycle % 100,) * 6)
    took_s = time.perf_counter() - started_s
    if pilot.mode() is not BoardMode.ARMED or pilot.missed:
        raise RuntimeError("the board did not drive for a minute")
    bench.finish()
    bench.close()
    yield Row(
        "firmware: a minute at 100 Hz with six servos",
        took_s, _LONGEST_S, "s", "the clock of the board",
    )  # fmt: skip
