"""After any crash, hang or cut at 1 m/s, the robot comes to a standstill."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Generator

import pytest

from tests.support.pretend_page import PretendPage, send_signal
from tests.support.withheld import Pauses
from tests.system.fault_stage import (
    LIMIT_M,
    MAX_COMMAND_PAUSE_S,
    SPEED_MPS,
    FaultStage,
    Run,
    Table,
    fault_stage,
    stands_still,
)
from tsd_twin.link_emulation import LinkSpec
from tsd_twin.simulation.robot import TIMEOUT_S

pytestmark = pytest.mark.system

HELD_S = 5.0
MAX_PAUSE_S = 0.05
"""Maximum gap between states, which are 20 ms apart; longer loop pauses are reported."""
WATCHED_S = 1.0
"""Time without motion required after the last event."""
MOST_NEES = 16.3
"""99.9 % quantile of chi-square with three degrees of freedom."""
MAX_AGE_S = 1.0
"""Maximum command age under a long lease."""
PAUSE_S = 0.02
SLOW_MPS = 0.3
"""Slightly below the speed limit of a lease with `MAX_AGE_S`."""


@pytest.fixture(scope="module")
def lasting(tmp_path_factory: pytest.TempPathFactory) -> Generator[FaultStage]:
    with fault_stage(tmp_path_factory.mktemp("robot")) as it:
        yield it


@pytest.fixture
def scene(lasting: FaultStage) -> Generator[FaultStage]:
    """The robot and its link; the pages of a test end with it."""
    yield lasting
    lasting.close_pages()
    lasting.link.set(LinkSpec())
    lasting.observer.until_rest()


def watch(scene: FaultStage, fault_s: float, over_s: float, under_way_s: float = 0.0) -> Run:
    """Observe until `WATCHED_S` after the last event, and return the run since the fault."""
    scene.observer.until_rest()
    scene.observer.until_time(over_s + WATCHED_S)
    return scene.observer.run_since(fault_s, under_way_s)


def drives_again_once_let_go(scene: FaultStage, page: PretendPage) -> None:
    """A push after a release moves the robot, so the page was connected before."""
    page.do("release")
    page.get_ready()
    page.do("push", 0.3)
    scene.observer.until_speed(0.3)
    page.do("release")
    scene.observer.until_rest()


def test_without_a_fault_a_held_stick_keeps_driving(scene: FaultStage) -> None:
    """Robot and dashboard pause only as long as the machine delays them."""
    page, observer = scene.driving_page(), scene.observer
    programs = (scene.mock, scene.dashboard, page)
    observer.pauses = states = Pauses(scene.mock.process.pid)
    observer.command_pauses = commands = Pauses(os.getpid(), *(it.process.pid for it in programs))
    before, end_s = observer.status.stops, time.monotonic() + HELD_S
    # After a release, nothing is commanded any more, whatever the machine does.
    observer.until_time(end_s, lambda: page.count("released") > 0)
    observer.pauses = None
    observer.end_command_pauses()
    assert states.longest_s < MAX_PAUSE_S
    assert commands.longest_s < MAX_COMMAND_PAUSE_S
    if states.on_the_clock_s < MAX_PAUSE_S and commands.on_the_clock_s < MAX_COMMAND_PAUSE_S:
        assert (observer.status.mode, observer.status.stops) == ("driving", before)
        assert page.count("released") == 0
    page.do("release")
    observer.until_rest()


def test_a_dashboard_that_is_killed(scene: FaultStage, table: Table) -> None:
    page = scene.driving_page()
    fault_s = send_signal(scene.dashboard.process.pid, signal.SIGKILL)
    page.until("lost")
    stands_still(table.add("dashboard SIGKILL", watch(scene, fault_s, time.monotonic())))


def test_a_dashboard_that_hangs_and_goes_on(scene: FaultStage, table: Table) -> None:
    """The page never stops pushing, so 5 s of commands queue in the dashboard's socket."""
    page = scene.driving_page()
    before = scene.observer.dropped
    fault_s = send_signal(scene.dashboard.process.pid, signal.SIGSTOP)
    scene.observer.until_time(fault_s + 5.0)
    goes_on_s = send_signal(scene.dashboard.process.pid, signal.SIGCONT)
    run = watch(scene, fault_s, goes_on_s)
    stands_still(table.add("dashboard SIGSTOP 5 s, SIGCONT", run, drops(scene, before)))
    drives_again_once_let_go(scene, page)


def test_a_page_that_is_killed(scene: FaultStage, table: Table) -> None:
    fault_s = scene.driving_page().send_signal(signal.SIGKILL)
    stands_still(table.add("page SIGKILL", watch(scene, fault_s, fault_s)))


@pytest.mark.parametrize("length_s", [0.5, 3.0])
def test_a_page_that_hangs_and_goes_on(scene: FaultStage, table: Table, length_s: float) -> None:
    page = scene.driving_page()
    fault_s = page.send_signal(signal.SIGSTOP)
    scene.observer.until_time(fault_s + length_s)
    run = watch(scene, fault_s, page.send_signal(signal.SIGCONT))
    stands_still(table.add(f"page SIGSTOP {length_s:g} s, SIGCONT", run))
    assert page.count("released") == 1
    drives_again_once_let_go(scene, page)


def test_a_page_that_closes_its_socket(scene: FaultStage, table: Table) -> None:
    fault_s = scene.driving_page().do("close")
    stands_still(table.add("page closes its socket", watch(scene, fault_s, fault_s)))


def test_a_page_that_falls_silent_without_letting_go(scene: FaultStage, table: Table) -> None:
    page = scene.driving_page()
    fault_s = page.do("freeze")
    stands_still(table.add("page sends no more, no release", watch(scene, fault_s, fault_s)))
    assert page.count("released") == 1


@pytest.mark.parametrize("length_s", [0.5, 2.0, 5.0])
def test_a_link_that_stalls_and_recovers(scene: FaultStage, table: Table, length_s: float) -> None:
    """The page never stops pushing, and the link delivers held packets late."""
    page = scene.driving_page()
    before = scene.observer.dropped
    fault_s = time.monotonic()
    scene.link.stall(length_s)
    run = watch(scene, fault_s, fault_s + length_s)
    stands_still(table.add(f"link stalls for {length_s:g} s", run, drops(scene, before)))
    assert page.count("released") == 1
    drives_again_once_let_go(scene, page)


@pytest.mark.parametrize("insists_s", [0.1, 5.0])
def test_a_link_that_loses_and_delays(scene: FaultStage, table: Table, insists_s: float) -> None:
    """Under a long lease the robot drives on slowly, and stops when the stick is released."""
    page, observer = scene.page(), scene.observer
    page.get_ready(MAX_AGE_S)
    page.do("insist", SPEED_MPS)
    observer.until_speed(SLOW_MPS)
    fault_s = time.monotonic()
    scene.link.set(LinkSpec(loss=0.1, jitter_s=0.1, seed=1))
    observer.until_time(fault_s + insists_s)
    way_m = observer.way_since(fault_s)
    assert way_m > 0.0
    released_s = page.do("release")
    # Commands sent before the release may still arrive until the lease rejects them as too old.
    run = watch(scene, released_s, released_s + 2.0, MAX_AGE_S)
    note = f"at {SLOW_MPS} m/s, let go after {way_m:.2f} m in {insists_s:g} s"
    stands_still(table.add("link loses 10 %, jitter 100 ms", run, note))


def test_a_robot_node_that_hangs_or_is_killed(
    tmp_path_factory: pytest.TempPathFactory, table: Table
) -> None:
    """After SIGCONT the simulated board catches up in virtual time."""
    with fault_stage(tmp_path_factory.mktemp("node")) as scene:
        page = scene.driving_page()
        observer, pid = scene.observer, scene.mock.process.pid
        fault_s = send_signal(pid, signal.SIGSTOP)
        heard = len(observer.truth)
        time.sleep(5.0)  # Without an effect there is no event.
        assert len(observer.truth) <= heard + 2
        goes_on_s = send_signal(pid, signal.SIGCONT)
        observer.until_time(goes_on_s)
        run = watch(scene, fault_s, goes_on_s)
        note = f"the simulated board trips after {TIMEOUT_S:g} s; then a fault"
        stands_still(table.add("robot node SIGSTOP 5 s, SIGCONT", run, note))
        observer.until(lambda: observer.status.mode == "fault", "a fault that the node latches")
        observer.until(
            lambda: observer.at_rest and observer.nees < MOST_NEES, "a pose within limits"
        )
        drives_again_once_let_go(scene, page)
        page.do("push", 1.0)
        observer.until_speed()
        fault_s = send_signal(pid, signal.SIGKILL)
        scene.mock.wait()
        heard = len(observer.truth)
        time.sleep(0.2)
        assert len(observer.truth) == heard
        way_m = sum(speed * PAUSE_S for at_s, _, speed in observer.truth if at_s > fault_s)
        assert way_m <= LIMIT_M
        note = "a simulated robot ends with its process; a machine needs such a board"
        table.add("robot node SIGKILL", Run(way_m, 0.0, 0.0), note)


def drops(scene: FaultStage, before: dict[str, int]) -> str:
    """Return the number of rejected commands since, by reason."""
    now = scene.observer.dropped
    new = {name: now[name] - before[name] for name in now if now[name] > before[name]}
    return "dropped " + ", ".join(f"{count} {name}" for name, count in new.items()) if new else ""
