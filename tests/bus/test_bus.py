"""Sessions that exchange real messages, in one process and over local TCP."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Callable

import pytest
import zenoh

from tests.support.robot_node import Mailbox, matched, poll_until, raw_client
from tsd_twin.bus import Bus, client_config
from tsd_twin.bus.config import MOST_MESSAGE_BYTES
from tsd_twin.errors import BusError
from tsd_twin.messages.topics import QoS, Sample

KEY = "twin/r1/state/odom"


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
    receiver.subscribe("twin/*/state/*", box)
    matched(sender.publisher(KEY, QoS.DATA)).put(b"payload", b"attachment")
    assert box.next() == Sample(KEY, b"payload", b"attachment", is_put=True)


@pytest.mark.parametrize(
    ("qos", "priority", "express"),
    [
        (QoS.REAL_TIME, zenoh.Priority.REAL_TIME, True),
        (QoS.DATA, zenoh.Priority.DATA, False),
    ],
)
def test_urgency_and_type_are_seen_by_who_receives(
    robot: Bus,
    connect: Callable[[], Bus],
    qos: QoS,
    priority: zenoh.Priority,
    express: bool,
) -> None:
    box = Mailbox()
    type_name = "nav_msgs/msg/Odometry"
    with raw_client(robot.endpoints()) as reader:
        reader.declare_subscriber(KEY, box)
        matched(connect().publisher(KEY, qos, type_name)).put(b"x")
        sample = box.next()
    assert (sample.priority, sample.express) == (priority, express)
    assert sample.congestion_control == zenoh.CongestionControl.DROP
    assert sample.encoding == zenoh.Encoding.APPLICATION_CDR.with_schema(type_name)


def test_plain_streams_are_json(robot: Bus, connect: Callable[[], Bus]) -> None:
    box = Mailbox()
    with raw_client(robot.endpoints()) as reader:
        reader.declare_subscriber(KEY, box)
        matched(connect().publisher(KEY, QoS.DATA)).put(b"{}")
        assert box.next().encoding == zenoh.Encoding.APPLICATION_JSON


def test_a_deletion_is_no_put(robot: Bus) -> None:
    box = Mailbox()
    robot.subscribe(KEY, box)
    with raw_client(robot.endpoints()) as writer:
        publisher = writer.declare_publisher(KEY)
        poll_until(lambda: publisher.matching_status.matching)
        publisher.delete()
        assert box.next().is_put is False


def test_a_reader_keeps_the_newest(robot: Bus, connect: Callable[[], Bus]) -> None:
    client, box = connect(), Mailbox()
    robot.subscribe(KEY, box)
    reader = robot.subscriber(KEY, 3)
    publisher = matched(client.publisher(KEY, QoS.DATA))
    for i in range(10):
        publisher.put(str(i).encode())
    while box.next().payload != b"9":
        pass
    assert [sample.payload for sample in reader.take_samples()] == [b"7", b"8", b"9"]
    assert reader.take_samples() == []
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
    """A sender that is faster than the reader would occupy an unbounded reader forever."""
    reader, full = robot.subscriber(KEY, 16), []
    with subprocess.Popen([sys.executable, "-c", FLOOD, *robot.endpoints(), KEY]) as flood:
        while len(full) < 100:
            if (size := len(reader.take_samples())) >= 16:
                full.append(size)
        flood.kill()
    assert full == [16] * 100


def test_what_is_far_too_long_for_a_command_does_not_arrive(
    robot: Bus, connect: Callable[[], Bus]
) -> None:
    key, box = "twin/r1/cmd/alice/twist", Mailbox()
    robot.subscribe(key, box)
    publisher = matched(connect().publisher(key, QoS.REAL_TIME))
    publisher.put(b"x" * 5000)
    publisher.put(b"x" * 4000)
    assert len(box.next().payload) == 4000


def test_a_publisher_can_be_closed_while_another_thread_puts(robot: Bus) -> None:
    """As when a robot returns while driven; Zenoh alone raises RuntimeError on both threads."""
    publishers = [robot.publisher(f"twin/tsd/test/{number}", QoS.REAL_TIME) for number in range(50)]
    errors: list[BaseException] = []

    def put_until_closed() -> None:
        for publisher in publishers:
            try:
                while True:
                    publisher.put(b"x")
            except BusError:
                continue  # It has been closed.
            except BaseException as error:
                errors.append(error)
                return

    putting = threading.Thread(target=put_until_closed)
    putting.start()
    for publisher in publishers:
        time.sleep(0.001)
        publisher.close()
    putting.join(10.0)
    assert not putting.is_alive()
    assert errors == []


def test_a_closed_session_is_used_in_vain_and_says_so(robot: Bus) -> None:
    bus = Bus(client_config(robot.endpoints()))
    publisher, reader, server = bus.publisher(KEY, QoS.DATA), bus.subscriber(KEY, 1), None
    server = bus.queryable("twin/r1/srv/arm")
    bus.close()
    bus.close()
    for use in (lambda: publisher.put(b"x"), reader.take_samples, server.take_requests):
        with pytest.raises(BusError):
            use()


def test_events_reach_those_who_come_later(robot: Bus, connect: Callable[[], Bus]) -> None:
    publisher = robot.publisher("twin/r1/event/mode", QoS.EVENT)
    for i in range(5):
        publisher.put(str(i).encode())
    box = Mailbox()
    connect().subscribe_events("twin/r1/event/*", box)
    assert [box.next().payload for _ in range(5)] == [b"0", b"1", b"2", b"3", b"4"]
    publisher.put(b"5")
    assert box.next().payload == b"5"


def test_events_of_a_kind_that_is_new_reach_those_who_wait(
    robot: Bus, connect: Callable[[], Bus]
) -> None:
    """The first event of a kind is sent as soon as its publisher exists, and must not be lost."""
    box, kept = Mailbox(), []
    connect().subscribe_events("twin/r1/event/*", box)
    for kind in ("mode", "drop", "clamp"):
        kept.append(robot.publisher(f"twin/r1/event/{kind}", QoS.EVENT))
        kept[-1].put(kind.encode())
        assert box.next().payload == kind.encode()


def test_a_message_that_is_too_long_is_dropped_and_the_session_goes_on(
    robot: Bus, connect: Callable[[], Bus]
) -> None:
    box = Mailbox()
    robot.subscribe("twin/*/state/*", box)
    publisher = matched(connect().publisher(KEY, QoS.DATA))
    for payload in (b"before", bytes(MOST_MESSAGE_BYTES + 1), bytes(20_000_000)):
        publisher.put(payload)
    assert box.next().payload == b"before"
    # Messages sent while the long one is still in transit are dropped, as for states.
    for _ in range(100):
        publisher.put(b"after")
        time.sleep(0.05)
    assert box.next().payload == b"after"
