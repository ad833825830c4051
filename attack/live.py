"""Live processes to attack: robots, dashboards, and a bus session that announces forged robots."""

from __future__ import annotations

import json
import os
import re
import threading
import time
import urllib.request
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from tests.support.bus_operator import BusOperator
from tests.support.programs import Program
from tests.support.robot_node import QUICK, RunningNode, behind
from tsd_twin.bus import Bus
from tsd_twin.messages import topics
from tsd_twin.messages.topics import Service

PATIENCE_S = 20.0


def seconds_until(condition: Callable[[], Any], patience_s: float = PATIENCE_S) -> float:
    """Return the time until a condition holds, or infinity after a timeout."""
    start_s = time.monotonic()
    while time.monotonic() - start_s < patience_s:
        if condition():
            return time.monotonic() - start_s
        time.sleep(0.01)
    return float("inf")


@contextmanager
def program(*arguments: str, preload: str = "") -> Generator[Program]:
    """Run one of the programs; `preload` is a library that replaces parts of libc."""
    if preload:
        os.environ["LD_PRELOAD"] = preload
    try:
        started = Program(list(arguments))
    finally:
        os.environ.pop("LD_PRELOAD", None)
    try:
        yield started
    finally:
        started.clean_up()


@contextmanager
def mock(*flags: str, preload: str = "") -> Generator[RunningNode]:
    """Run a simulated robot like a user; bus and joints are in its process."""
    with program("tsd_mock", "--listen", "tcp/127.0.0.1:0", *flags, preload=preload) as started:
        endpoint = started.ready().split()[-1]
        robot_id = flags[flags.index("--id") + 1] if "--id" in flags else "tsd"
        yield behind(endpoint, robot_id)


@contextmanager
def dashboard(endpoint: str, preload: str = "") -> Generator[tuple[Program, int]]:
    """Run a dashboard; yield its process and port."""
    flags = ("--port", "0", "--connect", endpoint)
    with program("tsd_dashboard", *flags, preload=preload) as started:
        (url,) = re.findall(r"http://\S+", started.ready())
        yield started, int(re.findall(r":(\d+)", url)[0])


def shown(port: int) -> set[str]:
    """Return the robots known to a dashboard."""
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/healthz", timeout=5.0) as answer:
        return set(json.load(answer)["robots"])


def threads_of(started: Program) -> int:
    """Return the number of threads of a process."""
    status = Path(f"/proc/{started.process.pid}/status").read_text("ascii")
    (line,) = (line for line in status.splitlines() if line.startswith("Threads:"))
    return int(line.split()[1])


@contextmanager
def operator(node: RunningNode, name: str = "alice") -> Generator[BusOperator]:
    """Yield an operator whose robot is armed and ready."""
    with BusOperator(node, name) as pilot:
        pilot.get_ready()
        yield pilot


class ForgedRobots:
    """Forged robots in a bus session: liveliness tokens and arbitrary descriptions."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._ends = threading.Event()
        self._stack = ExitStack()
        self._silent: list[object] = []

    def __enter__(self) -> ForgedRobots:
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        self._stack.close()

    def announce(self, robot_id: str, *, silent: bool = False) -> None:
        """Announce a non-existent robot; if `silent`, with a queryable that never answers."""
        if silent:
            self._silent.append(self._bus.queryable(Service.DESC.key(robot_id)))
        self._bus.declare_token(topics.alive_key(robot_id))

    def describe(self, robot_id: str, toml: str = QUICK) -> None:
        """Announce a robot with a description."""
        server = self._bus.queryable(Service.DESC.key(robot_id))
        answer = json.dumps({"robot": toml, "urdf": ""}).encode()

        def serve() -> None:
            while not self._ends.wait(0.005):
                for request in server.take_requests():
                    request.reply(answer)

        thread = threading.Thread(target=serve)
        thread.start()
        self._stack.callback(thread.join)
        self._bus.declare_token(topics.alive_key(robot_id))
