"""A dashboard is killed at each step of a handover: the robot stops, and control is freed."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import time
from collections.abc import Generator
from typing import Any

import pytest

from tests.support.page_client import Page
from tests.support.pretend_page import send_signal
from tests.support.programs import Program
from tests.support.withheld import Pauses, WithheldTime
from tests.system.fault_stage import MAX_COMMAND_PAUSE_S, FaultStage, fault_stage, stands_still
from tsd_twin.safety.lease import RESERVATION_S, TTL_S

pytestmark = pytest.mark.system

SPEED_MPS = 0.5
SLACK_S = 0.5
"""Added to the documented times: the period of states, and the maximum request time."""
ALICE, BOB = "a" * 16, "b" * 16


class Desk:
    """A page and its dashboard process."""

    def __init__(self, program: Program, name: str) -> None:
        self.program = program
        (port,) = re.findall(r"http://127\.0\.0\.1:(\d+)", program.ready())
        self.page = Page(int(port), name)

    def signal(self, number: int) -> float:
        """Send a signal to the dashboard, and return the time just before."""
        return send_signal(self.program.process.pid, number)

    def close(self) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.program.process.pid, signal.SIGCONT)
        self.page.close()


class Dashboards:
    """Dashboards of a robot; a test reuses those not killed by earlier tests."""

    def __init__(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self._programs: list[Program] = []

    def alive(self, count: int) -> list[Program]:
        """Return as many live dashboards, replacing those that were killed."""
        for program in [it for it in self._programs if it.process.poll() is not None]:
            program.clean_up()
            self._programs.remove(program)
        while len(self._programs) < count:
            flags = ("--port", "0", "--connect", self._endpoint)
            self._programs.append(Program(["tsd_dashboard", *flags]))
        return self._programs

    def close(self) -> None:
        for program in self._programs:
            program.clean_up()


class Two:
    """Alice, who drives, Bob, who has requested control, and the robot."""

    def __init__(self, robot: FaultStage, here: Desk, there: Desk) -> None:
        self.robot, self.here, self.there = robot, here, there
        self.alice, self.bob = here.page, there.page
        desks = (desk.program.process.pid for desk in (here, there))
        self._pids = os.getpid(), robot.mock.process.pid, *desks
        self._withheld = WithheldTime(*self._pids)
        # Each dashboard loads its first robot, which may take an entire processor.
        self.bob.until(lambda: self.bob.state)
        self.alice.make_ready()
        self.drive_fast(self.alice)
        self.bob.until(lambda: lease_in(self.bob)["holder"] == self.alice.operator)
        assert press(self.bob, "request")["ok"]
        self.alice.until(lambda: lease_in(self.alice)["requested_by"] == self.bob.operator)

    def drive_fast(self, page: Page) -> None:
        """Hold the stick until the robot is fast, and note pauses between its commands."""
        observer = self.robot.observer
        page.drive(SPEED_MPS, until=lambda: observer.gets_fast(0.0, SPEED_MPS))
        self._driver, self._stops = page, observer.status.stops
        self._released = len(page.all("released"))
        observer.command_pauses = self._pauses = Pauses(*self._pids)

    def kept_for_bob(self) -> None:
        """Wait until the robot reports the reservation."""
        observer = self.robot.observer
        observer.until(
            lambda: observer.status.lease.reserved_for == self.bob.operator, "kept for bob"
        )

    def grant(self) -> float:
        """Grant control to Bob as Alice, and return the time."""
        granted_s = self.begin()
        assert press(self.alice, "grant", asker=self.bob.operator)["ok"]
        self.alice.holds = None
        return granted_s

    def begin(self) -> float:
        """Start measuring withheld time; return the time."""
        self._withheld = WithheldTime(*self._pids)
        return time.monotonic()

    def is_within(self, since_s: float, limit_s: float) -> None:
        """Fail if the time since, minus withheld time, exceeds the limit."""
        took_s = time.monotonic() - since_s
        assert took_s <= limit_s + self._withheld.total_s

    def stood_still_since(self, fault_s: float) -> None:
        """Fail unless the robot came to rest in time and did not move again."""
        observer = self.robot.observer
        observer.until_rest()
        observer.until_time(time.monotonic())
        stands_still(observer.run_since(fault_s))

    def drives_on(self, fault_s: float) -> None:
        """Fail if the robot began to stop since, unless the machine delayed its commands."""
        observer = self.robot.observer
        # Longer than a command is valid. After a release, nothing is commanded any more.
        observer.until_time(fault_s + 0.6, self._is_released)
        observer.end_command_pauses()
        assert self._pauses.longest_s < MAX_COMMAND_PAUSE_S
        if self._pauses.on_the_clock_s < MAX_COMMAND_PAUSE_S:
            assert observer.gets_fast(0.0, SPEED_MPS)
            assert observer.status.stops == self._stops

    def _is_released(self) -> bool:
        return len(self._driver.all("released")) > self._released


def lease_in(page: Page) -> dict[str, Any]:
    return page.state["status"]["lease"]


def press(page: Page, op: str, **fields: Any) -> dict[str, Any]:
    return page.answer("lease", t="lease", op=op, **fields)


def takes_control_within(two: Two, page: Page, since_s: float, limit_s: float) -> None:
    """Fail unless a page gets free control within the time, without a takeover."""
    while not page.take()["ok"]:
        two.is_within(since_s, limit_s + SLACK_S)
        time.sleep(0.2)  # More requests would count as a flood and be dropped.
    two.is_within(since_s, limit_s + SLACK_S)


def drives(two: Two, page: Page) -> None:
    """Fail unless the robot obeys a page."""
    page.send(t="release")
    page.make_ready()
    two.drive_fast(page)
    page.holds = None
    page.send(t="release")
    two.robot.observer.until_rest()


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Generator[FaultStage]:
    with fault_stage(tmp_path_factory.mktemp("hand-over")) as it:
        yield it


@pytest.fixture(scope="module")
def dashboards(robot: FaultStage) -> Generator[Dashboards]:
    it = Dashboards(robot.endpoint)
    yield it
    it.close()


@pytest.fixture
def two(robot: FaultStage, dashboards: Dashboards) -> Generator[Two]:
    """Two dashboards for one robot; killed ones are replaced after the test."""
    with contextlib.ExitStack() as stack:
        desks: list[Desk] = []
        for program, name in zip(dashboards.alive(2), (ALICE, BOB), strict=True):
            desks.append(Desk(program, name))
            stack.callback(desks[-1].close)
        yield Two(robot, *desks)
    robot.observer.until_rest()
    robot.observer.until(lambda: robot.observer.status.lease.holder is None, "control is free")


def test_the_holder_s_dies_once_asked_and_the_asker_gets_control_when_the_lease_ends(
    two: Two,
) -> None:
    killed_s = two.begin()
    two.here.signal(signal.SIGKILL)
    two.stood_still_since(killed_s)
    two.bob.until(lambda: two.bob.state["has_control"])
    two.is_within(killed_s, TTL_S + SLACK_S)
    two.stood_still_since(killed_s)
    drives(two, two.bob)


def test_the_asker_s_dies_and_the_holder_drives_on_and_what_was_granted_to_it_is_free_again(
    two: Two,
) -> None:
    killed_s = two.there.signal(signal.SIGKILL)
    two.drives_on(killed_s)
    granted_s = two.grant()
    two.kept_for_bob()
    two.stood_still_since(granted_s)
    assert two.alice.take()["why"]["code"] == "reserved_for"
    takes_control_within(two, two.alice, granted_s, RESERVATION_S)
    two.stood_still_since(granted_s)
    drives(two, two.alice)


def test_the_former_holder_s_dies_while_control_is_kept_and_the_asker_takes_it(two: Two) -> None:
    """The requester's dashboard hangs, so the robot reserves control for it."""
    two.there.signal(signal.SIGSTOP)
    granted_s = two.grant()
    two.kept_for_bob()
    two.here.signal(signal.SIGKILL)
    two.there.signal(signal.SIGCONT)
    two.bob.until(lambda: two.bob.state["has_control"])
    two.is_within(granted_s, RESERVATION_S)
    two.stood_still_since(granted_s)
    drives(two, two.bob)


def test_the_asker_s_dies_while_control_is_kept_for_it_and_others_get_it_soon(two: Two) -> None:
    two.there.signal(signal.SIGSTOP)
    granted_s = two.grant()
    two.kept_for_bob()
    two.there.signal(signal.SIGKILL)
    takes_control_within(two, two.alice, granted_s, RESERVATION_S)
    two.stood_still_since(granted_s)
    drives(two, two.alice)


def test_the_former_holder_s_dies_once_the_other_drives_and_changes_nothing(two: Two) -> None:
    two.grant()
    two.bob.until(lambda: two.bob.state["has_control"] and two.bob.mode == "ready")
    two.drive_fast(two.bob)
    two.drives_on(two.here.signal(signal.SIGKILL))
    two.bob.holds = None
    two.bob.send(t="release")


def test_the_new_holder_s_dies_and_the_former_gets_control_when_the_lease_ends(two: Two) -> None:
    two.grant()
    two.bob.until(lambda: two.bob.state["has_control"] and two.bob.mode == "ready")
    two.drive_fast(two.bob)
    killed_s = two.begin()
    two.there.signal(signal.SIGKILL)
    two.stood_still_since(killed_s)
    takes_control_within(two, two.alice, killed_s, TTL_S)
    two.stood_still_since(killed_s)
    drives(two, two.alice)
