"""The bridge with the compiled firmware behind a pty: how long a cycle takes, and what it costs."""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import psutil

from bench.bus import program
from bench.table import Row
from tsd_twin import topics
from tsd_twin.bus import Bus, client_config
from tsd_twin.messages.status import decode_status

_MEASURED_S = 10.0
_MEDIAN_MS, _P99_MS, _SHARE = 4.0, 8.0, 15.0


def rows() -> Iterator[Row]:
    """Let it run at 100 Hz for a while, disarmed: cycles are the same whoever drives."""
    with tempfile.TemporaryDirectory() as folder:
        port = str(Path(folder) / "port")
        box = [sys.executable, "-m", "firmware.simulator", "--link", port]
        with program(box):
            bridge = [sys.executable, "-m", "tsd_bridge", "--port", port]
            bridge += ["--listen", "tcp/127.0.0.1:0", "--until-eof"]
            with program(bridge) as endpoint, Bus(client_config([endpoint])) as bus:
                process = child(bridge)
                latest: list[bytes] = []
                bus.watch(topics.STATUS.key("tsd"), lambda sample: latest.append(sample.payload))
                process.cpu_percent()
                time.sleep(_MEASURED_S)
                share = process.cpu_percent()
                link = decode_status(latest[-1]).hardware["link"]
    beside = f"{link['missed']} of {link['cycles']} cycles without an answer"
    yield Row("write and read of the board, p50", link["round_trip_ms"], _MEDIAN_MS, "ms", beside)
    yield Row("write and read of the board, p99", link["round_trip_p99_ms"], _P99_MS, "ms", beside)
    yield Row("bridge at 100 Hz", share, _SHARE, "% core", "node, bus and line together")


def child(command: list[str]) -> psutil.Process:
    """Return the process that was started with a command."""
    found = psutil.Process().children()
    return next(
        process for process in found if process.cmdline()[-len(command) + 1 :] == command[1:]
    )
