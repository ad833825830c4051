"""Sessions between which messages really travel, in one process and over one machine's TCP."""

from __future__ import annotations

import queue
import subprocess
import sys
import threading
from collections.abc import Callable, Generator
from typing import Any

import pytest
import zenoh

from tests.running import ANY_PORT, PATIENCE_S
from tsd_twin.bus import Bus, Publisher, client_config, node_config
from tsd_twin.errors import BusError, NoAnswerError
from tsd_twin.messages.command import Sample
from tsd_twin.topics import Urgency

KEY = "twin/r1/state/odom"


@pytest.fixture
def robot() -> Generator[Bus]:
    """A session that listens."""
    with Bus(node_config([ANY_PORT])) as bus:
        yield bus


@pytest.fixture
def connect(robot: Bus) -> Generator[Callable[[], Bus]]:
    """Make sessions that are linked to it."""
    opened: list[Bus] = []

    def open_one() -> Bus:
        opened.append(Bus(client_config(robot.endpoints())))
        assert opened[-1].wait_for_peer(PATIENCE_S)
        return opened[-1]

    yield open_one
    for bus in opened:
        bus.close()


class Mailbox:
    """Takes what a watcher gets, and waits for it."""

    def __init__(self) -> None:
        self._queue: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def __call__(self, *item: Any) -> None:
        self._queue.put(item[0] if len(item) == 1 else item)

    def next(self) -> Any:
        return self._queue.get(timeout=PATIENCE_S)


def matched(publisher: Publisher) -> Publisher:
    """Wait until the publisher knows of somebody who listens."""
    inner = publisher._publisher
    heard = threading.Event()
    listener = inner.declare_matching_listener(
        lambda status: heard.set() if status.matching else None
    )
    if not inner.matching_status.matching:
        assert heard.wait(PATIENCE_S)
    listener.undeclare()
    return publisher


def answering(bus: Bus, key: str, payload: bytes) -> Callable[[], None]:
    """Serve a key in a thread; the function that is returned ends it."""
    server, stop = bus.server(key), threading.Event()

    def serve() -> None:
        while not stop.wait(0.005):
            for request in server.take():
                request.reply(payload + request.payload)

    thread = threading.Thread(target=serve)
    thread.start()

    def end() -> None:
        stop.set()
        thread.join(PATIENCE_S)

    return end


# Streams.


def test_any_port_becomes_a_real_one(robot: Bus) -> None:
    (endpoint,) = robot.endpoints()
    assert endpoint.startswith("tcp/127.0.0.1:")
    assert int(endpoint.rpartition(":")[2]) > 0


@pytest.mark.parametrize("direction", ["to the robot", "from the robot"])
def test_a_sample_arrives_with_key_payload_and_attachment(
    robot: Bus, connect: Callable[[], Bus], direction: str
) -> None:
    sender, receiver = (connect(), robot) if direction == "to the robot" else (robot, connect())
    box = Mailbox()
    receiver.watch("twin/*/state/*", box)
    matched(sender.publisher(KEY, Urgency.DATA)).put(b"payload", b"attachment")
    assert box.next() == Sample(KEY, b"payload", b"attachment", is_put=True)


@pytest.mark.parametrize(
    ("urgency", "priority", "express"),
    [
        (Urgency.REAL_TIME, zenoh.Priority.REAL_TIME, True),
        (Urgency.DATA, zenoh.Priority.DATA, False),
    ],
)
def test_urgency_and_type_are_seen_by_who_receives(
    robot: Bus,
    connect: Callable[[], Bus],
    urgency: Urgency,
    priority: zenoh.Priority,
    express: bool,
) -> None:
    box = Mailbox()
    subscriber = robot._session.declare_subscriber(KEY, box)
    type_name = "nav_msgs/msg/Odometry"
    matched(connect().publisher(KEY, urgency, type_name)).put(b"x")
    sample = box.next()
    assert (sample.priority, sample.express) == (priority, express)
    assert sample.congestion_control == zenoh.CongestionControl.DROP
    assert sample.encoding == zenoh.Encoding.APPLICATION_CDR.with_schema(type_name)
    subscriber.undeclare()


def test_plain_streams_are_json(robot: Bus, connect: Callable[[], Bus]) -> None:
    box = Mailbox()
    subscriber = robot._session.declare_subscriber(KEY, box)
    matched(connect().publisher(KEY, Urgency.DATA)).put(b"{}")
    assert box.next().encoding == zenoh.Encoding.APPLICATION_JSON
    subscriber.undeclare()


def test_a_deletion_is_no_put(robot: Bus, connect: Callable[[], Bus]) -> None:
    box = Mailbox()
    robot.watch(KEY, box)
    publisher = matched(connect().publisher(KEY, Urgency.DATA))
    publisher._publisher.delete()
    assert box.next().is_put is False


def test_a_reader_keeps_the_newest(robot: Bus, connect: Callable[[], Bus]) -> None:
    client, box = connect(), Mailbox()
    robot.watch(KEY, box)
    reader = robot.reader(KEY, 3)
    publisher = matched(client.publisher(KEY, Urgency.DATA))
    for i in range(10):
        publisher.put(str(i).encode())
    while box.next().payload != b"9":
        pass
    assert [sample.payload for sample in reader.take()] == [b"7", b"8", b"9"]
    assert reader.take() == []
    assert reader.newest() is None


FLOOD = """
import sys, zenoh
config = zenoh.Config.from_json5('{mode: "client", connect: {endpoints: ["%s"]}}' % sys.argv[1])
with zenoh.open(config) as session:
    publisher = session.declare_publisher(sys.argv[2])
    while True:
        publisher.put(b"x" * 16)
"""


@pytest.mark.system
def test_a_flood_never_holds_up_who_reads(robot: Bus) -> None:
    """Whoever sends faster than it is read would keep an unbounded reader reading for ever."""
    reader, full = robot.reader(KEY, 16), []
    with subprocess.Popen([sys.executable, "-c", FLOOD, *robot.endpoints(), KEY]) as flood:
        while len(full) < 100:
            if (size := len(reader.take())) >= 16:
                full.append(size)
        flood.kill()
    assert full == [16] * 100


def test_what_is_far_too_long_for_a_command_does_not_arrive(
    robot: Bus, connect: Callable[[], Bus]
) -> None:
    key, box = "twin/r1/cmd/alice/twist", Mailbox()
    robot.watch(key, box)
    publisher = matched(connect().publisher(key, Urgency.REAL_TIME))
    publisher.put(b"x" * 5000)
    publisher.put(b"x" * 4000)
    assert len(box.next().payload) == 4000


def test_a_closed_session_is_used_in_vain_and_says_so(robot: Bus) -> None:
    bus = Bus(client_config(robot.endpoints()))
    publisher, reader, server = bus.publisher(KEY, Urgency.DATA), bus.reader(KEY, 1), None
    server = bus.server("twin/r1/srv/arm")
    bus.close()
    bus.close()
    for use in (lambda: publisher.put(b"x"), reader.take, server.take):
        with pytest.raises(BusError):
            use()


# Events.


def test_events_reach_those_who_come_later(robot: Bus, connect: Callable[[], Bus]) -> None:
    publisher = robot.publisher("twin/r1/event/mode", Urgency.EVENT)
    for i in range(5):
        publisher.put(str(i).encode())
    box = Mailbox()
    connect().watch_events("twin/r1/event/*", box)
    assert [box.next().payload for _ in range(5)] == [b"0", b"1", b"2", b"3", b"4"]
    publisher.put(b"5")
    assert box.next().payload == b"5"


def test_events_of_a_kind_that_is_new_reach_those_who_wait(
    robot: Bus, connect: Callable[[], Bus]
) -> None:
    """The first event of a kind is sent as soon as its publisher exists; it must not be lost."""
    box, kept = Mailbox(), []
    connect().watch_events("twin/r1/event/*", box)
    for kind in ("mode", "drop", "clamp"):
        kept.append(robot.publisher(f"twin/r1/event/{kind}", Urgency.EVENT))
        kept[-1].put(kind.encode())
        assert box.next().payload == kind.encode()


# Services.


def test_a_question_is_answered(robot: Bus, connect: Callable[[], Bus]) -> None:
    end = answering(robot, "twin/r1/desc", b"you said ")
    client = connect()
    try:
        assert client.ask("twin/r1/desc", b"hello", PATIENCE_S) == b"you said hello"
        assert client.ask("twin/r1/desc", b"", PATIENCE_S) == b"you said "
    finally:
        end()


def test_an_answer_to_a_pattern_names_the_one_who_answers(
    robot: Bus, connect: Callable[[], Bus]
) -> None:
    ends = [answering(robot, f"twin/{name}/desc", name.encode()) for name in ("r1", "r2")]
    client = connect()
    try:
        replies = client._session.get("twin/*/desc", timeout=PATIENCE_S)
        answers = {str(r.ok.key_expr): r.ok.payload.to_bytes() for r in replies if r.ok}
    finally:
        for end in ends:
            end()
    assert answers == {"twin/r1/desc": b"r1", "twin/r2/desc": b"r2"}


def test_silence_is_an_error_that_names_the_key(robot: Bus, connect: Callable[[], Bus]) -> None:
    client = connect()
    with pytest.raises(NoAnswerError, match="twin/nobody/desc: no answer within"):
        client.ask("twin/nobody/desc", b"", 0.2)
    robot.server("twin/r1/desc")  # Which nobody takes requests from.
    with pytest.raises(NoAnswerError, match=r"twin/r1/desc: no answer within 0\.2 s"):
        client.ask("twin/r1/desc", b"", 0.2)


# Who is there.


def test_who_lives_is_known_until_the_session_ends(robot: Bus, connect: Callable[[], Bus]) -> None:
    """A client of one robot sees the other robot, whose node has joined the node of the first."""
    box, late = Mailbox(), Mailbox()
    connect().watch_alive("twin/*/alive", box)
    other = Bus(node_config([ANY_PORT], robot.endpoints()))
    other.announce("twin/r2/alive")  # Nobody keeps the token: it lives on.
    assert box.next() == ("twin/r2/alive", True)
    assert robot.living("twin/*/alive") == ["twin/r2/alive"]
    connect().watch_alive("twin/*/alive", late)
    assert late.next() == ("twin/r2/alive", True)
    other.close()
    assert box.next() == ("twin/r2/alive", False)
    assert robot.living("twin/*/alive") == []


def test_a_token_can_be_taken_back(robot: Bus, connect: Callable[[], Bus]) -> None:
    box = Mailbox()
    connect().watch_alive("twin/*/alive", box)
    token = robot.announce("twin/r1/alive")
    assert box.next() == ("twin/r1/alive", True)
    token.close()
    assert box.next() == ("twin/r1/alive", False)


def test_a_router_that_joins_another_hears_of_those_who_live_there(robot: Bus) -> None:
    """Two robots on two machines: the second must see the first before it takes the same id."""
    robot.announce("twin/r1/alive")
    with Bus(node_config([ANY_PORT], robot.endpoints())) as other:
        assert other.living("twin/r1/alive", PATIENCE_S) == ["twin/r1/alive"]


def test_nobody_lives_where_nobody_is(robot: Bus) -> None:
    assert robot.living("twin/*/alive") == []


# Coming and going.


def test_a_client_finds_a_robot_that_comes_later() -> None:
    with Bus(node_config([ANY_PORT])) as first:
        (endpoint,) = first.endpoints()
    with Bus(client_config([endpoint])) as client:
        assert not client.wait_for_peer(0.3)  # It has tried, and was refused.
        box = Mailbox()
        client.watch(KEY, box)
        with Bus(node_config([endpoint])) as robot:
            assert client.wait_for_peer(PATIENCE_S)
            matched(robot.publisher(KEY, Urgency.DATA)).put(b"here")
            assert box.next().payload == b"here"


def test_a_client_finds_a_robot_that_comes_back() -> None:
    box = Mailbox()
    with Bus(node_config([ANY_PORT])) as first:
        (endpoint,) = first.endpoints()
        client = Bus(client_config([endpoint]))
        client.watch(KEY, box)
        matched(first.publisher(KEY, Urgency.DATA)).put(b"before")
        assert box.next().payload == b"before"
    with client, Bus(node_config([endpoint])) as again:
        matched(again.publisher(KEY, Urgency.DATA)).put(b"after")
        assert box.next().payload == b"after"
