"""CPU load of an idle node, and of a dashboard without viewers."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence

import psutil

from bench.bus import program
from bench.table import Row

_SETTLE_S = 3.0
_SECONDS = 10.0
_SMALLEST_S = 0.3

_FLOOR = """
import sys, threading, time
from tsd_twin.bus import Bus, node_config
def loop():
    while True:
        time.sleep(0.01)
with Bus(node_config(["tcp/127.0.0.1:0"])) as bus:
    threading.Thread(target=loop, daemon=True).start()
    print("ready:", bus.endpoints()[0], flush=True)
    sys.stdin.read()
"""


def rows(*, smallest: bool = False) -> Iterator[Row]:
    """Measure a robot alone, then together with a dashboard that has no open page."""
    times_s = (_SMALLEST_S, _SMALLEST_S) if smallest else (_SETTLE_S, _SECONDS)
    bare = program([sys.executable, "-c", _FLOOR])
    with bare:
        floor = share_of_a_core(bare.process.pid, *times_s)
    comparison = f"a bare loop at 100 Hz with a session {floor:.1f} %"
    run = [sys.executable, "-m"]
    mock = program([*run, "tsd_mock", "--listen", "tcp/127.0.0.1:0", "--until-eof"])
    with mock as endpoint:
        idle = share_of_a_core(mock.process.pid, *times_s)
        yield Row("node idle, disarmed, of one core", idle, 4.0, "%", comparison)
        page = program([*run, "tsd_dashboard", "--port", "0", "--until-eof", "--connect", endpoint])
        with page:
            unwatched = share_of_a_core(page.process.pid, *times_s)
            yield Row("dashboard without viewers, of one core", unwatched, 2.0, "%", comparison)


def share_of_a_core(pid: int, settle_s: float, seconds: float) -> float:
    """Return the CPU load of a process in percent of a core, after a settling time."""
    return shares_of_a_core([pid], settle_s, seconds)[0]


def shares_of_a_core(pids: Sequence[int], settle_s: float, seconds: float) -> list[float]:
    """Return the CPU loads of processes over the same time, in percent of a core."""
    processes = [psutil.Process(pid) for pid in pids]
    time.sleep(settle_s)
    for process in processes:
        process.cpu_percent()
    time.sleep(seconds)
    return [process.cpu_percent() for process in processes]
