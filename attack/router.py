"""A router that is killed again and again while five of its twenty robots drive.

Robots, router, dashboard and link are processes. Robots and dashboard dial the router by TLS, with
rights per robot. The pages reach the dashboard by a link as long as that to another continent.
"""

from __future__ import annotations

import itertools
import math
import re
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

from attack.live import program, seconds_until
from attack.table import Row
from tests.support.key_folders import OPERATOR, make_router_keys
from tests.support.link_sockets import free_port
from tests.support.page_client import Page
from tests.support.programs import Program, follow_trace
from tests.support.robot_node import QUICK
from tsd_twin import robots
from tsd_twin.bus import Bus, from_file
from tsd_twin.messages import topics
from tsd_twin.messages.topics import Sample

ROBOTS, DRIVEN = 20, 5
KILLS, AWAY_S, LONG_AWAY_S = 20, 0.5, 60.0
SILENT_S = 1.5
"""Time by which a page shows a robot as silent."""
HELD_S = 1.0
"""Time for which the sticks stay pushed after all robots are back."""
MAX_AGE_S = 1.0
"""Maximum command age of leases: five round trips, so that a lost packet stops few robots."""
PRESSES, PRESS_S = 120, 0.5
TWIST = {"vx": 1.0, "vy": 0.0, "omega": 1.0}
"""Circles, at the speed limit of the lease."""
AT_REST_MPS = 1e-3
MOVED_M = 0.002
"""A servo step of 0.09 degrees is 16 mm/s, so 2 mm is 0.12 s of one."""


class Trace:
    """True motions of the driven robots, which they write to a file."""

    def __init__(self, file: Path) -> None:
        self._motions: dict[int, list[tuple[float, float, float, float]]] = {}
        self._lock, self._ended = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._read, args=(file,))
        self._thread.start()

    def close(self) -> None:
        self._ended.set()
        self._thread.join()

    def driving(self) -> int:
        """Return the number of robots that move."""
        with self._lock:
            return sum(motion[-1][3] > AT_REST_MPS for motion in self._motions.values())

    def since(self, start_s: float) -> list[tuple[float, float]]:
        """Return for each robot the distance to its first standstill, and that after it, m."""
        with self._lock:
            motions = [
                [row for row in motion if row[0] >= start_s] for motion in self._motions.values()
            ]
        return [_distances(motion) for motion in motions]

    def _read(self, file: Path) -> None:
        for at_s, x, y, speed, number in follow_trace(file, self._ended):
            with self._lock:
                self._motions.setdefault(int(number), []).append((at_s, x, y, speed))


def _distances(motion: list[tuple[float, float, float, float]]) -> tuple[float, float]:
    still = next(i for i, row in enumerate(motion) if row[3] < AT_REST_MPS)
    ways_m = [math.dist(a[1:3], b[1:3]) for a, b in itertools.pairwise(motion)]
    return sum(ways_m[:still]), sum(ways_m[still:])


class Lab:
    """Robots, their router, and pages that drive five of them from another continent."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        self._stack, self._keys = stack, folder / "keys"
        ids = [f"lab{number + 1}" for number in range(DRIVEN)]
        ids += [f"idle{number + 1}" for number in range(ROBOTS - DRIVEN)]
        make_router_keys(self._keys, ids)
        (folder / "quick.toml").write_text(QUICK, encoding="utf-8")
        keys = ("--robot", str(folder / "quick.toml"), "--zenoh-config", str(self._keys))
        driven = ("--id", "lab", "--count", str(DRIVEN), *keys)
        idle = ("--id", "idle", "--count", str(ROBOTS - DRIVEN), *keys)
        trace = folder / "trace"
        fleets = [
            stack.enter_context(program("tests.support.programs", str(trace), *driven)),
            stack.enter_context(program("tsd_mock", *idle)),
        ]
        self._start_router()
        for mock in fleets:
            mock.ready()
        self.trace = Trace(trace)
        stack.callback(self.trace.close)
        config = str(self._keys / f"{OPERATOR}.json5")
        listen = f"tcp/127.0.0.1:{free_port()}"
        host = listen.removeprefix("tcp/")
        web = ("tsd_dashboard", "--port", "0", "--zenoh-config", config, "--allow-host", host)
        (port,) = re.findall(
            r"http://127\.0\.0\.1:(\d+)", stack.enter_context(program(*web)).ready()
        )
        link = ("tsd_link", "--link", "transatlantic", "--target", f"tcp/127.0.0.1:{port}")
        stack.enter_context(program(*link, "--listen", listen)).ready()
        port = host.rpartition(":")[2]
        self.pages = [self._page(int(port), number, ids[number]) for number in range(DRIVEN)]
        self.fleet = FleetView(self.pages[0])
        self.heard_s: dict[str, float] = {}
        bus = stack.enter_context(Bus(from_file(config)))
        for robot in ids:
            bus.subscribe(topics.STATUS.key(robot), self._hear)

    def drive(self) -> None:
        """Take control of five robots, and push their sticks until all drive.

        The link delays some commands beyond their maximum age; these robots stop, and a person
        pushes again.
        """
        for page in self.pages:
            page.let_go()
        for _ in range(PRESSES):
            if self.trace.driving() == DRIVEN:
                return
            for page in self.pages:
                _press_next(page)
            time.sleep(PRESS_S)
        raise AssertionError(f"never {DRIVEN} robots at once: {self.trace.driving()}")

    def kill_router(self, away_s: float) -> Outage:
        """Kill the router and start it again, with the sticks held all the time."""
        outage = Outage(time.monotonic())
        self._router.process.send_signal(signal.SIGKILL)
        self._router.wait()
        _within(lambda: self.trace.driving() == 0, "all robots stand")
        time.sleep(max(0.0, outage.killed_s + away_s - time.monotonic()))
        before = [len(page.messages) for page in self.pages]
        self.heard_s.clear()
        self._start_router()
        listens_s = time.monotonic()
        _within(lambda: len(self.heard_s) == ROBOTS, "all robots at the router")
        outage.at_router_s = max(self.heard_s.values()) - listens_s
        _within(lambda: all(map(_shows_robot, self.pages, before)), "robots in their pages")
        time.sleep(max(0.0, outage.killed_s + SILENT_S - time.monotonic()))
        _within(lambda: self.fleet.live() == ROBOTS, "all robots in a page")
        outage.in_page_s = time.monotonic() - listens_s
        time.sleep(HELD_S)
        return outage

    def _start_router(self) -> None:
        config = str(self._keys / "router.json5")
        self._router: Program = self._stack.enter_context(program("tsd_router", config))
        self._router.ready()

    def _page(self, port: int, number: int, robot: str) -> Page:
        page = Page(port, f"{number:016x}", user=OPERATOR)
        self._stack.callback(page.close)
        page.send(t="fleet", on=True)
        fleet = FleetView(page)
        page.until(lambda: fleet.live() == ROBOTS)
        page.send(t="robot", id=robot)
        page.until(lambda: page.last("robot")["id"] == robot)
        return page

    def _hear(self, sample: Sample) -> None:
        self.heard_s.setdefault(sample.key, time.monotonic())


class Outage:
    """Times of an outage, monotonic or since the router listened again."""

    at_router_s = in_page_s = math.inf

    def __init__(self, killed_s: float) -> None:
        self.killed_s = killed_s


def _press_next(page: Page) -> None:
    """Press the button that a page offers next, until its robot drives."""
    mode = page.mode
    if not page.state["has_control"]:
        page.send(t="lease", op="acquire", take_over=True, max_age_s=MAX_AGE_S)
    elif mode in ("stopped", "fault"):
        page.send(t="reset")
    elif mode == "disarmed":
        page.send(t="arm")
    elif mode == "ready":
        page.let_go()
        page.holds = TWIST


def _within(condition: Callable[[], bool], what: str) -> None:
    assert math.isfinite(seconds_until(condition, 60.0)), f"never: {what}"


def _shows_robot(page: Page, before: int) -> bool:
    return any(message["t"] == "state" for message in page.messages[before:])


class FleetView:
    """State of the fleet view of a page."""

    def __init__(self, page: Page) -> None:
        self._page, self._read = page, 0
        self._silent: dict[str, bool] = {}

    def live(self) -> int:
        """Return the number of robots that are not shown as silent."""
        news = self._page.messages[self._read :]
        self._read += len(news)
        for message in news:
            if message["t"] == "fleet":
                self._silent |= {robot["id"]: robot["silent"] for robot in message["robots"]}
        return sum(not silent for silent in self._silent.values())


def rows(kills: int = KILLS, long_away_s: float = LONG_AWAY_S) -> Iterator[Row]:
    """Yield four rows for short outages, and four for a long one."""
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        lab = Lab(stack, Path(folder))
        for count, away_s, page_s in ((kills, AWAY_S, 3.0), (1, long_away_s, 5.0)):
            stops_m, moves_m, outages = [0.0], [0.0], list[Outage]()
            for _ in range(count):
                lab.drive()
                outages.append(outage := lab.kill_router(away_s))
                ways = lab.trace.since(outage.killed_s)
                stops_m += [stop_m for stop_m, _ in ways]
                moves_m += [after_m for _, after_m in ways]
            what = f"router away for {away_s:g} s, {count} times"
            allowed_m = robots.load_robot("tsd").limits.stop_allowance_m
            yield _row(f"{what}: stops", allowed_m, max(stops_m), "m")
            yield _row(f"{what}: motion before a new push", MOVED_M, max(moves_m), "m")
            at_router_s = max(outage.at_router_s for outage in outages)
            yield _row(f"{what}: all back at the router", 1.0, at_router_s, "s")
            in_page_s = max(outage.in_page_s for outage in outages)
            yield _row(f"{what}: all back in the page", page_s, in_page_s, "s")


def _row(attack: str, allowed: float, measured: float, unit: str) -> Row:
    held = measured <= allowed
    return Row(attack, f"at most {allowed:g} {unit}", f"{measured:.3f} {unit}", held, size=measured)
