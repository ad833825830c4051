"""CDR of the four messages on the bus, with rosbags as the oracle."""

from __future__ import annotations

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
TWIST = "geometry_msgs/msg/TwistStamped"
JOINTS = "sensor_msgs/msg/JointState"
ODOMETRY = "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseStamped"

stamps = st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1)
names = st.text(st.characters(exclude_categories=("Cs",)), max_size=20)
numbers = st.floats()


def vectors(size: int) -> st.SearchStrategy[Array]:
    return st.lists(numbers, min_size=size, max_size=size).map(np.array)


twists = st.builds(TwistStamped, names, vectors(6), stamps)
poses = st.builds(PoseStamped, names, vectors(3), vectors(4), stamps)
joints = st.integers(0, 9).flatmap(
    lambda n: st.builds(
        JointState, st.lists(names, min_size=n, max_size=n), vectors(n), vectors(n), stamps
    )
)
squares = vectors(9).map(lambda values: values.reshape(3, 3))
finite = st.floats(allow_nan=False, allow_infinity=False)
xy_headings = st.lists(finite, min_size=3, max_size=3).map(np.array)
odometry = st.builds(Odometry, xy_headings, vectors(3), squares, squares, stamps)
messages: st.SearchStrategy[tuple[str, bytes]] = st.one_of(
    twists.map(lambda message: (TWIST, encode_twist(message))),
    joints.map(lambda message: (JOINTS, encode_joints(message))),
    odometry.map(lambda message: (ODOMETRY, encode_odometry(message))),
    poses.map(lambda message: (POSE, encode_pose(message))),
)


@given(message=messages)
def test_rosbags_reads_and_writes_the_same_bytes(message: tuple[str, bytes]) -> None:
    type_name, payload = message
    read = STORE.deserialize_cdr(payload, type_name)
    assert bytes(STORE.serialize_cdr(read, type_name)) == payload


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


@st.composite
def damaged(draw: st.DrawFn) -> tuple[str, bytes]:
    """Payloads of either byte order, intact, truncated, extended or with wrong bytes."""
    type_name, payload = draw(messages)
    if draw(st.booleans()):
        read = STORE.deserialize_cdr(payload, type_name)
        payload = bytes(STORE.serialize_cdr(read, type_name, little_endian=False))
    changed = bytearray(payload)
    for _ in range(draw(st.integers(0, 3))):
        changed[draw(st.integers(0, min(60, len(changed) - 1)))] = draw(st.integers(0, 255))
    return type_name, bytes(changed[: draw(st.integers(0, 900))]) + draw(st.binary(max_size=6))


@given(message=damaged())
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
