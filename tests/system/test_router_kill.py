"""Kill a router while driving through it, with robot, router and dashboard as processes."""

from __future__ import annotations

import itertools
import re
import signal
import threading
import time
from collections.abc import Callable, Generator
from pathlib import Path

import numpy as np
import pytest

from tests.support.key_folders import OPERATOR, make_router_keys
from tests.support.page_client import Page
from tests.support.pretend_page import send_signal
from tests.support.programs import Program, follow_trace, starting
from tests.support.robot_node import QUICK
from tests.support.withheld import PATIENCE_S
from tests.system.fault_stage import SPEED_MPS, Observer, Table, stands_still
from tsd_twin.bus import Bus, from_file
from tsd_twin.messages import topics

pytestmark = pytest.mark.system

ID = "lab1"
AWAY_S = (0.0, 0.4, 1.5, 3.0)
"""Downtime of the router; link leases last 1 s, control leases 2 s."""
HELD_S = 1.5
"""Time without motion required after the robot is back, although the stick is held."""
SLACK_S = 2.0
"""Allowance for a busy machine on top of 1 s for reconnecting."""
_PUSHES, _FAST_S = 5, 3.0


class FileObserver(Observer):
    """Reads the file of a traced mock, without a bus."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._read, args=(file,))
        self._thread.start()

    def close(self) -> None:
        self._ended.set()
        self._thread.join()

    def _read(self, file: Path) -> None:
        for robot_s, x, y, speed, _ in follow_trace(file, self._ended):
            self._add_truth(robot_s, np.array([x, y]), speed)


class Lab:
    """A router that can be killed, one robot, an operator's dashboard and its page."""

    def __init__(self, start: Callable[..., Program], folder: Path) -> None:
        self._start, self.keys = start, folder / "keys"
        make_router_keys(self.keys, [ID])
        (folder / "quick.toml").write_text(QUICK, encoding="utf-8")
        trace = folder / "trace"
        robot = ("--zenoh-config", str(self.keys / f"{ID}.json5"))
        # Started before the router, like a robot that is switched on first.
        mock = start(
            "tests.support.programs", str(trace), "--robot", str(folder / "quick.toml"), *robot
        )
        self.router = start("tsd_router", str(self.keys / "router.json5"))
        self.router.ready()
        mock.ready()
        self.observer = FileObserver(trace)
        dashboard = start(
            "tsd_dashboard", "--port", "0", "--zenoh-config", str(self.keys / f"{OPERATOR}.json5")
        )
        (port,) = re.findall(r"http://127\.0\.0\.1:(\d+)", dashboard.ready())
        self.page = Page(int(port), "a" * 16, user=OPERATOR)

    def close(self) -> None:
        self.page.close()
        self.observer.close()

    def kill_router(self) -> float:
        """Kill the router, and return the time just before."""
        at_s = send_signal(self.router.process.pid, signal.SIGKILL)
        self.router.wait()
        return at_s

    def start_router(self) -> float:
        """Start the router, and return the time when it listens."""
        self.router = self._start("tsd_router", str(self.keys / "router.json5"))
        self.router.ready()
        return time.monotonic()

    def ready(self) -> None:
        """Leave the page in control of the armed robot, with the stick released."""
        self.page.let_go()
        # The page's last state predates the kill.
        before = len(self.page.messages)
        self.page.until(lambda: any(m["t"] == "state" for m in self.page.messages[before:]))
        self.page.make_ready()

    def drive_fast(self) -> None:
        """Hold the stick until the robot is fast; push again if a busy machine stops it."""
        for _ in range(_PUSHES):
            self.page.drive(SPEED_MPS)
            if self.observer.gets_fast(_FAST_S):
                return
            self.page.let_go()
            self.ready()
        raise AssertionError(f"never {SPEED_MPS} m/s")


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Generator[Lab]:
    with starting() as start:
        it = Lab(start, tmp_path_factory.mktemp("router"))
        try:
            yield it
        finally:
            it.close()


@pytest.mark.parametrize("away_s", AWAY_S)
def test_a_robot_stops_when_its_router_dies_and_moves_only_after_a_new_push(
    lab: Lab, table: Table, away_s: float
) -> None:
    lab.ready()
    lab.drive_fast()
    killed_s = lab.kill_router()
    lab.observer.until_rest()
    lab.observer.until_time(killed_s + away_s)
    stands_still(lab.observer.run_since(killed_s))

    before = len(lab.page.messages)
    listening_s = lab.start_router()
    lab.page.until(lambda: any(m["t"] == "state" for m in lab.page.messages[before:]))
    assert time.monotonic() - listening_s <= 1.0 + SLACK_S
    assert lab.page.holds is not None
    lab.observer.until_time(time.monotonic() + HELD_S)
    run = lab.observer.run_since(killed_s)
    stands_still(run)
    table.add(f"SIGKILL of the router, {away_s:g} s away", run, "stick held all the time")

    lab.ready()
    lab.drive_fast()
    lab.page.let_go()
    lab.observer.until_rest()


def test_a_router_that_is_killed_again_and_again_moves_nothing(lab: Lab) -> None:
    """Ten times, just before robot and dashboard reconnect, with the stick held."""
    lab.ready()
    lab.drive_fast()
    killed_s = lab.kill_router()
    for number in range(10):
        lab.start_router()
        lab.observer.until_time(time.monotonic() + 0.07 * number)
        lab.kill_router()
    lab.start_router()
    lab.observer.until_time(time.monotonic() + HELD_S)
    stands_still(lab.observer.run_since(killed_s))
    lab.ready()
    lab.drive_fast()
    lab.page.let_go()
    lab.observer.until_rest()


def test_a_session_is_back_within_a_second_after_the_router_listens(lab: Lab) -> None:
    """Reconnect attempts are at most 0.5 s apart, plus delays of a busy machine."""
    came_s: list[float] = []
    arrived = threading.Event()

    def on_status(_sample: object) -> None:
        came_s.append(time.monotonic())
        arrived.set()

    with Bus(from_file(str(lab.keys / f"{OPERATOR}.json5"))) as bus:
        bus.subscribe(topics.STATUS.key(ID), on_status)
        for away_s, _ in itertools.product((0.3, 2.5), range(2)):
            assert arrived.wait(PATIENCE_S)
            lab.kill_router()
            time.sleep(away_s)
            came_s.clear()
            arrived.clear()
            listening_s = lab.start_router()
            assert arrived.wait(PATIENCE_S)
            assert came_s[0] - listening_s <= 1.0 + SLACK_S
