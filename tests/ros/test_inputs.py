"""Age of messages from ROS, turns of publishers, and poses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from tsd_twin.errors import MessageError
from tsd_twin.interop.cmd_vel import PAUSE_S
from tsd_twin.ros.port import (
    DRIFT,
    MOST_PUBLISHERS,
    Arrivals,
    OnePublisher,
    Origin,
    decode_pose_input,
)

STORE = get_typestore(Stores.ROS2_JAZZY)
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
A, B = b"a" * 16, b"b" * 16
CLOCK_S = 1.7e9
"""Clock of the publisher when ours shows zero."""


def origin(sequence: int, sent_s: float, publisher: bytes = A) -> Origin:
    return Origin(publisher, sequence, round((CLOCK_S + sent_s) * 1e9))


@given(st.lists(st.floats(0.0, 0.05), min_size=1, max_size=40), st.floats(0.3, 3.0))
def test_a_stall_is_seen_without_common_clocks(delays_s: list[float], stall_s: float) -> None:
    arrivals, arrived_s = Arrivals(), 0.0
    for i, delay_s in enumerate(delays_s):
        arrived_s = 0.1 * i + delay_s
        known = arrivals.sent_after_s(origin(i, 0.1 * i), arrived_s)
        assert known is not None
        assert -1e-6 < arrived_s - known < 0.05 + DRIFT * 4.0 + 1e-6
    sent_s = 0.1 * len(delays_s)
    late = arrivals.sent_after_s(origin(99, sent_s), sent_s + stall_s)
    assert late is not None
    age_s = sent_s + stall_s - late
    fastest_s = min(delays_s)
    assert stall_s - fastest_s - DRIFT * (sent_s + stall_s) - 1e-6 < age_s <= stall_s + 1e-6


def test_what_waited_through_a_stall_is_old_each_by_its_own_time() -> None:
    arrivals = Arrivals()
    arrivals.sent_after_s(origin(0, 0.0), 0.01)
    for i in range(1, 30):
        sent_s = 0.1 * i
        known = arrivals.sent_after_s(origin(i, sent_s), 3.0)
        assert known is not None
        assert known == pytest.approx(sent_s + 0.01, abs=4e-3)


def test_a_message_that_comes_twice_or_late_is_dropped() -> None:
    arrivals = Arrivals()
    assert arrivals.sent_after_s(origin(5, 0.0), 0.0) is not None
    assert arrivals.sent_after_s(origin(5, 0.0), 0.1) is None
    assert arrivals.sent_after_s(origin(4, -0.1), 0.2) is None
    assert arrivals.sent_after_s(origin(6, 0.2), 0.3) is not None
    assert arrivals.sent_after_s(origin(1, 0.2, B), 0.3) is not None, "another publisher"


def test_clocks_of_many_publishers_are_not_kept_for_ever() -> None:
    arrivals = Arrivals()
    for i in range(1000):
        arrivals.sent_after_s(origin(1, 0.0, i.to_bytes(16, "big")), 0.0)
    assert len(arrivals._clocks) == MOST_PUBLISHERS


def test_one_publisher_drives_and_another_has_to_wait_and_to_pause() -> None:
    turn = OnePublisher()
    assert turn.admits(A, True, 0.0)
    assert not turn.admits(B, True, 0.1)
    assert not turn.admits(B, False, 0.15), "its zeros do not stop the other"
    assert turn.admits(A, True, 0.2)
    now_s = 0.2
    while now_s < 0.2 + 3.0 * PAUSE_S:
        now_s += 0.1
        assert not turn.admits(B, True, now_s), "a stick that is held on"
    now_s += PAUSE_S + 0.01
    assert turn.admits(B, True, now_s)
    assert not turn.admits(A, True, now_s + 0.1)


def test_zeros_do_not_keep_the_turn() -> None:
    turn = OnePublisher()
    assert turn.admits(A, True, 0.0)
    for i in range(10):
        assert turn.admits(A, False, 0.1 * i)
    assert turn.admits(B, True, 1.0)


def pose(
    x: float, turn: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0), frame: str = "odom"
) -> bytes:
    types = STORE.types
    w, qx, qy, qz = turn
    message = types[POSE](
        header=types["std_msgs/msg/Header"](
            stamp=types["builtin_interfaces/msg/Time"](sec=7, nanosec=8), frame_id=frame
        ),
        pose=types["geometry_msgs/msg/PoseWithCovariance"](
            pose=types["geometry_msgs/msg/Pose"](
                position=types["geometry_msgs/msg/Point"](x=x, y=2.0, z=0.0),
                orientation=types["geometry_msgs/msg/Quaternion"](x=qx, y=qy, z=qz, w=w),
            ),
            covariance=np.zeros(36),
        ),
    )
    return bytes(STORE.serialize_cdr(message, POSE))


def test_a_pose_keeps_numbers_and_stamp() -> None:
    half = math.sqrt(0.5)
    read = decode_pose_input(pose(1.5, (half, 0.0, 0.0, half), "left/odom"), POSE, "left/odom")
    assert read.position_m.tolist() == [1.5, 2.0, 0.0]
    assert read.wxyz.tolist() == [half, 0.0, 0.0, half]
    assert read.stamp_ns == 7_000_000_008
    assert read.frame == "odom"


@pytest.mark.parametrize(
    "payload",
    [
        pose(math.nan),
        pose(math.inf),
        pose(0.0, (0.0, 0.0, 0.0, 0.0)),
        pose(0.0, (math.nan, 0.0, 0.0, 0.0)),
        pose(0.0, frame="map"),
        pose(0.0)[:40],
        b"",
        bytes(2**20),
    ],
)
def test_what_is_no_pose_is_refused(payload: bytes) -> None:
    with pytest.raises(MessageError):
        decode_pose_input(payload, POSE, "odom")
