"""CDR payloads against the definitions of ROS 2: packed by hand, and by another reader."""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from tsd_twin.lie import Array
from tsd_twin.messages.cdr import (
    JointState,
    Odometry,
    TwistStamped,
    decode_joints,
    decode_odometry,
    decode_twist,
    encode_joints,
    encode_odometry,
    encode_twist,
)
from tsd_twin.messages.errors import MessageError

anything = st.floats()
"""Includes NaN, infinities and denormals, which are decoded but not obeyed."""
numbers = st.floats(allow_nan=False, allow_infinity=False)
stamps = st.integers(0, 2**31 * 10**9 - 1)
"""Nanoseconds whose seconds fit into the 32 bits of a ROS time."""
names = st.text(st.characters(exclude_characters="\0", exclude_categories=("Cs",)), max_size=30)


def vectors(size: int, of: st.SearchStrategy[float] = anything) -> st.SearchStrategy[Array]:
    return st.lists(of, min_size=size, max_size=size).map(np.array)


@pytest.fixture(scope="module")
def humble() -> Any:
    """Message definitions of another ROS release than the one used in the code."""
    return get_typestore(Stores.ROS2_HUMBLE)


def string(text: str) -> bytes:
    raw = text.encode() + b"\0"
    return struct.pack("<I", len(raw)) + raw


def aligned(parts: list[bytes], size: int) -> None:
    """CDR aligns numbers to their size, counted from the end of the 4-byte header."""
    parts.append(b"\0" * (-(sum(map(len, parts)) - 4) % size))


def packed(format_: str, values: Array) -> bytes:
    return struct.pack(f"<{len(values)}{format_}", *values)


def header(stamp_ns: int, frame: str) -> list[bytes]:
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    return [b"\x00\x01\x00\x00", struct.pack("<iI", seconds, nanoseconds), string(frame)]


@given(twist=vectors(6), stamp_ns=stamps, frame=names)
def test_a_twist_is_laid_out_as_its_definition_says(
    twist: Array, stamp_ns: int, frame: str
) -> None:
    parts = header(stamp_ns, frame)
    aligned(parts, 8)
    parts.append(packed("d", twist))
    payload = encode_twist(TwistStamped(frame, twist, stamp_ns))
    assert payload == b"".join(parts)
    read = decode_twist(payload)
    assert (read.frame, read.stamp_ns) == (frame, stamp_ns)
    np.testing.assert_array_equal(read.twist, twist)


@given(n=st.integers(0, 12), stamp_ns=stamps, data=st.data())
def test_joints_are_laid_out_as_their_definition_says(
    n: int, stamp_ns: int, data: st.DataObject
) -> None:
    joints = tuple(data.draw(st.lists(names, min_size=n, max_size=n)))
    position, velocity = data.draw(vectors(n)), data.draw(vectors(n))
    parts = [*header(stamp_ns, "base_link")]
    aligned(parts, 4)
    parts.append(struct.pack("<I", n))
    for name in joints:
        aligned(parts, 4)
        parts.append(string(name))
    for numbers_ in (position, velocity, np.empty(0)):
        aligned(parts, 4)
        parts.append(struct.pack("<I", len(numbers_)))
        if len(numbers_):
            aligned(parts, 8)
        parts.append(packed("d", numbers_))
    payload = encode_joints(JointState(joints, position, velocity, stamp_ns))
    assert payload == b"".join(parts)
    read = decode_joints(payload)
    assert (tuple(read.names), read.stamp_ns) == (joints, stamp_ns)
    np.testing.assert_array_equal(read.position_rad, position)
    np.testing.assert_array_equal(read.velocity_rad_per_s, velocity)


@given(
    xy=vectors(2, numbers),
    heading=st.floats(-3.14, 3.14) | st.sampled_from([0.0, 1e-9, -1e-300, math.pi]),
    twist=vectors(3, numbers),
    pose_covariance=vectors(9, numbers),
    twist_covariance=vectors(9, numbers),
    stamp_ns=stamps,
)
def test_odometry_is_read_by_another_reader_with_the_frames_and_axes_of_ros(
    humble: Any,
    xy: Array,
    heading: float,
    twist: Array,
    pose_covariance: Array,
    twist_covariance: Array,
    stamp_ns: int,
) -> None:
    message = Odometry(
        np.array([*xy, heading]),
        twist,
        pose_covariance.reshape(3, 3),
        twist_covariance.reshape(3, 3),
        stamp_ns,
    )
    payload = encode_odometry(message)
    read = humble.deserialize_cdr(payload, "nav_msgs/msg/Odometry")
    assert (read.header.frame_id, read.child_frame_id) == ("odom", "base_link")
    assert read.header.stamp.sec * 10**9 + read.header.stamp.nanosec == stamp_ns
    position, turn = read.pose.pose.position, read.pose.pose.orientation
    assert [position.x, position.y, position.z] == [*xy, 0.0]
    # REP-103 heading from a quaternion: a turn about Z, counter-clockwise from above.
    np.testing.assert_allclose(
        [1 - 2 * turn.z**2, 2 * turn.w * turn.z, turn.x, turn.y],
        [np.cos(heading), np.sin(heading), 0, 0],
        atol=1e-15,
    )
    linear, angular = read.twist.twist.linear, read.twist.twist.angular
    np.testing.assert_array_equal(
        [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z],
        [twist[0], twist[1], 0, 0, 0, twist[2]],
    )
    # Row-major 6 x 6 over x, y, z, and turns about X, Y, Z: ours are rows 0, 1 and 5.
    pose_rows = np.reshape(read.pose.covariance, (6, 6))
    np.testing.assert_array_equal(pose_rows[np.ix_([0, 1, 5], [0, 1, 5])].ravel(), pose_covariance)
    assert not pose_rows[2:5].any()
    assert not pose_rows[:, 2:5].any()
    twist_rows = np.reshape(read.twist.covariance, (6, 6))
    np.testing.assert_array_equal(
        twist_rows[np.ix_([0, 1, 5], [0, 1, 5])].ravel(), twist_covariance
    )
    back = decode_odometry(payload)
    np.testing.assert_allclose(back.xy_heading, message.xy_heading, rtol=0, atol=2e-15 * 6.3)
    np.testing.assert_array_equal(back.twist, twist)
    np.testing.assert_array_equal(back.pose_covariance, message.pose_covariance)
    np.testing.assert_array_equal(back.twist_covariance, message.twist_covariance)
    assert back.stamp_ns == stamp_ns


@given(turns=st.floats(-50.0, 50.0))
def test_a_heading_survives_up_to_whole_turns(turns: float) -> None:
    heading = 2 * np.pi * turns
    zero = np.zeros((3, 3))
    message = Odometry(np.array([0.0, 0.0, heading]), np.zeros(3), zero, zero)
    read = decode_odometry(encode_odometry(message)).xy_heading[2]
    assert -math.pi < read <= math.pi
    np.testing.assert_allclose(np.exp(1j * read), np.exp(1j * heading), atol=1e-12)


@given(linear=vectors(3), angular=vectors(3), frame=names)
def test_a_twist_of_another_writer_is_read(
    humble: Any, linear: Array, angular: Array, frame: str
) -> None:
    make = humble.types
    vector = make["geometry_msgs/msg/Vector3"]
    message = make["geometry_msgs/msg/TwistStamped"](
        header=make["std_msgs/msg/Header"](
            stamp=make["builtin_interfaces/msg/Time"](sec=7, nanosec=8), frame_id=frame
        ),
        twist=make["geometry_msgs/msg/Twist"](linear=vector(*linear), angular=vector(*angular)),
    )
    read = decode_twist(bytes(humble.serialize_cdr(message, message.__msgtype__)))
    assert (read.frame, read.stamp_ns) == (frame, 7_000_000_008)
    np.testing.assert_array_equal(read.twist, [*linear, *angular])


def test_a_twist_of_a_big_endian_writer_is_read() -> None:
    body = struct.pack(">iII5s7x6d", 7, 8, 5, b"odom", *range(6))
    read = decode_twist(b"\x00\x00\x00\x00" + body)
    assert (read.frame, read.stamp_ns) == ("odom", 7_000_000_008)
    np.testing.assert_array_equal(read.twist, range(6))


VALID = (
    encode_twist(TwistStamped("base_link", np.arange(6.0))),
    encode_joints(JointState(["module1_alpha", "b"], np.ones(2), np.ones(2))),
    encode_odometry(Odometry(np.ones(3), np.ones(3), np.eye(3), np.eye(3))),
)


@st.composite
def payloads(draw: st.DrawFn) -> bytes:
    """Noise, and truncated, extended or damaged messages."""
    payload = bytearray(draw(st.binary(max_size=200) | st.sampled_from(VALID)))
    for _ in range(draw(st.integers(0, 4))):
        if payload:
            payload[draw(st.integers(0, len(payload) - 1))] = draw(st.integers(0, 255))
    return bytes(payload[: draw(st.integers(0, 800))]) + draw(st.binary(max_size=9))


@given(payload=payloads())
@example(b"")
@example(b"\x00\x01\x00\x00" + b"\xff" * 64)
@example(b"\x00\x00\x00\x00" * 2000)
def test_a_payload_that_is_no_message_is_only_ever_a_shape_error(payload: bytes) -> None:
    for decode in (decode_twist, decode_joints, decode_odometry):
        try:
            decode(payload)
        except MessageError as error:
            assert error.reason == "shape"  # noqa: PT017  Most payloads raise, some are messages.


@given(cut=st.integers(0, 10_000), which=st.integers(0, 2))
def test_a_message_that_is_cut_off_is_refused(cut: int, which: int) -> None:
    decode = (decode_twist, decode_joints, decode_odometry)[which]
    with pytest.raises(MessageError, match="shape"):
        decode(VALID[which][: cut % len(VALID[which])])


def test_a_huge_payload_is_refused_unread() -> None:
    with pytest.raises(MessageError, match="too many"):
        decode_twist(VALID[0] + bytes(5000))


def test_joints_with_fewer_numbers_than_names_are_refused() -> None:
    with pytest.raises(MessageError, match="differ in number"):
        decode_joints(encode_joints(JointState(["a", "b"], np.zeros(1), np.zeros(2))))
