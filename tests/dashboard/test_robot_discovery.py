"""A faulty robot affects no other: robots that appear, reply with nonsense, or not at all."""

from __future__ import annotations

import itertools
import json
import logging
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.support.page_client import robot_on_a_bus
from tests.support.robot_node import ANY_PORT, QUICK
from tests.support.withheld import PATIENCE_S, Stopwatch, WithheldTime
from tsd_twin import robots
from tsd_twin.bus import Bus, Publisher, client_config, node_config
from tsd_twin.dashboard.discovery import (
    MAX_PENDING_ROBOTS,
    MOST_ROBOTS,
    RobotConnector,
    RobotDiscovery,
    TakeReply,
)
from tsd_twin.messages import topics
from tsd_twin.messages.events import duplicate_id_text
from tsd_twin.messages.status import RobotStatus, encode_stamp, encode_status
from tsd_twin.messages.topics import QoS, Service

MANY = 1000
SEVERAL = 12
DEEP = "a=" + "[" * 10_000


def until(condition: Callable[[], bool]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s, "what was waited for has not come"
        time.sleep(0.01)


def describing(bus: Bus, robot_id: str, toml: str) -> Callable[[], None]:
    """Announce a robot with this description; the returned function ends it."""
    server, stop = bus.queryable(Service.DESC.key(robot_id)), threading.Event()
    answer = json.dumps({"robot": toml, "urdf": ""}).encode()

    def serve() -> None:
        while not stop.wait(0.005):
            for request in server.take_requests():
                request.reply(answer)

    thread = threading.Thread(target=serve)
    thread.start()
    bus.declare_token(topics.alive_key(robot_id))

    def end() -> None:
        stop.set()
        thread.join(PATIENCE_S)

    return end


@contextmanager
def watched() -> Generator[tuple[Bus, RobotDiscovery]]:
    """A fleet that watches a bus without robots."""
    with Bus(node_config([ANY_PORT])) as bus, Bus(client_config(bus.endpoints())) as client:
        assert client.wait_for_peer(PATIENCE_S)
        yield bus, RobotDiscovery(client)


def sees(fleet: RobotDiscovery, robot_id: str) -> bool:
    fleet.refresh()
    return robot_id in fleet.links


def test_tokens_without_a_robot_hide_none_that_comes_later() -> None:
    """Half of them have a server that never replies, so each query takes its full 1 s timeout."""
    with robot_on_a_bus() as endpoint, Bus(client_config([endpoint])) as client:
        hostile = Bus(node_config([ANY_PORT], [endpoint]))
        threads = threading.active_count()
        silent = [hostile.queryable(Service.DESC.key(f"a-{i}")) for i in range(MANY // 2)]
        for i in range(MANY):
            hostile.declare_token(topics.alive_key(f"a-{i}"))
        fleet = RobotDiscovery(client)
        late = Bus(node_config([ANY_PORT], [endpoint]))
        with hostile, late:
            until(lambda: sees(fleet, "tsd"))
            assert threading.active_count() - threads < 20  # Includes the threads of the bus.
            watch = Stopwatch()
            end = describing(late, "late", QUICK)
            until(lambda: sees(fleet, "late"))
            assert watch.took_s < 5.0
            end()
        assert set(fleet.links) == {"tsd", "late"}
        assert silent


WRONG = {
    "deep": DEEP,
    "long": QUICK + "#" * 20_000,
    "digits": "a=" + "9" * 5000,
    "no-toml": "?",
    "no-robot": "a = 1",
    "text": "a = '" + "<b>" * 3000 + "'",
}


@pytest.mark.parametrize("kind", WRONG)
def test_a_description_that_is_none_is_logged_once_and_hides_no_other(
    kind: str, caplog: pytest.LogCaptureFixture
) -> None:
    with watched() as (bus, fleet), caplog.at_level(logging.WARNING):
        ends = [describing(bus, f"bad-{i}", WRONG[kind]) for i in range(SEVERAL)]
        until(lambda: len(caplog.records) == SEVERAL)
        ends.append(describing(bus, "good", QUICK))
        until(lambda: sees(fleet, "good"))
        for end in ends:
            end()
    assert all("cannot be shown" in record.message for record in caplog.records)
    assert max(len(record.message) for record in caplog.records) < 400
    assert set(fleet.links) == {"good"}


def test_an_answer_that_is_no_json_or_too_long_hides_no_other() -> None:
    with watched() as (bus, fleet):
        answers = [
            b"[" * 100_000,
            b"\xff",
            b"{}",
            b'{"robot": "' + b"x" * 2**21 + b'", "urdf": ""}',
        ]
        servers = [bus.queryable(Service.DESC.key(f"bad-{i}")) for i in range(len(answers))]
        for i in range(len(answers)):
            bus.declare_token(topics.alive_key(f"bad-{i}"))
        answered = 0
        while answered < len(answers):
            for server, answer in zip(servers, answers, strict=True):
                for request in server.take_requests():
                    request.reply(answer)
                    answered += 1
            time.sleep(0.005)
        end = describing(bus, "good", QUICK)
        until(lambda: sees(fleet, "good"))
        end()
        assert set(fleet.links) == {"good"}


def test_a_robot_that_names_a_folder_reads_no_file_here(tmp_path: Path) -> None:
    """The path refers to the robot's machine; on the dashboard's, it could name any folder."""
    folder = tmp_path / "meshes"
    toml = QUICK.replace("[body]", f'[body]\nmeshes = "{folder}"', 1)
    assert robots.parse_description(toml, "a file").body.meshes == str(folder)
    with watched() as (bus, fleet):
        end = describing(bus, "r1", toml)
        until(lambda: sees(fleet, "r1"))
        end()
        assert fleet.links["r1"].robot.body.meshes is None
        ((robot_id, event),) = fleet.take_events()
        assert (robot_id, event.kind) == ("r1", "description")
        assert "generated look" in event.text


def test_no_more_robots_are_shown_than_there_is_room_for() -> None:
    with watched() as (bus, fleet):
        ends = [describing(bus, f"r{i}", QUICK) for i in range(MOST_ROBOTS + 6)]
        until(lambda: sees(fleet, "r0") and len(fleet.links) == MOST_ROBOTS)
        time.sleep(0.2)
        fleet.refresh()
        for end in ends:
            end()
        assert len(fleet.links) == MOST_ROBOTS


def say(status: Publisher, number: int, mode: str) -> None:
    status.put(encode_status(RobotStatus(mode=mode)), encode_stamp(number, 0))


def test_two_robots_with_one_id_are_shown_as_a_fault_without_flicker() -> None:
    """Their statuses alternate; the page shows a constant sentence."""
    with watched() as (bus, fleet):
        end = describing(bus, "tsd", QUICK)
        tokens = [bus.declare_token(topics.instance_key("tsd", "a" * 16))]
        until(lambda: sees(fleet, "tsd"))
        link, numbers = fleet.links["tsd"], itertools.count(1)
        status = bus.publisher(topics.STATUS.key("tsd"), QoS.REAL_TIME)

        def hears(mode: str) -> bool:
            say(status, next(numbers), mode)
            fleet.refresh()
            return link.poll(time.monotonic())

        until(lambda: hears("ready"))
        assert link.snapshot.status is not None
        assert link.snapshot.status.mode == "ready"
        tokens.append(bus.declare_token(topics.instance_key("tsd", "b" * 16)))
        until(lambda: fleet.refresh() == [] and link.has_duplicate)
        shown: set[tuple[str, str, str]] = set()
        sequence: list[int] = []
        for mode in ("driving", "disarmed", "stopped") * 5:
            until(lambda mode=mode: hears(mode))
            status_now = link.snapshot.status
            shown.add((status_now.mode, status_now.stop_reason, status_now.no_drive_reason))
            sequence.append(link.snapshot.status_seq)
        assert shown == {("fault", duplicate_id_text("tsd"), duplicate_id_text("tsd"))}
        assert sequence == sorted(set(sequence))
        tokens.pop().close()
        until(lambda: hears("ready") and link.snapshot.status.mode == "ready")
        end()


# Query schedule.


class Robots:
    """Robots with replies set by the test, on the querying thread."""

    def __init__(self, *answers: bytes | None) -> None:
        self.answers = list(answers)
        self.asked: list[tuple[str, float]] = []
        self.withheld_s: list[float] = []
        """Withheld time of this process at each request."""
        self._withheld = WithheldTime()
        self.met: list[tuple[str, bytes]] = []
        self.takes: list[TakeReply] = []

    def ask(self, robot_id: str, take: TakeReply) -> None:
        at_s = time.monotonic()
        if len(self.asked) < SEVERAL:  # Reading it takes long for a thousand requests.
            self.withheld_s.append(self._withheld.total_s)
        self.asked.append((robot_id, at_s))
        self.takes.append(take)
        if self.answers:
            take(self.answers.pop(0))

    @property
    def takes_by_name(self) -> dict[str, TakeReply]:
        return {name: take for (name, _), take in zip(self.asked, self.takes, strict=False)}

    def meet(self, robot_id: str, answer: bytes) -> None:
        if answer == b"bug":
            raise RecursionError(robot_id)
        self.met.append((robot_id, answer))


def test_no_robot_waits_for_the_silence_of_others() -> None:
    they = Robots()
    coming = RobotConnector(they.ask, they.meet)
    watch = Stopwatch()
    for i in range(MANY):
        coming.add_robot(f"r{i}")
    until(lambda: len(they.asked) == MANY)
    assert watch.took_s < 2.0
    they.takes[-1](b"hello")
    until(lambda: they.met == [(they.asked[-1][0], b"hello")])


def test_who_does_not_answer_is_asked_again_ever_more_seldom_until_it_goes() -> None:
    they = Robots(None, None, None)
    coming = RobotConnector(they.ask, they.meet)
    coming.add_robot("r1")
    until(lambda: len(they.asked) == 3)
    coming.remove_robot("r1")
    first_s, second_s, third_s = (at_s for _, at_s in they.asked)
    first_withheld_s, second_withheld_s, _ = they.withheld_s
    assert 0.45 < second_s - first_s < 0.9 + second_withheld_s - first_withheld_s
    assert third_s - second_s > 0.9
    they.answers.append(b"hello")
    watch = Stopwatch()
    coming.add_robot("r1")  # Queried again at once.
    until(lambda: they.met == [("r1", b"hello")])
    assert watch.took_s < 0.4


def test_a_robot_that_comes_again_while_it_is_asked_is_asked_again() -> None:
    """It may have restarted as another robot, so the earlier reply is discarded."""
    they = Robots()
    coming = RobotConnector(they.ask, they.meet)
    coming.add_robot("r1")
    until(lambda: len(they.takes) == 1)
    coming.add_robot("r1")
    until(lambda: len(they.takes) == 2)
    they.takes[0](b"old")
    they.takes[1](b"new")
    until(lambda: bool(they.met))
    assert they.met == [("r1", b"new")]


def test_a_bug_in_meeting_one_ends_the_meeting_of_none(caplog: pytest.LogCaptureFixture) -> None:
    they = Robots(*[b"bug"] * SEVERAL, b"good")
    coming = RobotConnector(they.ask, they.meet)
    for i in range(SEVERAL + 1):
        coming.add_robot(f"r{i}")
    until(lambda: len(they.met) == 1)
    assert len(caplog.records) == SEVERAL


def test_what_waits_is_bounded_and_the_newest_is_kept() -> None:
    they = Robots()
    coming = RobotConnector(they.ask, they.meet)
    for i in range(3 * MAX_PENDING_ROBOTS):
        coming.add_robot(f"r{i}")
    coming.add_robot("newest")
    until(lambda: [name for name, *_ in they.asked[-1:]] == ["newest"])
    takes = they.takes_by_name
    waiting = [name for name in takes if name != "newest"]
    for start in range(0, len(waiting), MAX_PENDING_ROBOTS // 2):
        for name in waiting[start : start + MAX_PENDING_ROBOTS // 2]:
            takes[name](b"hello")
        # The queue of answers drops the oldest, so wait for one that comes after these.
        coming.add_robot(f"last{start}")
        until(lambda start=start: f"last{start}" in they.takes_by_name)
        they.takes_by_name[f"last{start}"](b"last")
        until(lambda start=start: (f"last{start}", b"last") in they.met)
    assert sum(name in waiting for name, _ in they.met) <= MAX_PENDING_ROBOTS
    takes["newest"](b"hello")
    until(lambda: they.met[-1] == ("newest", b"hello"))
