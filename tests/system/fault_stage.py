"""Robot, link, dashboard and page as processes that a test can kill, and an observer of the
motion.
"""

from __future__ import annotations

import contextlib
import functools
import itertools
import math
import os
import re
import signal
import threading
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

import numpy as np

from tests.support.pretend_page import PretendPage
from tests.support.programs import Program
from tests.support.robot_node import QUICK
from tests.support.withheld import PATIENCE_S, Pauses, WithheldTime, wait_for
from tsd_twin.bus import Bus, client_config
from tsd_twin.estimation import exponential_error
from tsd_twin.lie import SE2, Array
from tsd_twin.link_emulation import LinkEmulator, LinkSpec
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import Odometry, decode_odometry
from tsd_twin.messages.status import RobotStatus, decode_stamp, decode_status
from tsd_twin.messages.topics import Sample

ID = "tsd"
SPEED_MPS = 1.0
AT_REST_MPS = 1e-3
ANY_PORT = "tcp/127.0.0.1:0"
MAX_COMMAND_PAUSE_S = 0.2
"""Maximum gap between statuses with newly accepted commands; periods are 50 ms and 20 ms."""
_STATUS_PERIOD_S = 0.05
_WITHHELD_PERIOD_S, _STAMPS_KEPT = 0.1, 10


@dataclass(frozen=True, slots=True)
class Run:
    """Motion of the robot after a fault."""

    distance_m: float
    """Distance from the fault to standstill."""
    time_s: float
    """Until standstill."""
    after_m: float
    """Distance after that, until the end of the recording."""
    withheld_s: float = 0.0
    """Withheld time of all processes of the test from the fault to standstill."""


class Observer:
    """Subscriber of the robot, without the emulated link."""

    def __init__(self) -> None:
        self._news = threading.Condition()
        self._withheld = WithheldTime(os.getpid())
        self._withheld_s = [(time.monotonic(), 0.0)]
        """Times, and withheld time until then."""
        self.truth: list[tuple[float, Array, float]] = []
        """Robot time in seconds, (x, y), and speed at which anything moves."""
        self.status = RobotStatus("disarmed")
        self.pauses: Pauses | None = None
        """Notes each truth, if there is one."""
        self.command_pauses: Pauses | None = None
        """Notes each status by which commands have been accepted, if there is one."""
        self._newest: dict[str, dict[int, Odometry]] = {}

    @classmethod
    def of(cls, bus: Bus) -> Self:
        """Return an observer on a bus."""
        it = cls()
        for topic in (topics.ODOM, topics.TRUTH):
            bus.subscribe(topic.key(ID), functools.partial(it._on_odometry, topic.path))
        bus.subscribe(topics.TRUTH.key(ID), it._on_truth)
        bus.subscribe(topics.STATUS.key(ID), it._on_status)
        return it

    def _on_truth(self, sample: Sample) -> None:
        odometry = decode_odometry(sample.payload)
        robot_s = decode_stamp(sample.attachment)[1] * 1e-9
        self._add_truth(robot_s, odometry.xy_heading[:2], float(np.abs(odometry.twist).max()))

    def _add_truth(self, robot_s: float, xy: Array, speed: float) -> None:
        with self._news:
            if time.monotonic() - self._withheld_s[-1][0] > _WITHHELD_PERIOD_S:
                withheld_s = self._withheld.total_s
                self._withheld_s.append((time.monotonic(), withheld_s))
            self.truth.append((robot_s, xy, speed))
            if self.pauses is not None:
                self.pauses.note(robot_s)
            self._news.notify_all()

    def _on_status(self, sample: Sample) -> None:
        with self._news:
            before, self.status = self.status, decode_status(sample.payload)
            is_newer = self.status.command.accepted > before.command.accepted
            if self.command_pauses is not None and is_newer:
                self.command_pauses.note(time.monotonic())
            self._news.notify_all()

    def _on_odometry(self, name: str, sample: Sample) -> None:
        stamp_ns = decode_stamp(sample.attachment)[1]
        latest = {**self._newest.get(name, {}), stamp_ns: decode_odometry(sample.payload)}
        self._newest[name] = dict(sorted(latest.items())[-_STAMPS_KEPT:])

    @property
    def nees(self) -> float:
        """Squared error of the estimated pose, in units of its covariance."""
        poses = [self._newest[topic.path] for topic in (topics.ODOM, topics.TRUTH)]
        latest_ns = max(poses[0].keys() & poses[1].keys())
        estimate, truth = (each[latest_ns] for each in poses)
        error = exponential_error(SE2(estimate.xy_heading), SE2(truth.xy_heading))
        return float(error @ np.linalg.solve(estimate.pose_covariance, error))

    def until(self, condition: Callable[[], bool], what: str) -> None:
        """Wait until received samples make a condition true."""
        with self._news:
            heard = wait_for(self._news, condition)
            assert heard, f"never: {what}; {self.status}; {self.truth[-1:]}"

    def until_time(self, time_s: float, ended: Callable[[], bool] = lambda: False) -> None:
        """Wait until samples up to a time have arrived, or until something has ended."""
        self.until(lambda: self.truth[-1][0] >= time_s or ended(), f"a truth of {time_s}")

    def end_command_pauses(self) -> None:
        """Note the last pause; a status may have shown the command before it one period late."""
        with self._news:
            if self.command_pauses is not None:
                self.command_pauses.note(time.monotonic() + _STATUS_PERIOD_S)
            self.command_pauses = None

    def until_speed(self, speed_mps: float = SPEED_MPS) -> None:
        """Wait until the robot has been as fast as it was asked to be for some samples."""
        assert self.gets_fast(PATIENCE_S, speed_mps), f"never {speed_mps} m/s; {self.status}"

    def gets_fast(self, patience_s: float, speed_mps: float = SPEED_MPS) -> bool:
        """Return whether within so long it has been as fast as it was asked to be."""

        def fast() -> bool:
            return all(speed >= 0.98 * speed_mps for _, _, speed in self.truth[-5:])

        with self._news:
            return self._news.wait_for(fast, patience_s)

    @property
    def at_rest(self) -> bool:
        """Whether the robot is at rest."""
        return self.truth[-1][2] < AT_REST_MPS

    def until_rest(self) -> None:
        """Wait until the robot is at rest."""
        self.until(lambda: self.at_rest, "standstill")

    def way_since(self, time_s: float) -> float:
        """Return how far the robot has gone, in metres."""
        return _way_m([row for row in self.truth if row[0] >= time_s])

    @property
    def dropped(self) -> dict[str, int]:
        """Number of dropped commands, by reason."""
        counts = self.status.command.dropped
        return {name: getattr(counts, name) for name in counts.__struct_fields__}

    def run_since(self, fault_s: float, under_way_s: float = 0.0) -> Run:
        """Return distance and time of the robot since a fault.

        From the last truth before it, so that the distance is an upper bound. A standstill counts
        after `under_way_s`, when all messages sent before the fault have arrived.
        """
        with self._news:
            truth = list(self.truth)
        first = max(i for i, (robot_s, _, _) in enumerate(truth) if robot_s <= fault_s)
        still = next(
            i
            for i in range(first + 1, len(truth))
            if truth[i][2] < AT_REST_MPS and truth[i][0] >= fault_s + under_way_s
        )
        return Run(
            _way_m(truth[first : still + 1]),
            truth[still][0] - fault_s,
            _way_m(truth[still:]),
            self._withheld_between_s(truth[first][0], truth[still][0]),
        )

    def _withheld_between_s(self, from_s: float, until_s: float) -> float:
        with self._news:
            counts = [*self._withheld_s, (math.inf, self._withheld.total_s)]
        before_s = max((total_s for at_s, total_s in counts if at_s <= from_s), default=0.0)
        return next(total_s for at_s, total_s in counts if at_s >= until_s) - before_s


def _way_m(truth: list[tuple[float, Array, float]]) -> float:
    return sum(math.dist(a[1], b[1]) for a, b in itertools.pairwise(truth))


class FaultStage:
    """The robot, the link and the observer; dashboards and pages come and go."""

    def __init__(self, mock: Program, endpoint: str, link: LinkEmulator, bus: Bus) -> None:
        self.mock, self.endpoint, self.link = mock, endpoint, link
        self.observer = Observer.of(bus)
        self._dashboard: Program | None = None
        self._pages: list[PretendPage] = []

    @property
    def dashboard(self) -> Program:
        """A dashboard that lives, a new one if the last was killed."""
        if self._dashboard is None or self._dashboard.process.poll() is not None:
            if self._dashboard is not None:
                self._dashboard.clean_up()
            flags = ("--port", "0", "--connect", self.link.endpoint)
            self._dashboard = Program(["tsd_dashboard", *flags])
        return self._dashboard

    @property
    def url(self) -> str:
        """Where the dashboard serves its page."""
        return re.findall(r"http://\S+", self.dashboard.ready())[0]

    def page(self) -> PretendPage:
        """Open a page."""
        self._pages.append(PretendPage(self.url))
        return self._pages[-1]

    def driving_page(self) -> PretendPage:
        """Open a page that takes control, arms, and pushes the stick until the robot is fast."""
        page = self.page()
        page.get_ready()
        page.do("push", SPEED_MPS)
        self.observer.until_speed()
        return page

    def close_pages(self) -> None:
        """End all pages."""
        for page in self._pages:
            page.clean_up()
        self._pages.clear()

    def close(self) -> None:
        """Leave nothing behind."""
        self.close_pages()
        if self._dashboard is not None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self._dashboard.process.pid, signal.SIGCONT)
            self._dashboard.clean_up()


@contextlib.contextmanager
def fault_stage(folder: Path) -> Generator[FaultStage]:
    """Start a simulated robot, with a link to it that does nothing yet."""
    description = folder / "quick.toml"
    description.write_text(QUICK, encoding="utf-8")
    mock = Program(["tsd_mock", "--listen", ANY_PORT, "--robot", str(description), "--id", ID])
    try:
        (endpoint,) = re.findall(r"tcp/[\d.:]+", mock.ready())
        with (
            LinkEmulator(LinkSpec(), ANY_PORT, endpoint) as link,
            Bus(client_config([endpoint])) as bus,
        ):
            it = FaultStage(mock, endpoint, link, bus)
            try:
                yield it
            finally:
                it.close()
    finally:
        mock.clean_up()


LIMIT_M = 0.35
MOVED_M = 0.002
"""Standstill is standstill: a servo step of 0.09 degrees is 16 mm/s, so 2 mm is 0.12 s of one."""


@dataclass
class Table:
    """Rows in the order in which they were added."""

    rows: list[tuple[str, str, str, str, str]] = field(default_factory=list)

    def add(self, fault: str, run: Run, note: str = "") -> Run:
        """Add what a robot did since a fault, and return it."""
        moved = f"{1000 * run.after_m:.0f} mm" if run.after_m > MOVED_M else "no"
        self.rows.append((fault, f"{run.distance_m:.3f}", f"{run.time_s:.2f}", moved, note))
        return run

    def lines(self) -> list[str]:
        """Return the table as text."""
        head = ("fault at 1 m/s", "distance m", "time s", "moved again", "")
        rows = [head, *self.rows]
        widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
        return [" | ".join(c.ljust(w) for c, w in zip(r, widths, strict=True)) for r in rows]


def stands_still(run: Run) -> None:
    """Fail when a robot went too far, or moved after it had come to rest.

    While the processor is withheld, it may continue at its speed.
    """
    assert run.distance_m <= LIMIT_M + SPEED_MPS * run.withheld_s
    assert run.after_m <= MOVED_M
