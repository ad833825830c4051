"""`make soak`: drive and visit robot and dashboard, as real processes, for a given time.

With `--fleet`, a router with 20 robots, of which four are driven all the time, while other robots
join and leave as well. Exits with a non-zero code if a process dies or grows, connecting becomes
slow, a viewer is disconnected, a connection is left over, or no client gets to drive.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import statistics
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import psutil

from bench.programs import dashboard as dashboard_program
from bench.programs import mock as mock_program
from bench.programs import program
from bench.router import DrivenRobotsStoppedError, robots_of, routed_fleet
from bench.visits import drivers, guests, visit, visitors

HALF_AN_HOUR_S = 1800.0
SHORTEST_S = 15.0
"""Time for three drivers to take control and arm."""
SLACK_MB = 16.0
"""Allowed growth of a process after warm-up, for allocators, caches and threads."""
CONNECT_S, CONNECT_FLEET_S = 1.0, 3.0
"""Allowed time to open a page with one robot, and with twenty of which five drive."""

_VISITORS = 3
GUESTS = 5
_CLOSED_S = 20
"""Time in seconds for connections to be closed."""
_LONGEST_DRIVE_S = 60.0
_LONGEST_WARM_UP_S = 120.0
_SAMPLE_S = 0.5

Processes = dict[str, subprocess.Popen[str]]


class CutShortError(Exception):
    """Raised if the soak cannot continue; contains the reason."""


@dataclass(frozen=True)
class Row:
    """Requirement with its measured value."""

    what: str
    measured: float
    limit: float
    unit: str
    comparison: str
    at_least: bool = False

    @property
    def met(self) -> bool:
        """Whether the limit is met."""
        return self.measured >= self.limit if self.at_least else self.measured <= self.limit

    def __str__(self) -> str:
        word, verdict = ">=" if self.at_least else "<=", "ok  " if self.met else "MISS"
        limit = f"{word} {self.limit:>6.3g} {self.unit:<3}"
        return f"{self.what:<40} {self.measured:>7.3g} {limit}  {verdict}  {self.comparison}"


@dataclass
class Record:
    """Measurements of a soak run."""

    rss_mb: dict[str, list[float]] = field(default_factory=dict[str, list[float]])
    connects_s: list[float] = field(default_factory=list[float])
    last_connects_s: list[float] = field(default_factory=list[float])
    drove: list[bool] = field(default_factory=list[bool])
    joined: list[int] = field(default_factory=list[int])
    """Robots that have joined, besides those that are always there."""
    connections: list[Counter[str]] = field(default_factory=list[Counter[str]])
    """Number for each process, before the first visit and after the last one."""


@dataclass(frozen=True)
class Site:
    """Programs under test, and how to use them."""

    url: str
    programs: Mapping[str, program]
    robot: str = ""
    """Robot to drive; empty for the only one."""
    guests: Callable[[], program] | None = None
    """Robots that join and leave, `GUESTS` at once."""

    @property
    def processes(self) -> Processes:
        """Running processes."""
        return {name: each.process for name, each in self.programs.items()}

    def connections(self) -> Counter[str]:
        """Return the number of open connections of each process."""
        return Counter(
            name
            for name, process in self.processes.items()
            for each in psutil.Process(process.pid).net_connections("tcp")
            if each.status == psutil.CONN_ESTABLISHED
        )


@contextlib.contextmanager
def one_robot() -> Generator[Site]:
    """Run a simulated robot with its dashboard."""
    mock = mock_program()
    with mock as endpoint:
        dashboard = dashboard_program(endpoint)
        with dashboard as url:
            yield Site(url, {"tsd-mock": mock, "tsd-dashboard": dashboard})


@contextlib.contextmanager
def routed_site() -> Generator[Site]:
    """Run a router with robots and a dashboard."""
    with routed_fleet(*(f"guest{number + 1}" for number in range(GUESTS))) as routed:
        guests = partial(robots_of, routed.folder, "guest", GUESTS)
        yield Site(routed.url, routed.programs, "lab1", guests)


def main() -> None:
    """Start both processes, run the soak and evaluate it."""
    parser = argparse.ArgumentParser(prog="make soak", description=__doc__)
    parser.add_argument("--seconds", type=float, default=HALF_AN_HOUR_S)
    parser.add_argument("--fleet", action="store_true", help="20 robots behind a router")
    args = parser.parse_args()
    seconds: float = args.seconds
    if not seconds >= SHORTEST_S:
        parser.error(f"{seconds:g} s are too few, {SHORTEST_S:g} are the least")
    try:
        missed = check(seconds, fleet=args.fleet)
    except DrivenRobotsStoppedError as error:
        sys.exit(f"driven robots stopped: {error}")
    print(f"{missed} missed" if missed else "all met")
    sys.exit(missed > 0)


def check(seconds: float, *, fleet: bool) -> int:
    """Run the soak, print its rows, and return how many are missed.

    Raises:
        DrivenRobotsStoppedError: If robots that are driven all the time are stopped at the end.
    """
    with routed_site() if fleet else one_robot() as site:
        pids = ", ".join(f"{name} is {process.pid}" for name, process in site.processes.items())
        print(f"soaking for {seconds:g} s: {pids}", flush=True)
        try:
            record = asyncio.run(soak(site, seconds))
        except CutShortError as error:
            sys.exit(f"cut short: {error}")
        missed = 0
        connect_s = CONNECT_FLEET_S if fleet else CONNECT_S
        for row in verdict(record, min(_LONGEST_WARM_UP_S / seconds, 1 / 3), connect_s):
            print(row, flush=True)
            missed += not row.met
    return missed


async def soak(site: Site, seconds: float) -> Record:
    """Run drivers and visitors against all processes; return the measurements.

    Raises:
        CutShortError: If a process ended or a page was disconnected.
    """
    record, url = Record(), site.url
    record.connections.append(site.connections())
    over = asyncio.create_task(observe(site.processes, seconds, record))
    drive_s = min(_LONGEST_DRIVE_S, seconds / 3)
    people = [asyncio.create_task(drivers(url, drive_s, record.drove, site.robot))]
    if site.guests is not None:
        people.append(asyncio.create_task(guests(site.guests, GUESTS, record.joined)))
    people += [
        asyncio.create_task(visitors(url, seed, record.connects_s)) for seed in range(_VISITORS)
    ]
    try:
        done, _ = await asyncio.wait([over, *people], return_when=asyncio.FIRST_COMPLETED)
        if over not in done:
            # People only stop when cancelled, unless a process has ended, which is more
            # informative.
            await asyncio.wait([over], timeout=2 * _SAMPLE_S)
        if over.done():
            over.result()
        for person in done - {over}:
            raise CutShortError(repr(person.exception()))
        for _ in range(5):
            async with visit(url) as (_scene, _teleop, took_s):
                record.last_connects_s.append(took_s)
    finally:
        for task in (over, *people):
            task.cancel()
        await asyncio.gather(over, *people, return_exceptions=True)
    for _ in range(_CLOSED_S):
        record.connections[1:] = [site.connections()]
        if record.connections[1] <= record.connections[0]:
            break
        await asyncio.sleep(1.0)
    return record


async def observe(processes: Processes, seconds: float, record: Record) -> None:
    """Record the size of each process while all are alive.

    Raises:
        CutShortError: If a process ended.
    """
    start_s = time.monotonic()
    insides = {name: psutil.Process(process.pid) for name, process in processes.items()}
    while (now_s := time.monotonic() - start_s) < seconds:
        for name, process in processes.items():
            if process.poll() is not None:
                raise CutShortError(f"{name} ended with {process.returncode} after {now_s:.0f} s")
            with contextlib.suppress(
                psutil.NoSuchProcess
            ):  # It just ended, see the next iteration.
                size_mb = insides[name].memory_info().rss / 1e6
                record.rss_mb.setdefault(name, []).append(size_mb)
        await asyncio.sleep(_SAMPLE_S)


def verdict(record: Record, warm_up: float, connect_s: float = CONNECT_S) -> Iterator[Row]:
    """Return the requirements, with `warm_up` as the fraction of the time for warm-up.

    Ended processes and disconnected pages are not included, because they end the soak earlier.
    """
    for name, sizes_mb in record.rss_mb.items():
        start_mb, end_mb = start_and_end(sizes_mb, warm_up)
        comparison = f"{start_mb:.0f} MB after warm-up, {end_mb:.0f} MB at the end"
        yield Row(f"{name}, growth", end_mb - start_mb, SLACK_MB, "MB", comparison)
    if record.connections:
        left = record.connections[-1] - record.connections[0]
        comparison = f"{sum(record.joined)} robots and {len(record.connects_s)} pages came and went"
        of = "".join(f", {count} of {name}" for name, count in left.items())
        yield Row("connections left over", left.total(), 0.0, "", comparison + of)
    before_s = statistics.median(record.connects_s)
    comparison = f"{len(record.connects_s)} visits before, {before_s:.3f} s"
    last_s = statistics.median(record.last_connects_s)
    yield Row("a page sees all there is, at the end", last_s, connect_s, "s", comparison)
    share = 100 * sum(record.drove) / len(record.drove)
    comparison = f"{sum(record.drove)} of {len(record.drove)}"
    yield Row("drivers who got to drive", share, 90.0, "%", comparison, at_least=True)


def start_and_end(sizes: Sequence[float], warm_up: float) -> tuple[float, float]:
    """Return the minimum of the first and of the last quarter after the warm-up.

    The minimum excludes memory that waits for collection.
    """
    warm = sizes[int(len(sizes) * warm_up) :]
    quarter = max(len(warm) // 4, 1)
    return min(warm[:quarter]), min(warm[-quarter:])


if __name__ == "__main__":
    main()
