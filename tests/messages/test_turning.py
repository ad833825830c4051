"""Odometry of a sphere turning in place, with ROS orientations and angular velocities."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from tests.support.matrices import so3_matrix
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages.cdr import Odometry, decode_odometry, encode_odometry

numbers = st.floats(-3.0, 3.0)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)


@given(turn=vectors, twist=vectors, seed=st.integers(0, 2**16))
def test_it_is_read_by_another_reader_and_by_ours(turn: Array, twist: Array, seed: int) -> None:
    pose = SO3.exp(turn)
    pose_covariance, twist_covariance = np.random.default_rng(seed).normal(size=(2, 3, 3))
    message = Odometry.of(pose, twist, pose_covariance, twist_covariance, 7)
    payload = encode_odometry(message)
    humble = get_typestore(Stores.ROS2_HUMBLE)
    read = humble.deserialize_cdr(payload, "nav_msgs/msg/Odometry")
    q, p = read.pose.pose.orientation, read.pose.pose.position
    assert (p.x, p.y, p.z) == (0.0, 0.0, 0.0)
    theirs = SO3(np.array([q.w, q.x, q.y, q.z]))
    np.testing.assert_allclose(so3_matrix(theirs), so3_matrix(pose), atol=1e-14)
    linear, angular = read.twist.twist.linear, read.twist.twist.angular
    assert (linear.x, linear.y, linear.z) == (0.0, 0.0, 0.0)
    np.testing.assert_array_equal([angular.x, angular.y, angular.z], twist)
    for covariance, block in (
        (read.pose.covariance, pose_covariance),
        (read.twist.covariance, twist_covariance),
    ):
        np.testing.assert_array_equal(np.reshape(covariance, (6, 6))[3:, 3:], block)
        assert np.count_nonzero(np.reshape(covariance, (6, 6))[:3]) == 0
    back = decode_odometry(payload, turning=True)
    np.testing.assert_array_equal(back.wxyz, pose.wxyz)
    np.testing.assert_array_equal(back.twist, twist)
    np.testing.assert_array_equal(back.pose_covariance, pose_covariance)
    np.testing.assert_array_equal(back.twist_covariance, twist_covariance)
    assert back.stamp_ns == 7


def test_a_pose_on_the_floor_stays_one() -> None:
    eye = np.eye(3)
    message = Odometry.of(SE2(np.array([1.0, 2.0, 0.5])), np.arange(3.0), eye, eye)
    assert message.wxyz is None
    back = decode_odometry(encode_odometry(message))
    np.testing.assert_allclose(back.xy_heading, [1.0, 2.0, 0.5], rtol=1e-12)
    assert back.wxyz is None
