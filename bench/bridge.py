"""Benchmark of the bridge with the compiled firmware behind a pty: cycle time and CPU load."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator, Iterator
from pathlib import Path

import psutil

from bench.table import Row
from tsd_twin.bus import Bus, client_config
from tsd_twin.messages import topics
from tsd_twin.messages.status import RobotStatus, decode_status

_SETTLE_S = 2.0
_MEASURED_S = 10.0
_SMALLEST_S = 1.0
_MEDIAN_MS, _P99_MS, _SHARE = 4.0, 8.0, 15.0


def rows(*, smallest: bool = False) -> Iterator[Row]:
    """Run at 100 Hz, disarmed, because cycle times do not depend on the command source."""
    with tempfile.TemporaryDirectory() as folder:
        port = str(Path(folder) / "port")
        with (
            _started("firmware.simulator", "--link", port),
            _started("tsd_bridge", "--port", port, "--listen", "tcp/127.0.0.1:0") as bridge,
        ):
            share, status = _watch(*bridge, _SMALLEST_S if smallest else _MEASURED_S)
    link = status.hardware["link"]
    comparison = f"{link['missed']} of {link['cycles']} cycles without an answer"
    yield Row(
        "write and read of the board, p50", link["round_trip_ms"], _MEDIAN_MS, "ms", comparison
    )
    yield Row(
        "write and read of the board, p99", link["round_trip_p99_ms"], _P99_MS, "ms", comparison
    )
    yield Row("bridge at 100 Hz", share, _SHARE, "% core", "node, bus and line together")


def _watch(pid: int, endpoint: str, measured_s: float) -> tuple[float, RobotStatus]:
    """Return a bridge's CPU load, and its latest status."""
    latest: list[bytes] = []
    with Bus(client_config([endpoint])) as bus:
        bus.subscribe(topics.STATUS.key("tsd"), lambda sample: latest.append(sample.payload))
        time.sleep(_SETTLE_S)
        process = psutil.Process(pid)
        process.cpu_percent()
        time.sleep(measured_s)
        return process.cpu_percent(), decode_status(latest[-1])


@contextlib.contextmanager
def _started(*arguments: str) -> Generator[tuple[int, str]]:
    """Run a program; yield its pid and the address in its `ready:` line."""
    command = [sys.executable, "-m", *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    with process.stdout:
        try:
            yield process.pid, _ready(process.stdout.readline())
        finally:
            process.terminate()
            process.wait()


def _ready(line: str) -> str:
    if not line.startswith("ready:"):
        raise RuntimeError(f"not ready: {line}")
    return line.split()[-1]
