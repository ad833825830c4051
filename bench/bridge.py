"""Bridge with the compiled firmware behind a pty, compared with a bare serial loop."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import serial

from bench.programs import Load, python, terminated
from bench.table import Row, Run, percentile
from tsd_twin.bus import Bus, client_config
from tsd_twin.hardware.board_cycle import BAUD
from tsd_twin.hardware.controller_board import REST_COMMAND, read_request, write_request
from tsd_twin.hardware.dynamixel.control_table import Telemetry
from tsd_twin.messages import topics
from tsd_twin.messages.status import decode_status

_SETTLE_S = 2.0
_PERIOD_S = 0.01
_STATUS_BYTES = 11
"""Status packet without parameters."""


def rows(run: Run) -> Iterator[Row]:
    """Run at 100 Hz, disarmed, because cycle times do not depend on the command source."""
    seconds = run.pick(3.0, 1.0)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        for name in ("board", "bare"):
            stack.enter_context(
                terminated(python("firmware.simulator", "--link", str(folder / name)))
            )
        port = stack.enter_context(serial.serial_for_url(str(folder / "bare"), BAUD, timeout=0.04))
        bridge = terminated(
            python("tsd_bridge", "--port", str(folder / "board"), "--listen", "tcp/127.0.0.1:0")
        )
        bus = stack.enter_context(Bus(client_config([stack.enter_context(bridge)])))
        latest: list[bytes] = []
        bus.subscribe(topics.STATUS.key("tsd"), lambda sample: latest.append(sample.payload))
        time.sleep(_SETTLE_S)

        def subject() -> tuple[float, float, float]:
            with Load(bridge) as load:
                time.sleep(seconds)
            link = decode_status(latest[-1]).hardware["link"]
            return link["round_trip_ms"], link["round_trip_p99_ms"], load.ms_per_s

        yield from run.alternate(
            ["bridge.cycle_p50", "bridge.cycle_p99", "bridge.cpu"],
            subject,
            lambda: serial_loop(port, seconds),
        )


def serial_loop(port: serial.Serial, seconds: float) -> tuple[float, float, float]:
    """Exchange the packets of the bridge; return p50 and p99 in ms, and CPU load in ms/s."""
    request = write_request(REST_COMMAND) + read_request(Telemetry)
    size = 2 * _STATUS_BYTES + Telemetry.LAYOUT.size
    trips_ms: list[float] = []
    start_s, used_s = time.monotonic(), time.thread_time()
    next_s = start_s
    while (now_s := time.monotonic()) < start_s + seconds:
        port.write(request)
        if len(port.read(size)) == size:
            trips_ms.append(1000.0 * (time.monotonic() - now_s))
        next_s += _PERIOD_S
        time.sleep(max(0.0, next_s - time.monotonic()))
    load = 1000.0 * (time.thread_time() - used_s) / (time.monotonic() - start_s)
    return percentile(trips_ms, 0.5), percentile(trips_ms, 0.99), load
