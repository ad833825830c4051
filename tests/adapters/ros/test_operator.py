"""Messages from ROS wait in bounded per-topic queues."""

from __future__ import annotations

from tsd_twin.adapters.ros.arrivals import Origin
from tsd_twin.adapters.ros.operator import MAX_QUEUED_MESSAGES, MOST_POSES, QUEUE_SIZES
from tsd_twin.adapters.ros.port import Inbox, Received
from tsd_twin.adapters.ros_topics import CMD_VEL, INITIAL_POSE, MEASURED_POSE, READ, RosTopic


def received(row: RosTopic, number: int) -> Received:
    return Received(row, row.type, b"", Origin(b"a" * 16, number, 0), 0.0)


def test_a_flood_of_poses_neither_replaces_nor_delays_twists() -> None:
    inbox = Inbox(QUEUE_SIZES)
    inbox.put(received(CMD_VEL, 1))
    for number in range(10_000):
        inbox.put(received(MEASURED_POSE, number))
    inbox.put(received(CMD_VEL, 2))
    inbox.put(received(INITIAL_POSE, 3))
    taken = inbox.take(READ)
    assert [each.origin.sequence for each in taken if each.row is CMD_VEL] == [1, 2]
    assert [each.row for each in taken[:2]] == [CMD_VEL, CMD_VEL]
    assert received(INITIAL_POSE, 3) in taken
    assert len(taken) == 3 + MOST_POSES
    assert not inbox.take(READ)


def test_of_each_topic_the_newest_messages_wait() -> None:
    inbox = Inbox(QUEUE_SIZES)
    for row in READ:
        for number in range(200):
            inbox.put(received(row, number))
    taken = inbox.take(READ)
    assert len(taken) == MAX_QUEUED_MESSAGES + (len(READ) - 1) * MOST_POSES
    assert (
        min(each.origin.sequence for each in taken if each.row is CMD_VEL)
        == 200 - MAX_QUEUED_MESSAGES
    )
