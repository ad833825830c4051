"""Whatever dies, hangs or is cut while the robot drives at 1 m/s: it comes to a standstill."""

from __future__ import annotations

import signal
import time
from collections.abc import Generator
from dataclasses import dataclass

import pytest

from tests.system.faults import SPEED_MPS, PretendPage, Run, Stage, send_signal, stage
from tsd_twin.linksim import LinkSpec

pytestmark = pytest.mark.system

LIMIT_M = 0.35
MOVED_M = 0.002
"""Standstill is standstill: a servo step of 0.09 degrees is 16 mm/s, so 2 mm is 0.12 s of one."""
WATCHED_S = 1.5
"""For how long nothing may move after the last thing that happened."""
MAX_AGE_S = 1.0
"""Of a patient lease: the oldest that a command may be."""
PAUSE_S = 0.02
SLOW_MPS = 0.3
"""What a patient lease allows is a little more."""


@dataclass
class Table:
    """What was measured, a row for each fault."""

    rows: list[tuple[str, str, str, str, str]]

    def add(self, fault: str, run: Run, note: str = "") -> Run:
        moved = f"{1000 * run.after_m:.0f} mm" if run.after_m > MOVED_M else "no"
        self.rows.append((fault, f"{run.distance_m:.3f}", f"{run.time_s:.2f}", moved, note))
        return run

    def lines(self) -> list[str]:
        head = ("fault at 1 m/s", "distance m", "time s", "moved again", "")
        rows = [head, *self.rows]
        widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
        return [" | ".join(c.ljust(w) for c, w in zip(r, widths, strict=True)) for r in rows]


@pytest.fixture(scope="module")
def table(request: pytest.FixtureRequest) -> Generator[Table]:
    it = Table([])
    yield it
    plugins = request.config.pluginmanager
    terminal, capture = map(plugins.get_plugin, ("terminalreporter", "capturemanager"))
    assert terminal is not None
    assert capture is not None
    with capture.global_and_fixture_disabled():
        terminal.ensure_newline()
        for line in it.lines():
            terminal.write_line(line.rstrip())


@pytest.fixture(scope="module")
def lasting(tmp_path_factory: pytest.TempPathFactory) -> Generator[Stage]:
    with stage(tmp_path_factory.mktemp("robot")) as it:
        yield it


@pytest.fixture
def scene(lasting: Stage) -> Generator[Stage]:
    """The robot and its link; the pages of a test end with it."""
    yield lasting
    lasting.close_pages()
    lasting.link.set(LinkSpec())
    lasting.observer.until_rest()


def watch(scene: Stage, fault_s: float, over_s: float, under_way_s: float = 0.0) -> Run:
    """Look on until some time after all is over, and return what the robot did since the fault."""
    scene.observer.until_rest()
    scene.observer.until_time(over_s + WATCHED_S)
    return scene.observer.run_since(fault_s, under_way_s)


def stands_still(run: Run) -> None:
    assert run.distance_m <= LIMIT_M
    assert run.after_m <= MOVED_M


def drives_again_once_let_go(scene: Stage, page: PretendPage) -> None:
    """A hand that lets go and pushes again moves the robot, so it was not deaf before."""
    page.do("release")
    page.get_ready()
    page.do("push", 0.3)
    scene.observer.until_speed(0.3)
    page.do("release")
    scene.observer.until_rest()


def test_a_dashboard_that_is_killed(scene: Stage, table: Table) -> None:
    page = scene.driving_page()
    fault_s = send_signal(scene.dashboard.process.pid, signal.SIGKILL)
    page.until("lost")
    stands_still(table.add("dashboard SIGKILL", watch(scene, fault_s, time.monotonic())))


def test_a_dashboard_that_hangs_and_goes_on(scene: Stage, table: Table) -> None:
    """The page never stops pushing: 5 s of its commands wait in the socket of the dashboard."""
    page = scene.driving_page()
    before = scene.observer.dropped
    fault_s = send_signal(scene.dashboard.process.pid, signal.SIGSTOP)
    scene.observer.until_time(fault_s + 5.0)
    goes_on_s = send_signal(scene.dashboard.process.pid, signal.SIGCONT)
    run = watch(scene, fault_s, goes_on_s)
    stands_still(table.add("dashboard SIGSTOP 5 s, SIGCONT", run, drops(scene, before)))
    drives_again_once_let_go(scene, page)


def test_a_page_that_is_killed(scene: Stage, table: Table) -> None:
    fault_s = scene.driving_page().send_signal(signal.SIGKILL)
    stands_still(table.add("page SIGKILL", watch(scene, fault_s, fault_s)))


@pytest.mark.parametrize("length_s", [0.5, 3.0])
def test_a_page_that_hangs_and_goes_on(scene: Stage, table: Table, length_s: float) -> None:
    page = scene.driving_page()
    fault_s = page.send_signal(signal.SIGSTOP)
    scene.observer.until_time(fault_s + length_s)
    run = watch(scene, fault_s, page.send_signal(signal.SIGCONT))
    stands_still(table.add(f"page SIGSTOP {length_s:g} s, SIGCONT", run))
    assert page.count("released") == 1
    drives_again_once_let_go(scene, page)


def test_a_page_that_closes_its_socket(scene: Stage, table: Table) -> None:
    fault_s = scene.driving_page().do("close")
    stands_still(table.add("page closes its socket", watch(scene, fault_s, fault_s)))


def test_a_page_that_falls_silent_without_letting_go(scene: Stage, table: Table) -> None:
    page = scene.driving_page()
    fault_s = page.do("freeze")
    stands_still(table.add("page sends no more, no release", watch(scene, fault_s, fault_s)))
    assert page.count("released") == 1


@pytest.mark.parametrize("length_s", [0.5, 2.0, 5.0])
def test_a_link_that_stalls_and_recovers(scene: Stage, table: Table, length_s: float) -> None:
    """The page never stops pushing, and the link hands over late what it held back."""
    page = scene.driving_page()
    before = scene.observer.dropped
    fault_s = time.monotonic()
    scene.link.stall(length_s)
    run = watch(scene, fault_s, fault_s + length_s)
    stands_still(table.add(f"link stalls for {length_s:g} s", run, drops(scene, before)))
    assert page.count("released") == 1
    drives_again_once_let_go(scene, page)


@pytest.mark.parametrize("insists_s", [0.1, 5.0])
def test_a_link_that_loses_and_delays(scene: Stage, table: Table, insists_s: float) -> None:
    """A person who accepts to be slower drives on as far as the link lets her, then lets go."""
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
    # What was pushed before may be under way for as long as the lease says, and then no more.
    run = watch(scene, released_s, released_s + 2.0, MAX_AGE_S)
    note = f"at {SLOW_MPS} m/s, let go after {way_m:.2f} m in {insists_s:g} s"
    stands_still(table.add("link loses 10 %, jitter 100 ms", run, note))


def test_a_robot_node_that_hangs_or_is_killed(
    tmp_path_factory: pytest.TempPathFactory, table: Table
) -> None:
    """A simulated robot moves no further than its process; a machine needs a board that times out.

    What the simulator makes up for after SIGCONT is what a machine would have done meanwhile.
    """
    with stage(tmp_path_factory.mktemp("node")) as scene:
        page = scene.driving_page()
        observer, pid = scene.observer, scene.mock.process.pid
        fault_s = send_signal(pid, signal.SIGSTOP)
        heard = len(observer.truth)
        time.sleep(1.0)  # There is no event in that nothing happens.
        assert len(observer.truth) <= heard + 2
        goes_on_s = send_signal(pid, signal.SIGCONT)
        observer.until_time(goes_on_s)
        run = watch(scene, fault_s, goes_on_s)
        table.add("robot node SIGSTOP 1 s, SIGCONT", run, "a machine needs a board time-out")
        # The second that is missed, at 1 m/s, is what the last set-point stood for.
        assert run.distance_m <= 1.0 + LIMIT_M
        assert run.after_m <= MOVED_M
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
        note = "ends with its process; a machine needs a board time-out"
        table.add("robot node SIGKILL", Run(way_m, 0.0, 0.0), note)


def drops(scene: Stage, before: dict[str, int]) -> str:
    """Return which commands have not counted since."""
    now = scene.observer.dropped
    new = {name: now[name] - before[name] for name in now if now[name] > before[name]}
    return "dropped " + ", ".join(f"{count} {name}" for name, count in new.items()) if new else ""
