"""Processor load and disk space of a recorder, beside a bare subscriber of the same messages."""

from __future__ import annotations

import contextlib
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import tsd_twin
from bench.bus import program
from bench.idle import share_of_a_core
from bench.table import Row

_SETTLE_S = 3.0
_SECONDS = 20.0
_SMALLEST_S = 0.5

_FLOOR = """
import sys
from tsd_twin.bus import Bus, client_config, clients_of
with Bus(clients_of(client_config([sys.argv[1]]), 3.0)[0]) as bus:
    bus.subscribe("twin/**", lambda sample: None)
    print("ready:", sys.argv[1], flush=True)
    sys.stdin.read()
"""


def rows(*, smallest: bool = False) -> Iterator[Row]:
    """Measure while one robot is driven: noise makes its numbers as hard to compress as real ones.

    The bare subscriber and the recorder listen one after the other to the same robot.
    """
    settle_s, seconds = (_SMALLEST_S, _SMALLEST_S) if smallest else (_SETTLE_S, _SECONDS)
    mock = [*_run("tsd_mock"), "--listen", "tcp/127.0.0.1:0", "--noise", "1"]
    with program(mock) as endpoint, tempfile.TemporaryDirectory() as folder, _driven(endpoint):
        bare = program([sys.executable, "-c", _FLOOR, endpoint])
        with bare:
            floor = share_of_a_core(bare.process.pid, settle_s, seconds)
        recorder = program([*_run("tsd_record"), "--connect", endpoint, "--dir", folder])
        with recorder as file:
            time.sleep(settle_s)
            before, start_s = Path(file).stat().st_size, time.monotonic()
            load = share_of_a_core(recorder.process.pid, 0.0, seconds)
            grown_mb = (Path(file).stat().st_size - before) / 1e6
            mb_per_min = 60.0 * grown_mb / (time.monotonic() - start_s)
    yield Row("recorder of one robot, of one core", load, 6.0, "%", f"subscriber {floor:.1f} %")
    yield Row("recording of one robot that drives", mb_per_min, 2.5, "MB/min", "design")


def _run(name: str) -> list[str]:
    return [sys.executable, "-m", name, "--until-eof"]


class _driven:  # noqa: N801  It is used as a function.
    """A robot that is driven in circles meanwhile."""

    def __init__(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self._stop, self._drives = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._drive)

    def __enter__(self) -> None:
        self._thread.start()
        if not self._drives.wait(30.0):
            raise RuntimeError("the robot does not drive")

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _drive(self) -> None:
        with tsd_twin.connect(self._endpoint) as robot, robot.control("bench") as base:
            self._drives.set()
            while not self._stop.is_set():
                # A machine that is busy stops the robot now and then.
                with contextlib.suppress(tsd_twin.RobotStopped):
                    base.set_velocity(vx_mps=0.3, omega_rad_per_s=0.5)
                robot.sleep(0.05)
