"""An overhead camera on the bus corrects the errors of wheel odometry while in view."""

from __future__ import annotations

import math
import time

import numpy as np

from tests.support.bus_operator import BusOperator
from tests.support.robot_node import QUICK, matched, running
from tsd_mock import OverheadCamera
from tsd_twin import robots
from tsd_twin.lie import SE2
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import ODOM, decode_odometry
from tsd_twin.messages.pose import PoseStamped, encode_pose
from tsd_twin.messages.status import PoseSensorStatus
from tsd_twin.simulation import SimRobot


def pose_sensor(pilot: BusOperator) -> PoseSensorStatus:
    return pilot.status.pose_sensor or PoseSensorStatus()


def apart(pilot: BusOperator, what: str) -> float:
    """Distance of a published pose from the truth, m."""
    told, true = (decode_odometry(each.payload) for each in pilot.together(what, "truth"))
    return math.dist(told.xy_heading[:2], true.xy_heading[:2])


def test_with_a_camera_a_mock_with_wrong_wheels_knows_where_it_is() -> None:
    io = SimRobot(robots.parse_description(QUICK, "tsd"), seed=3, noise=10.0)
    with running(io=io) as node, BusOperator(node) as alice:
        alice.get_ready()
        alice.drive((0.5, 0.0, 0.4), until=lambda: apart(alice, "odom") > 0.1)
        alice.drive((0.0, 0.0, 0.0), until=lambda: alice.status.mode == "ready")
        assert pose_sensor(alice).used == 0
        with node.client() as cameras_computer, OverheadCamera(cameras_computer, node.id, seed=1):
            alice.drive((0.0, 0.0, 0.0), until=lambda: apart(alice, "odom") < 0.04)
            alice.drive((0.5, 0.0, 0.4), until=lambda: apart(alice, "odom_alternative") > 0.2)
            alice.drive((0.0, 0.0, 0.0), until=lambda: alice.status.mode == "ready")
            alice.drive((0.0, 0.0, 0.0), until=lambda: apart(alice, "odom") < 0.04)
            assert apart(alice, "odom_alternative") > 0.1
            assert pose_sensor(alice).used > 3


def test_what_others_forge_is_counted_and_changes_nothing() -> None:
    with running() as node, BusOperator(node) as alice, node.client() as stranger:
        topic = topics.SENSOR_POSE
        forger = matched(stranger.publisher(topic.key(node.id), topic.qos, topic.type))

        def forge(x_m: float, off_s: float = 0.0, frame: str = ODOM) -> None:
            stamp_ns = time.time_ns() + round(off_s * 1e9)
            message = PoseStamped.planar(SE2(np.array([x_m, 0.0, 0.0])), stamp_ns)
            turned = PoseStamped(frame, message.position_m, message.wxyz, stamp_ns)
            forger.put(encode_pose(turned))

        forge(math.nan)
        forge(5.0, off_s=3600.0)
        forge(5.0, off_s=-3600.0)
        forge(5.0, frame="map")
        forge(5.0)
        forger.put(b"garbage")
        stranger.publisher("twin/*/sensor/pose", topic.qos, topic.type).put(b"")
        expected = {"nonfinite", "future", "old", "frame", "far", "shape", "key"}

        def counted() -> dict[str, int]:
            counts = pose_sensor(alice).dropped
            return {name: n for name in counts.__struct_fields__ if (n := getattr(counts, name))}

        alice.wait_until(lambda: counted() == dict.fromkeys(expected, 1))
        np.testing.assert_allclose(alice.odom.xy_heading, 0.0, atol=1e-9)
        assert (alice.status.mode, alice.status.command.accepted) == ("disarmed", 0)
