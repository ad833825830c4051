"""Lanes of a page: messages that overtake each other over several sockets, over real sockets."""

from __future__ import annotations

import asyncio
import itertools
import json
import threading
from collections.abc import Generator
from contextlib import ExitStack, suppress
from typing import Any, get_args

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect
from websockets.sync.connection import Connection

from tests.dashboard.recorders import CommandRecorder
from tests.support.page_client import Page, Site, site
from tests.support.withheld import PATIENCE_S
from tsd_twin.dashboard.sessions.session_manager import MAX_LANES
from tsd_twin.dashboard.wire.from_page import LaneMessage, PageMessage

OTHERS = sorted(
    kind.__struct_config__.tag for kind in {*get_args(PageMessage)} - {*get_args(LaneMessage)}
)


class Lane:
    """Client side of a lane."""

    def __init__(self, socket: Connection) -> None:
        self.socket = socket
        self.states: list[int] = []

    def send(self, **message: Any) -> None:
        self.socket.send(json.dumps(message))

    def settle(self, seen: int) -> None:
        """Wait until all earlier messages on this lane have been handled."""
        self.send(t="heartbeat", status_seq=seen, sent_ms=2.0)
        while (message := json.loads(self.socket.recv(PATIENCE_S)))["t"] != "heartbeat":
            self.states.append(message["status_seq"])


class Driver:
    """Page in control with all its lanes."""

    def __init__(self, served: Site, page: Page, lanes: list[Lane]) -> None:
        self.served, self.page, self.lanes = served, page, lanes
        self.number = 0
        self._beats = 0

    @property
    def selection(self) -> int:
        return self.page.last("robot")["selection"]

    @property
    def seen(self) -> int:
        return self.page.state["status_seq"]

    def drive(self, by: int, number: int, vx: float, selection: int | None = None) -> None:
        """Drive the selected robot, or another one."""
        selection = self.selection if selection is None else selection
        command = {"t": "drive", "vx": vx, "vy": 0.0, "omega": 0.0, "status_seq": self.seen}
        self.send(by, number=number, selection=selection, **command)

    def send(self, by: int, **message: Any) -> None:
        """Send over a socket, 0 being the main one, and wait until the message is handled."""
        if by > 0:
            self.lanes[by - 1].send(**message)
            self.lanes[by - 1].settle(self.seen)
            return
        self._beats += 1
        self.page.send(**message)
        self.page.send(t="heartbeat", status_seq=self.seen, sent_ms=-float(self._beats))
        self.page.until(
            lambda: any(e["sent_ms"] == -self._beats for e in self.page.all("heartbeat"))
        )


def lane_of(served: Site, page: str, **options: Any) -> Connection:
    return connect(f"ws://127.0.0.1:{served.port}/teleop/lane?page={page}", **options)


def read_all(lane: Connection) -> None:
    while True:
        lane.recv(PATIENCE_S)


@pytest.fixture(scope="module")
def served() -> Generator[Site]:
    with site() as made:
        yield made


@pytest.fixture
def driver(served: Site) -> Generator[Driver]:
    with served.page() as page, ExitStack() as stack:
        page.make_ready()
        lanes = [Lane(stack.enter_context(lane_of(served, page.name))) for _ in range(MAX_LANES)]
        yield Driver(served, page, lanes)


@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(st.integers(0, MAX_LANES), st.integers(1, 9)), min_size=2, max_size=8))
def test_no_command_is_obeyed_after_a_newer_one(
    driver: Driver, sent: list[tuple[int, int]]
) -> None:
    first = driver.number
    commands = CommandRecorder(driver.served, driver.page)
    for by, step in sent:
        driver.drive(by, first + step, 1e-3 * step)
    driver.number = first + 10
    driver.send(1, t="release", number=driver.number, selection=driver.selection)
    moving = [command.twist[0] for command in commands.take() if command.twist.any()]
    assert moving == sorted(set(moving))
    newest = [max(step for _, step in sent[: i + 1]) for i in range(len(sent))]
    assert {round(1e3 * vx) for vx in moving} <= {*newest}


def test_a_command_that_a_release_has_overtaken_moves_nothing(driver: Driver) -> None:
    driver.drive(1, 1, 0.1)
    driver.send(2, t="release", number=3, selection=driver.selection)
    commands = CommandRecorder(driver.served, driver.page)
    driver.drive(3, 2, 0.1)
    driver.drive(0, 2, 0.1)
    assert not any(command.twist.any() for command in commands.take())
    driver.drive(1, 4, 0.1)
    assert any(command.twist.any() for command in commands.take())


def test_a_command_for_another_robot_than_the_one_selected_moves_nothing(driver: Driver) -> None:
    commands = CommandRecorder(driver.served, driver.page)
    for number, by in enumerate((0, 1, 2, 3), 1):
        driver.drive(by, number, 0.1, selection=driver.selection + 1)
    assert commands.take() == []


def test_a_release_holds_whatever_robot_is_selected(driver: Driver) -> None:
    commands = CommandRecorder(driver.served, driver.page)
    driver.drive(1, 1, 0.1)
    driver.send(2, t="release", number=2, selection=driver.selection + 1)
    assert not commands.take()[-1].twist.any()


def test_copies_of_a_stop_stop_once_and_another_stop_again(driver: Driver) -> None:
    page = driver.page
    driver.send(1, t="stop", number=1)
    page.until(lambda: page.mode == "stopped")
    page.until(lambda: page.answer("reset", t="reset")["ok"])
    page.until(lambda: page.mode == "disarmed")
    stops = page.state["status"]["stops"]
    for by in range(MAX_LANES + 1):
        driver.send(by, t="stop", number=1)
    page.answer("arm", t="arm")
    page.until(lambda: page.mode == "ready")
    assert page.state["status"]["stops"] == stops
    driver.drive(1, 1, 0.1)
    driver.send(3, t="stop", number=1)
    commands = CommandRecorder(driver.served, page)
    driver.drive(1, 2, 0.1)
    assert any(command.twist.any() for command in commands.take())
    driver.send(2, t="stop", number=2)
    page.until(lambda: page.mode == "stopped")


@pytest.mark.parametrize("kind", OTHERS)
def test_a_message_whose_order_matters_is_refused_over_a_lane(driver: Driver, kind: str) -> None:
    valid: dict[str, Any] = {
        "lease": {"op": "release"},
        "name": {"name": "Eve"},
        "plan": {"kind": "to", "points": [[1.0, 0.0]], "on": "floor"},
        "robot": {"id": "tsd"},
        "speed_level": {"level": 50},
        "wheel_speed": {"cruise_speed_rpm": 2000.0},
        "preview": {"twist": None},
        "plot_fields": {"names": []},
        "view": {"settings": {}},
        "look_back": {"history_offset_s": None},
        "student": {"number": 1, "base": "tsd", "knobs": {}},
    }
    flags = {each: {"on": False} for each in ("map", "fleet", "shadow")}
    rejected = driver.served.sessions.rejected
    driver.send(1, t=kind, **(valid | flags).get(kind, {}))
    assert driver.served.sessions.rejected == rejected + 1
    assert driver.page.state["has_control"]
    assert driver.page.mode == "ready"


@pytest.mark.parametrize("missing", ["number", "selection"])
def test_a_command_over_a_lane_needs_its_numbers(driver: Driver, missing: str) -> None:
    commands = CommandRecorder(driver.served, driver.page)
    numbers: dict[str, Any] = {"number": 1, "selection": driver.selection} | {missing: 0}
    command = {"t": "drive", "vx": 0.1, "vy": 0.0, "omega": 0.0, "status_seq": driver.seen}
    driver.send(1, **command, **numbers)
    assert commands.take() == []


def test_each_state_comes_once_and_over_all_sockets(driver: Driver) -> None:
    page, lanes = driver.page, driver.lanes
    main = len(page.all("state"))
    page.until(lambda: len(page.all("state")) > main + 5)
    for lane in lanes:
        lane.settle(driver.seen)
    found = [[state["status_seq"] for state in page.all("state")]]
    found += [lane.states for lane in lanes]
    assert all(len(numbers) > 3 and numbers == sorted(numbers) for numbers in found)
    numbers = [number for each in found for number in each]
    assert len(numbers) == len(set(numbers))


def test_lanes_are_limited_and_end_with_their_page(served: Site) -> None:
    name = "0011223344556677"
    with pytest.raises(InvalidStatus):
        lane_of(served, name)
    with ExitStack() as stack:
        with served.page(name) as page:
            page.until(lambda: page.state)
            lanes = [stack.enter_context(lane_of(served, name)) for _ in range(MAX_LANES)]
            with pytest.raises(InvalidStatus):
                lane_of(served, name)
        for lane in lanes:
            with pytest.raises(ConnectionClosed):
                read_all(lane)


def test_lanes_of_a_page_that_closes_move_nothing(served: Site) -> None:
    with ExitStack() as stack, served.page() as page:
        page.make_ready()
        # With a full queue, it reads nothing more, so that it does not hear that it is closed.
        lane = Lane(stack.enter_context(lane_of(served, page.name, max_queue=1)))
        driver = Driver(served, page, [lane])
        commands = CommandRecorder(served, page)
        command = {"t": "drive", "vx": 0.1, "vy": 0.0, "omega": 0.0, "status_seq": driver.seen}
        selection, numbers, closed = driver.selection, itertools.count(1), threading.Event()

        def hold() -> None:
            released = 0
            with suppress(ConnectionClosed):
                while not closed.wait(0.01):
                    if len(page.all("released")) > released:  # This thread was late.
                        released += 1
                        lane.send(t="release", number=next(numbers), selection=selection)
                    lane.send(**command, number=next(numbers), selection=selection)

        holding = threading.Thread(target=hold)
        holding.start()
        page.until(lambda: page.mode == "driving")
        commands.take()
        page.close()
        served.run(asyncio.sleep(0.5))
        closed.set()
        holding.join(PATIENCE_S)
        moving = [bool(each.twist.any()) for each in commands.take()]
        at_rest = [*moving, False].index(False)
        assert not any(moving[at_rest:])
