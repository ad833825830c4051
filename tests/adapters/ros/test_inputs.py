"""Poses from ROS."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from tsd_twin.adapters.ros.port import decode_pose_input
from tsd_twin.messages.errors import MessageError

STORE = get_typestore(Stores.ROS2_JAZZY)
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"


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
