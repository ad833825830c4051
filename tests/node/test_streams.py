"""Messages and replies of a robot, read by raw Zenoh and the ROS definitions."""

from __future__ import annotations

import json
import struct
import time
from collections import defaultdict
from collections.abc import Generator
from typing import Any

import numpy as np
import pytest
import zenoh
from rosbags.typesys import Stores, get_typestore

from tests.support.bus_operator import BusOperator
from tests.support.robot_node import URDF, Mailbox, RunningNode, poll_until, running
from tests.support.withheld import PATIENCE_S, WithheldTime
from tsd_twin.messages import topics
from tsd_twin.messages.events import Event
from tsd_twin.messages.status import Summary, decode_summary
from tsd_twin.messages.topics import Service

CDR = "application/cdr;{}"
STREAMS = {
    "state/joints": (CDR.format("sensor_msgs/msg/JointState"), 0.02),
    "state/setpoint": (CDR.format("sensor_msgs/msg/JointState"), 0.02),
    "state/odom": (CDR.format("nav_msgs/msg/Odometry"), 0.02),
    "state/truth": (CDR.format("nav_msgs/msg/Odometry"), 0.02),
    "state/status": ("application/json", 0.05),
}
HOLDERS = (Service.ARM, Service.DISARM, Service.RESET, Service.SET_POSE)
GARBAGE = (b"", b"{}", b"[1]", b"\xff\xfe\x00", b'{"lease": "\xff"}', b'{"a":' * 700, b"\0" * 4000)


@pytest.fixture(scope="module")
def robot() -> Generator[RunningNode]:
    """One robot for all of these tests, which do not move it."""
    with running() as it:
        yield it


@pytest.fixture(scope="module")
def alice(robot: RunningNode) -> Generator[BusOperator]:
    with BusOperator(robot) as pilot:
        yield pilot


def test_every_stream_has_its_encoding_its_rate_and_a_rising_stamp(robot: RunningNode) -> None:
    heard: dict[str, list[zenoh.Sample]] = defaultdict(list)
    box = Mailbox()
    with robot.raw_client() as client, WithheldTime() as withheld:
        client.declare_subscriber("twin/tsd/**", box)
        while min((len(heard[key]) for key in STREAMS), default=0) < 10:
            sample = box.next()
            heard[str(sample.key_expr).removeprefix("twin/tsd/")].append(sample)
    for key, (encoding, period_s) in STREAMS.items():
        assert {str(sample.encoding) for sample in heard[key]} == {encoding}
        assert all(sample.priority == zenoh.Priority.DATA for sample in heard[key])
        stamps = [struct.unpack("<Qq", s.attachment.to_bytes()) for s in heard[key]]
        numbers, times_ns = np.array(stamps).T
        np.testing.assert_array_equal(np.diff(numbers), 1)
        assert (np.diff(times_ns) > 0).all()
        # A loop that waits for the processor skips periods, and never hurries: half of them are
        # as late as the median, or later.
        late_s = withheld.total_s / (len(times_ns) // 2)
        assert 0.7 * period_s < np.median(np.diff(times_ns)) * 1e-9 < 1.3 * period_s + late_s
    assert set(heard) - set(STREAMS) <= {"state/summary", "event/drop", "log/inputs"}


def test_a_summary_repeats_the_streams_twice_a_second(robot: RunningNode) -> None:
    statuses: dict[int, bytes] = {}
    summaries: list[tuple[int, Summary]] = []
    box = Mailbox()
    with robot.raw_client() as client, WithheldTime() as withheld:
        client.declare_subscriber("twin/tsd/state/*", box)
        while len(summaries) < 3:
            sample = box.next()
            number, robot_ns = struct.unpack("<Qq", sample.attachment.to_bytes())
            if str(sample.key_expr).endswith("/status"):
                statuses[number] = sample.payload.to_bytes()
            elif str(sample.key_expr).endswith("/summary"):
                assert str(sample.encoding) == "application/msgpack"
                summaries.append((robot_ns, decode_summary(sample.payload.to_bytes())))
    for _, summary in summaries[1:]:
        assert set(summary.payloads) == set(STREAMS)
        assert summary.payloads["state/status"] == statuses[summary.status_seq]
    times_s = 1e-9 * np.array([robot_ns for robot_ns, _ in summaries])
    periods_s = np.diff(times_s)
    assert 0.35 < periods_s.min() <= periods_s.max() < 0.65 + withheld.total_s


@pytest.mark.parametrize("stream", STREAMS)
def test_a_late_subscriber_gets_each_stream_within_two_periods(
    robot: RunningNode, stream: str
) -> None:
    """Messages without a subscriber are counted but not built, so the numbers show the gap."""
    period_s = STREAMS[stream][1]
    took_s: list[float] = []
    heard: list[tuple[int, int]] = []
    with robot.raw_client() as client, WithheldTime() as in_all:
        for _ in range(5):
            box, start_s = Mailbox(), time.monotonic()
            with WithheldTime() as withheld:
                subscriber = client.declare_subscriber(f"twin/tsd/{stream}", box)
                stamp = box.next().attachment.to_bytes()
            took_s.append(time.monotonic() - start_s - withheld.total_s)
            subscriber.undeclare()
            heard.append(struct.unpack("<Qq", stamp))
            time.sleep(5 * period_s)
    assert max(took_s) < 2.0 * period_s, took_s
    numbers, times_ns = np.array(heard).T
    assert (np.diff(numbers) > 0).all()
    assert np.median(np.diff(numbers)) >= 3.0  # Numbers advance while unsubscribed.
    passed_s, counted_s = (times_ns[-1] - times_ns[0]) * 1e-9, np.diff(numbers).sum() * period_s
    assert 0.5 * passed_s - in_all.total_s <= counted_s <= 1.5 * passed_s


def test_any_reader_of_ros_messages_reads_them(alice: BusOperator) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    for what, frame in (("joints", "base_link"), ("setpoint", "base_link")):
        message = store.deserialize_cdr(alice.newest[what].payload, "sensor_msgs/msg/JointState")
        assert message.header.frame_id == frame
        assert message.name == [
            f"module{i}_{part}" for i in (1, 2, 3) for part in ("alpha", "beta", "wheel")
        ]
        assert np.isnan(message.position[2::3]).all()
        np.testing.assert_array_equal(message.velocity[2::3], 0.0)
    for what in ("odom", "truth"):
        message = store.deserialize_cdr(alice.newest[what].payload, "nav_msgs/msg/Odometry")
        assert (message.header.frame_id, message.child_frame_id) == ("odom", "base_link")
        assert message.pose.pose.orientation.w == 1.0
        assert np.shape(message.pose.covariance) == (36,)


def test_the_status_is_json_with_facts_about_loop_and_hardware(alice: BusOperator) -> None:
    status = json.loads(alice.newest["status"].payload)
    assert status["mode"] == "disarmed"
    assert status["hardware"]["kind"] == "sim"
    assert 20.0 < status["loop"]["hz"] < 110.0
    assert set(status["command"]["dropped"]) == {
        "stale", "lease", "order", "nonfinite", "key", "shape"
    }  # fmt: skip


def test_the_description_is_what_the_robot_runs_on(robot: RunningNode, alice: BusOperator) -> None:
    for raw in (b"", b"{}", b"anything"):
        assert alice.ask(Service.DESC, raw) == {"robot": robot.toml, "urdf": URDF}


def test_its_life_is_announced(robot: RunningNode) -> None:
    with robot.client() as client:
        assert client.living_tokens("twin/*/alive", PATIENCE_S) == ["twin/tsd/alive"]


@pytest.mark.parametrize("payload", GARBAGE)
@pytest.mark.parametrize("service", [*HOLDERS, Service.LEASE])
def test_garbage_is_answered_with_a_reason(
    alice: BusOperator, service: Service, payload: bytes
) -> None:
    reply = alice.ask(service, payload)
    assert reply["ok"] is False
    assert "shape" in reply["reason"]


@pytest.mark.parametrize("service", HOLDERS)
def test_what_needs_the_lease_is_refused_without(alice: BusOperator, service: Service) -> None:
    reply = alice.ask(service, lease="00" * 16, x_m=0, y_m=0, heading_rad=0)
    assert (reply["ok"], reply["why"]) == (False, {"code": "take_control_first"})


def test_the_answer_to_a_lease_has_the_fields_that_others_rely_on(alice: BusOperator) -> None:
    granted = alice.acquire()
    assert granted["granted"] is True
    assert (granted["holder"], granted["ttl_s"], granted["reason"]) == ("alice", 2.0, "")
    assert len(bytes.fromhex(granted["lease"])) == 16
    alice.wait_until(lambda: alice.status.lease.holder == "alice")
    renewed = alice.ask(Service.LEASE, op="renew", operator="alice", lease=alice.lease)
    assert renewed["granted"] is True
    refused = alice.ask(Service.LEASE, op="acquire", operator="bob")
    assert refused["granted"] is False
    assert (refused["lease"], refused["holder"]) == (None, "alice")
    released = alice.ask(Service.LEASE, op="release", operator="alice", lease=alice.lease)
    assert released["granted"] is False
    alice.wait_until(lambda: alice.status.lease.holder is None)


def drops(pilot: BusOperator) -> dict[str, int]:
    return json.loads(pilot.newest["status"].payload)["command"]["dropped"]


def test_garbage_on_every_key_is_counted_or_ignored_and_ends_nothing(
    robot: RunningNode, alice: BusOperator
) -> None:
    keys = [topics.twist_key("tsd", "alice"), "twin/tsd/cmd/*/twist", "twin/tsd/cmd/a$*/twist"]
    keys += [key for topic in topics.TOPICS[2:] if "*" not in (key := topic.key("tsd"))]
    keys += [service.key("tsd") for service in Service if service is not Service.STOP]
    keys += ["twin/tsd/event/mode", "twin/tsd/alive", "twin/tsd/cmd/alice/twist/more", "twin/tsd"]
    before = drops(alice)
    with robot.raw_client() as client:
        command = client.declare_publisher(topics.twist_key("tsd", "alice"))
        poll_until(lambda: command.matching_status.matching)
        for key in keys:
            for payload in GARBAGE:
                client.put(key, payload, attachment=payload[:32])
            client.delete(key)
        # Three deletions and two patterns; samples on valid keys have an invalid shape.
        expected = before | {
            "key": before["key"] + 3 + 2 * len(GARBAGE),
            "shape": before["shape"] + len(GARBAGE),
        }
        alice.wait_until(lambda: drops(alice) == expected)
        alice.wait_for_news()
    assert drops(alice) == expected
    assert alice.status.mode == "disarmed"
    assert alice.ask(Service.DESC)["urdf"] == URDF


def test_what_happened_before_is_told_to_those_who_come_later(robot: RunningNode) -> None:
    with BusOperator(robot, "bob") as bob:
        assert bob.acquire()["granted"]
        bob.ask(Service.RESET, lease=bob.lease)
        bob.wait_until(lambda: any("not stopped" in text for text in bob.texts))
        bob.ask(Service.LEASE, op="release", operator="bob", lease=bob.lease)
    with BusOperator(robot, "carol") as carol:
        carol.wait_until(lambda: "bob released control." in carol.texts)
        carol.wait_until(lambda: any("not stopped" in text for text in carol.texts))
        fields: Any = Event.__struct_fields__
        assert all(set(event) == set(fields) for event in carol.events)
