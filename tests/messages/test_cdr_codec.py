"""CDR of the four messages on the bus, with rosbags as an independent reader and writer."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from rosbags.serde import SerdeError
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
from tsd_twin.messages.cdr_codec import CdrReader, CdrWriter
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.pose import PoseStamped, decode_pose, encode_pose

STORE = get_typestore(Stores.ROS2_JAZZY)
HUMBLE = get_typestore(Stores.ROS2_HUMBLE)
"""Definitions of another ROS release than the one used in the code."""
TWIST = "geometry_msgs/msg/TwistStamped"
JOINTS = "sensor_msgs/msg/JointState"
ODOMETRY = "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseStamped"

stamps = st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1)
names = st.text(st.characters(exclude_categories=("Cs",)), max_size=20)
numbers = st.floats()
"""Includes NaN, infinities and denormals, which are decoded but not obeyed."""
finite = st.floats(allow_nan=False, allow_infinity=False)


def vectors(size: int, of: st.SearchStrategy[float] = numbers) -> st.SearchStrategy[Array]:
    return st.lists(of, min_size=size, max_size=size).map(np.array)


twists = st.builds(TwistStamped, names, vectors(6), stamps)
poses = st.builds(PoseStamped, names, vectors(3), vectors(4), stamps)
joints = st.integers(0, 12).flatmap(
    lambda n: st.builds(
        JointState, st.lists(names, min_size=n, max_size=n), vectors(n), vectors(n), stamps
    )
)
squares = vectors(9).map(lambda values: values.reshape(3, 3))
odometry = st.builds(Odometry, vectors(3, finite), vectors(3), squares, squares, stamps)
messages: st.SearchStrategy[tuple[str, Any, bytes]] = st.one_of(
    twists.map(lambda message: (TWIST, message, encode_twist(message))),
    joints.map(lambda message: (JOINTS, message, encode_joints(message))),
    odometry.map(lambda message: (ODOMETRY, message, encode_odometry(message))),
    poses.map(lambda message: (POSE, message, encode_pose(message))),
)


DECODERS: dict[str, tuple[Callable[[bytes], Any], Callable[[Any], list[Any]]]] = {
    TWIST: (decode_twist, lambda raw: [_vector(raw.twist.linear), _vector(raw.twist.angular)]),
    JOINTS: (decode_joints, lambda raw: [raw.position, raw.velocity]),
    ODOMETRY: (
        decode_odometry,
        lambda raw: [
            raw.pose.covariance.reshape(6, 6)[np.ix_((0, 1, 5), (0, 1, 5))],
            [raw.twist.twist.linear.x, raw.twist.twist.linear.y, raw.twist.twist.angular.z],
            raw.twist.covariance.reshape(6, 6)[np.ix_((0, 1, 5), (0, 1, 5))],
        ],
    ),
    POSE: (
        decode_pose,
        lambda raw: [_vector(raw.pose.position), [raw.pose.orientation.w], _turn(raw)],
    ),
}
"""Decoder of each type, and the numbers that rosbags finds in a message, in the same order."""


def _vector(raw: Any) -> list[float]:
    return [raw.x, raw.y, raw.z]


def _turn(raw: Any) -> list[float]:
    return _vector(raw.pose.orientation)


def decoded_numbers(message: Any) -> list[Any]:
    match message:
        case TwistStamped():
            return [message.twist]
        case JointState():
            return [message.position_rad, message.velocity_rad_per_s]
        case Odometry():
            return [message.pose_covariance, message.twist, message.twist_covariance]
        case _:
            return [message.position_m, message.wxyz]


def flat(parts: list[Any]) -> Array:
    return np.concatenate([np.ravel(part) for part in parts])


@given(message=messages)
def test_rosbags_reads_the_same_values_and_writes_the_same_bytes(
    message: tuple[str, Any, bytes],
) -> None:
    type_name, written, payload = message
    read: Any = STORE.deserialize_cdr(payload, type_name)
    assert bytes(STORE.serialize_cdr(read, type_name)) == payload
    stamp = read.header.stamp
    assert stamp.sec * 10**9 + stamp.nanosec == written.stamp_ns
    if type_name == JOINTS:
        assert (read.header.frame_id, read.name) == ("base_link", list(written.names))
    if type_name in (TWIST, POSE):
        assert read.header.frame_id == written.frame
    _, found = DECODERS[type_name]
    np.testing.assert_array_equal(flat(found(read)), flat(decoded_numbers(written)))


@st.composite
def damaged(draw: st.DrawFn) -> tuple[str, bytes]:
    """Payloads of either byte order, intact, truncated, extended or with wrong bytes, and noise."""
    if draw(st.integers(0, 9)) == 0:
        return draw(st.sampled_from(list(DECODERS))), draw(st.binary(max_size=200))
    type_name, _, payload = draw(messages)
    if draw(st.booleans()):
        read = STORE.deserialize_cdr(payload, type_name)
        payload = bytes(STORE.serialize_cdr(read, type_name, little_endian=False))
    changed = bytearray(payload)
    for _ in range(draw(st.integers(0, 3))):
        changed[draw(st.integers(0, min(60, len(changed) - 1)))] = draw(st.integers(0, 255))
    read_as = draw(st.just(type_name) | st.sampled_from(list(DECODERS)))
    return read_as, bytes(changed[: draw(st.integers(0, 900))]) + draw(st.binary(max_size=9))


@given(message=damaged())
@example((TWIST, b""))
@example((TWIST, b"\x00\x01\x00\x00" + b"\xff" * 64))
@example((TWIST, struct.pack(">IiII5s7x6d", 0, 7, 8, 5, b"odom", *range(6))))
@example((JOINTS, encode_joints(JointState(["a", "b"], np.zeros(1), np.zeros(2)))))
@example((JOINTS, b"\x00\x01\x00\x00" + bytes(12) + b"\xff" * 20))
@example((TWIST, b"\x00\x01\x00\x00" + bytes(8) + struct.pack("<I", 1) + b"a" + bytes(64)))
def test_the_same_payloads_are_accepted_with_the_same_values(message: tuple[str, bytes]) -> None:
    type_name, payload = message
    decode, found = DECODERS[type_name]
    try:
        expected: Any = STORE.deserialize_cdr(payload, type_name)
    except SerdeError:
        with pytest.raises(MessageError, match="shape"):
            decode(payload)
        return
    stamp = expected.header.stamp
    if type_name == JOINTS and not (
        len(expected.name) == len(expected.position) == len(expected.velocity)
    ):
        with pytest.raises(MessageError, match="differ in number"):
            decode(payload)
        return
    read = decode(payload)
    assert read.stamp_ns == stamp.sec * 10**9 + stamp.nanosec
    if type_name == JOINTS:
        assert list(read.names) == expected.name
    if type_name in (TWIST, POSE):
        assert read.frame == expected.header.frame_id
    np.testing.assert_array_equal(flat(decoded_numbers(read)), flat(found(expected)))


def test_decoded_numbers_are_native_and_writable() -> None:
    """Arrays in the control loop have native byte order, also from a big-endian payload."""
    body = struct.pack(">iII5s7x6d", 7, 8, 5, b"odom", *range(6))
    twist = decode_twist(b"\x00\x00\x00\x00" + body).twist
    assert twist.dtype == np.dtype(float)
    assert twist.dtype.isnative
    assert twist.flags.writeable


def test_a_time_beyond_32_bits_is_not_written() -> None:
    with pytest.raises(struct.error):
        CdrWriter().header(2**31 * 10**9, "odom")


def test_three_bytes_of_padding_are_accepted() -> None:
    payload = encode_twist(TwistStamped("odom", np.zeros(6)))
    assert decode_twist(payload + bytes(3)).frame == "odom"
    with pytest.raises(MessageError, match="more bytes"):
        decode_twist(payload + bytes(4))


def test_an_error_names_the_type() -> None:
    with pytest.raises(MessageError, match=f"not a {TWIST}: no CDR header"):
        CdrReader(b"\x01\x00\x00\x00", TWIST)


@given(
    xy=vectors(2, finite),
    heading=st.floats(-3.14, 3.14) | st.sampled_from([0.0, 1e-9, -1e-300, math.pi]),
    twist=vectors(3, finite),
    pose_covariance=vectors(9, finite),
    twist_covariance=vectors(9, finite),
    stamp_ns=stamps,
)
def test_odometry_is_read_by_another_reader_with_the_frames_and_axes_of_ros(
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
    read: Any = HUMBLE.deserialize_cdr(payload, "nav_msgs/msg/Odometry")
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


def test_a_huge_payload_is_refused_unread() -> None:
    with pytest.raises(MessageError, match="too many"):
        decode_twist(encode_twist(TwistStamped("base_link", np.zeros(6))) + bytes(5000))
