"""Router with TLS and rules, 20 robots, a dashboard and five robots that drive.

The peers of load and memory are the requirements; the peer of a command's delay is a direct link. A
bare router, without TLS and rules, shows the delay that Zenoh itself adds on this machine.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import threading
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import psutil

import tsd_twin
from bench.bus import bare_echo, client_commands, paced
from bench.programs import mock, peer, program, tool
from bench.table import Row, Run, percentile
from tests.support.key_folders import OPERATOR, make_router_keys
from tests.support.withheld import Stopwatch
from tsd_twin.bus import Bus, client_config, dialling_config, from_file
from tsd_twin.client import NoRobotFound, RobotClient, RobotControl, RobotSilent, RobotStopped
from tsd_twin.errors import TwinError
from tsd_twin.messages.modes import LATCHED

_ROBOTS, _DRIVEN = 20, 5
_CORE_SHARE_MS, _MEMORY_MB = 100.0, 50.0
_ADDED_MS = 0.5, 2.0
"""Allowed delay of the router, median and 99th percentile."""
_PERIOD_S, _PATIENCE_S = 0.02, 30.0


@dataclass(frozen=True)
class RoutedFleet:
    """A router with its robots and a dashboard; a thread drives some of them in circles."""

    router: program
    endpoint: str
    folder: Path
    """Configurations of the router, the robots and the operator."""
    programs: Mapping[str, program]
    """All programs by name."""
    url: str
    """Address of the dashboard."""

    @property
    def config(self) -> Path:
        """Configuration of the operator."""
        return self.folder / f"{OPERATOR}.json5"

    def connected(self, robot: str) -> RobotClient:
        """Return a client of a robot; on a busy machine, the router takes a while to answer."""
        watch = Stopwatch(os.getpid())
        while True:
            try:
                return tsd_twin.connect(robot=robot, zenoh_config=self.config)
            except (NoRobotFound, RobotSilent):
                if watch.took_s > _PATIENCE_S:
                    raise


class DrivenRobotsStoppedError(Exception):
    """Raised if robots that were driven have stopped; contains their reasons."""


OTHERS = [f"idle{number + 1}" for number in range(_ROBOTS - 1)]
DRIVEN = ["lab1", *OTHERS[: _DRIVEN - 1]]


@contextmanager
def routed_fleet(*reserved: str) -> Generator[RoutedFleet]:
    """Run a router, twenty robots and a dashboard, and drive all of `DRIVEN` but lab1.

    `reserved` are further names of robots.
    """
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        endpoint = make_router_keys(folder, ["lab1", *OTHERS, *reserved])
        router = tool("tsd_router", str(folder / "router.json5"))
        stack.enter_context(router)
        # A process, like the direct one.
        measured = tool("tsd_mock", "--id", "lab1", "--zenoh-config", str(folder / "lab1.json5"))
        stack.enter_context(measured)
        others = robots_of(folder, "idle", len(OTHERS))
        stack.enter_context(others)
        config = str(folder / f"{OPERATOR}.json5")
        dashboard = tool("tsd_dashboard", "--port", "0", "--zenoh-config", config)
        url = stack.enter_context(dashboard)
        programs = {
            "tsd-router": router,
            "tsd-mock, lab1": measured,
            f"tsd-mock, {len(OTHERS)} robots": others,
            "tsd-dashboard": dashboard,
        }
        it = RoutedFleet(router, endpoint, folder, programs, url)
        stack.enter_context(_driven(it, DRIVEN[1:]))
        yield it


def robots_of(folder: Path, name: str, count: int) -> program:
    """Return simulated robots of a router, in one process, named `name` with a number from 1."""
    robots = ("--id", name, "--count", str(count), "--zenoh-config", str(folder))
    return tool("tsd_mock", *robots)


def rows(run: Run) -> Iterator[Row]:
    """Drive four robots throughout, and a fifth one for the delays."""
    count = int(run.pick(300, 20))
    with routed_fleet() as fleet, ExitStack() as stack:
        endpoint = stack.enter_context(mock())
        routed = stack.enter_context(Bus(from_file(str(fleet.config))))
        direct = stack.enter_context(Bus(client_config([endpoint])))

        def routed_ms() -> Sequence[float]:
            return _quantiles(client_commands(routed, fleet.connected("lab1"), count))

        def direct_ms() -> Sequence[float]:
            delays = _quantiles(client_commands(direct, tsd_twin.connect(endpoint), count))
            return [delay + added for delay, added in zip(delays, _ADDED_MS, strict=True)]

        delays = ["router.delay_p50", "router.delay_p99"]
        if run.wants(*delays):
            p50_ms, p99_ms = _bare_added_ms(count, int(run.pick(3, 1)))
            note = f"a bare router adds {p50_ms:.2f} ms to p50 and {p99_ms:.2f} ms to p99"
            yield from run.alternate(delays, routed_ms, direct_ms, note=lambda: note)
        with _driven(fleet, ["lab1"]):
            seconds = run.pick(5.0, 0.5)
            yield from run.alternate(
                ["router.cpu"], lambda: [fleet.router.load(seconds)], lambda: [_CORE_SHARE_MS]
            )
        process = psutil.Process(fleet.router.process.pid)
        yield from run.alternate(
            ["router.memory"],
            lambda: [process.memory_info().rss / 1e6],
            lambda: [_MEMORY_MB],
            rounds=1,
        )


def _bare_added_ms(count: int, rounds: int) -> list[float]:
    """Return the added median and 99th percentile of an echo through a bare router."""
    added: list[list[float]] = []
    with ExitStack() as stack:
        endpoint, router = stack.enter_context(peer("node")), stack.enter_context(peer("router"))
        stack.enter_context(peer("node", router))
        direct = bare_echo(stack.enter_context(Bus(client_config([endpoint]))))
        routed = bare_echo(stack.enter_context(Bus(dialling_config([router]))))
        for _ in range(rounds):
            values = [_quantiles(paced(*echo, count)) for echo in (routed, direct)]
            added.append([a - b for a, b in zip(*values, strict=True)])
    return [statistics.median(each) for each in zip(*added, strict=True)]


def _quantiles(values: Sequence[float]) -> list[float]:
    return [percentile(values, 0.5), percentile(values, 0.99)]


def push(base: RobotControl, vx_mps: float, omega_rad_per_s: float = 0.0) -> None:
    """Command a twist, as a person who pushes again after a stop on a busy machine."""
    with suppress(TwinError):  # It shows in the results.
        try:
            base.set_velocity(vx_mps=vx_mps, omega_rad_per_s=omega_rad_per_s)
        except RobotStopped:
            base.rest()


@contextmanager
def _driven(fleet: RoutedFleet, ids: Iterable[str]) -> Generator[None]:
    """Drive robots in circles at 50 Hz, each with a session of its operator."""
    ended = threading.Event()

    def drive() -> None:
        while not ended.wait(_PERIOD_S):
            for base in bases:
                push(base, 0.4, 0.8)

    with ExitStack() as stack:
        robots = [stack.enter_context(fleet.connected(robot_id)) for robot_id in ids]
        bases = [stack.enter_context(robot.control()) for robot in robots]
        thread = threading.Thread(target=drive)
        thread.start()
        try:
            yield
            if latched := [robot for robot in robots if robot.state.mode in LATCHED]:
                said = (f"{robot.id} stopped: {robot.state.stop_reason}" for robot in latched)
                raise DrivenRobotsStoppedError("; ".join(said))
        finally:
            ended.set()
            thread.join()
