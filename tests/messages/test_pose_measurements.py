"""External ROS poses: planar ones are accepted, and others are refused with a code."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from tsd_twin.lie import SE2
from tsd_twin.messages.cdr import BASE, ODOM
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.pose import PoseStamped, decode_pose_measurement, encode_pose
from tsd_twin.messages.topics import Sample

KEY = "twin/tsd/sensor/pose"
places = st.floats(-1e3, 1e3)
angles = st.floats(-math.pi, math.pi)
leans = st.floats(-0.3, 0.3)
wild = st.floats(allow_nan=True, allow_infinity=True)


def read(message: PoseStamped, key: str = KEY) -> tuple[SE2, int]:
    return decode_pose_measurement(Sample(key, encode_pose(message), b""))


def refused(sample: Sample) -> str:
    with pytest.raises(MessageError) as caught:
        decode_pose_measurement(sample)
    return caught.value.reason


@given(x=places, y=places, z=places, heading=angles, lean=st.tuples(leans, leans))
def test_height_and_lean_are_left_out_and_the_heading_is_that_of_the_robots_front(
    x: float, y: float, z: float, heading: float, lean: tuple[float, float]
) -> None:
    turn = Rotation.from_euler("ZYX", [heading, *lean])
    wxyz = np.roll(turn.as_quat(), 1)
    pose, stamp_ns = read(PoseStamped(ODOM, np.array([x, y, z]), wxyz, 12_345_678_901))
    assert pose.xy_heading[:2].tolist() == [x, y]
    front = turn.apply([1.0, 0.0, 0.0])
    expected = math.atan2(front[1], front[0])
    assert math.remainder(pose.xy_heading[2] - expected, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert stamp_ns == 12_345_678_901


def test_any_writer_of_ros_messages_is_understood() -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    payload = encode_pose(PoseStamped.planar(SE2(np.array([1.0, -2.0, 0.5])), 3_000_000_007))
    raw: Any = store.deserialize_cdr(payload, "geometry_msgs/msg/PoseStamped")
    assert (raw.header.frame_id, raw.header.stamp.sec, raw.header.stamp.nanosec) == ("odom", 3, 7)
    again = bytes(store.serialize_cdr(raw, "geometry_msgs/msg/PoseStamped"))
    pose, _ = decode_pose_measurement(Sample(KEY, again, b""))
    np.testing.assert_allclose(pose.xy_heading, [1.0, -2.0, 0.5], atol=1e-12)


@given(place=st.lists(wild, min_size=3, max_size=3), turn=st.lists(wild, min_size=4, max_size=4))
def test_whatever_the_numbers_are_it_is_a_pose_or_has_one_reason(
    place: list[float], turn: list[float]
) -> None:
    sample = Sample(KEY, encode_pose(PoseStamped(ODOM, np.array(place), np.array(turn), 1)), b"")
    if not np.isfinite([*place, *turn]).all():
        assert refused(sample) == "nonfinite"
    elif abs(math.hypot(*turn) - 1.0) > 1e-3:
        assert refused(sample) == "quaternion"


@given(payload=st.binary(max_size=300))
def test_what_is_no_pose_is_a_shape_error_or_has_another_reason(payload: bytes) -> None:
    assert refused(Sample(KEY, payload, b"")) in {"shape", "frame", "nonfinite", "quaternion"}


@pytest.mark.parametrize(
    ("frame", "wxyz", "key", "is_put", "reason"),
    [
        (BASE, [1, 0, 0, 0], KEY, True, "frame"),
        ("", [1, 0, 0, 0], KEY, True, "frame"),
        (ODOM, [0, 0, 0, 0], KEY, True, "quaternion"),
        (ODOM, [0, 1, 0, 0], KEY, True, "quaternion"),
        (ODOM, [math.cos(0.3), math.sin(0.3), 0, 0], KEY, True, "quaternion"),
        (ODOM, [1, 0, 0, 0], "twin/*/sensor/pose", True, "key"),
        (ODOM, [1, 0, 0, 0], KEY, False, "key"),
    ],
)
def test_what_is_not_meant_has_a_reason(
    frame: str, wxyz: list[float], key: str, is_put: bool, reason: str
) -> None:
    payload = encode_pose(PoseStamped(frame, np.zeros(3), np.array(wxyz, dtype=float), 1))
    assert refused(Sample(key, payload, b"", is_put)) == reason


def test_it_fits_where_messages_to_a_robot_have_to() -> None:
    assert len(encode_pose(PoseStamped.planar(SE2.identity(), 0))) < 200
