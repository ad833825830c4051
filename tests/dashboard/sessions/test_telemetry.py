"""Telemetry sent to pages, for all kinds of robots."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.scene_doubles import RobotFeed
from tsd_twin import robots
from tsd_twin.adapters.ros.external_robot import ExternalLimits, describe
from tsd_twin.dashboard.sessions.actuator_telemetry import SphereTelemetry
from tsd_twin.dashboard.sessions.telemetry import RobotTelemetry
from tsd_twin.dashboard.wire.to_page import encode_message
from tsd_twin.lie import SO3
from tsd_twin.messages.status import LimitStatus, RobotStatus
from tsd_twin.robots.external import NOT_PROMISED

SPHERE: Any = robots.load_robot("atlas")


@pytest.mark.parametrize("name", robots.robot_names())
def test_a_card_says_what_the_robot_has_and_nothing_else(name: str) -> None:
    robot: Any = robots.load_robot(name)
    drive = robot.kinematics()
    link: Any = SimpleNamespace(id=name, robot=robot, kinematics=drive)
    card = json.loads(encode_message(RobotTelemetry(link).info()))
    gimbals = card["panel"] == "gimbals"
    assert bool(card["modules"]) is gimbals is (card["max_tilt_deg"] is not None)
    assert bool(card["wheels"]) is not gimbals
    assert (card["modules"] or card["wheels"]) == list(drive.actuators)
    units = {(0, 1, 5): ["m/s", "m/s", "rad/s"], (3, 4, 5): ["rad/s"] * 3}
    assert [number["unit"] for number in card["twist_axes"]] == units[drive.twist_axes]


def test_the_card_of_a_robot_by_ros_says_what_is_not_promised() -> None:
    robot = robots.parse_description(describe("cart", "", ExternalLimits()), "cart")
    link: Any = SimpleNamespace(id="cart", robot=robot, kinematics=robot.kinematics())
    card = json.loads(encode_message(RobotTelemetry(link).info()))
    assert card["panel"] == "twist"
    assert tuple(card["not_promised"]) == robot.not_promised
    assert set(NOT_PROMISED) < set(card["not_promised"])
    assert not card["wheels"]
    assert not card["modules"]
    fields = card["plot_fields"]
    assert {"joints.vx.velocity_rad_per_s", "joints.odom_x_m.position_rad"} <= set(fields)


@pytest.mark.parametrize("sides", [(-1.0, -1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, 1.0)])
def test_the_rows_in_contact_are_told_from_the_motion(sides: tuple[float, ...]) -> None:
    """Wheel speeds from exact row positions yield those rows and the model difference."""
    drive = SPHERE.kinematics()
    feed = RobotFeed("atlas", SPHERE)
    twist = np.array([0.9, -0.5, 0.7])
    joints = drive.true_inverse(twist, np.array(sides))
    feed.say(joints=joints, ball=SO3.identity(), other_ball=SO3.exp(np.array([0.0, 0.1, 0.0])))
    odom = feed.snapshot.odom
    assert odom is not None
    odom.twist[:] = twist
    state = SphereTelemetry(SPHERE).state(joints, joints, feed.snapshot)
    ball = state["sphere"]
    assert list(ball.rows) == [1 if side < 0.0 else 2 for side in sides]
    ideal = drive.forward(joints).twist
    cosine = ideal @ twist / np.linalg.norm(ideal) / np.linalg.norm(twist)
    assert ball.angle_deg == pytest.approx(np.degrees(np.arccos(cosine)), abs=0.01)
    # At most the angle that a contact offset can cause, 3.2° in the paper.
    assert 0.0 < ball.angle_deg < 5.0
    assert state["estimate_difference"].degrees == pytest.approx(np.degrees(0.1), abs=0.01)


def test_a_sphere_at_rest_says_nothing_of_its_rows() -> None:
    feed = RobotFeed("atlas", SPHERE)
    feed.say(joints=np.zeros(3), ball=SO3.identity())
    ball = SphereTelemetry(SPHERE).state(np.zeros(3), np.zeros(3), feed.snapshot)["sphere"]
    assert list(ball.rows) == [0, 0, 0]
    assert ball.angle_deg is None


numbers = st.sampled_from((0.0, 0.1, 0.3))
snapshots = st.tuples(
    numbers, numbers, numbers, numbers, st.sampled_from((0.5, 1.0)), st.booleans()
)


@settings(max_examples=40)
@given(name=st.sampled_from(robots.robot_names()), steps=st.lists(snapshots, max_size=12))
def test_each_state_is_that_of_telemetry_without_a_past(
    name: str, steps: list[tuple[float, float, float, float, float, bool]]
) -> None:
    """Results for an earlier snapshot are used again only for an equal one."""
    feed = RobotFeed(name, robots.load_robot(name))
    telemetry = RobotTelemetry(feed)
    for speed, turn, asked, moved, applied, turns in steps:
        joints = feed.kinematics.inverse(np.array([speed, 0.0, turn]))
        setpoint = feed.kinematics.inverse(np.array([asked, 0.0, turn]))
        status = RobotStatus("driving", limits=LimitStatus(speed_mps=applied, applied=applied))
        pose, twist = np.array([moved, speed, turn]), np.array([speed, 0.0, moved])
        feed.say(pose=pose, twist=twist, joints=joints, setpoint=setpoint, status=status)
        if turns:
            ball, other = SO3.exp(pose), SO3.exp(twist)
            feed.say(ball=ball, other_ball=other)
        assert telemetry.state(feed.snapshot, feed.now_s) == RobotTelemetry(feed).state(
            feed.snapshot, feed.now_s
        )
