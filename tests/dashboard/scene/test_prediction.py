"""The predicted floor area contains the motion after link loss; it is empty at rest."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.controller_harness import ROBOT, ControllerHarness
from tests.support.scene_doubles import RobotFeed
from tsd_twin.client.connection import SentCommand
from tsd_twin.client.monitor import RoundTrips
from tsd_twin.dashboard.scene.overlays import swept_outline
from tsd_twin.dashboard.scene.robot_overlays import MotionPredictor, Prediction
from tsd_twin.dashboard.scene.themed import hatching
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.cdr import BASE, ODOM
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.status import LimitStatus, RobotStatus
from tsd_twin.simulation import SimRobot

DRIVE = ROBOT.kinematics()
REACH_M = 0.25
WITHIN_M = 0.01
speeds = st.floats(-0.7, 0.7)
twists = st.tuples(speeds, speeds, st.floats(-3.0, 3.0))

AGE_S = ROBOT.limits.max_command_age_s


def trips_of(trip_s: float | None) -> RoundTrips:
    trips = RoundTrips()
    if trip_s is not None:
        trips.add(trip_s)
    return trips


def look(
    feed: RobotFeed,
    twist: Array,
    mode: str,
    trip_s: float | None,
    sent: list[SentCommand],
    max_age_s: float,
) -> Prediction:
    status = RobotStatus(mode, limits=LimitStatus(1.0, 3.0, max_age_s))
    setpoint = DRIVE.inverse(twist)
    feed.say(pose=np.zeros(3), twist=twist, setpoint=setpoint, status=status)
    return MotionPredictor(DRIVE, ROBOT).predict(feed.snapshot, setpoint, sent, trips_of(trip_s))


def commands(feed: RobotFeed, twist: Array, frame: str = BASE) -> list[SentCommand]:
    """Commands at 50 Hz until now."""
    return [SentCommand(feed.now_s - 0.02 * i, twist, frame) for i in range(40, 0, -1)]


@pytest.mark.parametrize("delay_periods", [0, 5, 10])
@pytest.mark.parametrize("omega", [0.0, 1.5, -3.0])
def test_a_robot_whose_link_dies_comes_to_rest_within_what_was_drawn(
    delay_periods: int, omega: float
) -> None:
    """Simulated with commands in flight, until true standstill."""
    rig = ControllerHarness(SimRobot(ROBOT))
    pilot = rig.get_ready()
    twist = np.array([0.8, -0.3, omega])
    rig.drive(pilot, twist.tolist(), 1.0)
    assert rig.mode is Mode.DRIVING
    pose, setpoint = rig.pose, rig.setpoint
    feed = RobotFeed()
    sent = commands(feed, twist)
    status = RobotStatus("driving", limits=LimitStatus(1.0, 3.0, AGE_S))
    feed.say(pose=pose, twist=rig.controller.end_twist, setpoint=setpoint, status=status)
    trips = trips_of(delay_periods * 0.01)
    path = MotionPredictor(DRIVE, ROBOT).predict(feed.snapshot, setpoint, sent, trips).path
    assert path is not None
    # Deliver the commands in flight, and none after them.
    seen = rig.status_seq
    for period in range(delay_periods):
        if period % 2 == 0:
            rig.inbox.append(rig.sample(pilot, twist.tolist(), status_seq=seen))
        rig.tick()
    start, corners = SE2(pose), swept_outline(path, REACH_M)
    farthest = 0.0
    for _ in range(100):
        rig.tick()
        there = start.inverse().transform(rig.truth()[:2])
        farthest = max(farthest, float(np.hypot(*there)))
        assert depth_m(corners, there) >= REACH_M - WITHIN_M
    assert not rig.twist.any()
    drawn = max(float(np.hypot(*point)) for point in path[:, :2])
    assert drawn < farthest + 0.06, "no more is drawn than the rules allow"


def depth_m(corners: Array, points: Array) -> Array:
    """Depth of points (..., 2) within a convex polygon; negative outside."""
    edges = np.roll(corners, -1, axis=0) - corners
    inward = np.stack([-edges[:, 1], edges[:, 0]], axis=-1)
    inward /= np.linalg.norm(inward, axis=-1, keepdims=True)
    depths: Array = ((points[..., None, :] - corners) * inward).sum(axis=-1).min(axis=-1)
    return depths


@given(
    path=st.lists(st.tuples(speeds, speeds), min_size=1, max_size=20), reach_m=st.floats(0.05, 1.0)
)
def test_the_outline_holds_a_disc_about_every_point_of_the_path(
    path: list[tuple[float, float]], reach_m: float
) -> None:
    corners = swept_outline(np.array(path), reach_m)
    distinct = corners[np.linalg.norm(corners - np.roll(corners, -1, axis=0), axis=-1) > 1e-9]
    for point in path:
        assert depth_m(distinct, np.array(point)) >= reach_m - 1e-9


@given(
    path=st.lists(st.tuples(speeds, speeds), min_size=1, max_size=20), reach_m=st.floats(0.1, 1.0)
)
def test_hatching_fills_the_outline_evenly(path: list[tuple[float, float]], reach_m: float) -> None:
    corners, spacing_m = swept_outline(np.array(path), reach_m), 0.01
    lines = hatching(corners, spacing_m)
    x, y = corners.T
    area_m2 = 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    lengths_m = np.linalg.norm(lines[:, 1] - lines[:, 0], axis=-1)
    assert spacing_m * lengths_m.sum() == pytest.approx(area_m2, rel=0.02)
    distinct = corners[np.linalg.norm(corners - np.roll(corners, -1, axis=0), axis=-1) > 1e-9]
    np.testing.assert_allclose(depth_m(distinct, lines), 0.0, atol=1e-6)


@pytest.mark.parametrize("mode", ["disarmed", "ready", "stopped", "fault"])
def test_at_rest_there_is_nothing_to_show(mode: str) -> None:
    outlook = look(RobotFeed(), np.zeros(3), mode, 0.2, [], AGE_S)
    assert outlook.arrival_pose is None
    assert outlook.path is None


@given(twist=twists)
def test_a_ghost_is_shown_to_who_drives_over_a_delay_only(
    twist: tuple[float, float, float],
) -> None:
    asked = np.array(twist)
    feed = RobotFeed()
    sent = commands(feed, asked)
    ghost = look(feed, asked, "driving", 0.15, sent, AGE_S).arrival_pose
    assert ghost is not None
    if math.hypot(*twist[:2]) > 0.05:
        assert np.hypot(*ghost[:2]) > 0.0
    assert look(feed, asked, "driving", 0.02, sent, AGE_S).arrival_pose is None
    assert look(feed, asked, "driving", None, sent, AGE_S).arrival_pose is None
    assert look(feed, asked, "driving", 0.15, [], AGE_S).arrival_pose is None, (
        "another dashboard drives"
    )


def test_who_knows_no_delay_draws_the_most_that_the_rules_allow() -> None:
    forward = np.array([1.0, 0.0, 0.0])
    feed = RobotFeed()
    sent = commands(feed, forward)
    near = look(feed, forward, "driving", 0.01, sent, AGE_S).path
    unknown = look(feed, forward, "driving", None, sent, AGE_S).path
    watching = look(feed, forward, "driving", 0.01, [], AGE_S).path
    slow = look(feed, forward, "driving", 9.0, sent, AGE_S).path
    reach = [path[-1, 0] for path in (near, unknown, watching, slow) if path is not None]
    # 0.2 s of silence, limited by the maximum command age, then braking from 1 m/s at 6 m/s^2.
    assert reach[0] == pytest.approx(AGE_S + 1.0 / 12.0, abs=0.06)
    assert reach[3] == pytest.approx(AGE_S + 1.0 / 12.0, abs=0.06)
    # Another dashboard may have received a status sent later by that time.
    assert reach[1:3] == pytest.approx([2 * AGE_S + 1.0 / 12.0] * 2, abs=0.06)


def test_a_command_in_the_axes_of_the_world_does_not_turn_with_the_robot() -> None:
    feed = RobotFeed()
    sent = commands(feed, np.array([0.5, 0.0, 2.0]), ODOM)
    ghost = look(feed, np.array([0.5, 0.0, 2.0]), "driving", 0.3, sent, 1.0).arrival_pose
    assert ghost is not None
    assert ghost[0] == pytest.approx(0.15, abs=0.02)
    assert abs(ghost[1]) < 0.02
    assert ghost[2] == pytest.approx(0.6, abs=0.05)


@pytest.mark.parametrize("speed_mps", [0.0, -1.0, math.nan])
def test_a_status_whose_limits_are_none_predicts_nothing(speed_mps: float) -> None:
    feed, setpoint = RobotFeed(), DRIVE.inverse(np.array([0.3, 0.0, 0.0]))
    limits = LimitStatus(speed_mps, 3.0, AGE_S)
    feed.say(pose=np.zeros(3), setpoint=setpoint, status=RobotStatus(Mode.DRIVING, limits=limits))
    found = MotionPredictor(DRIVE, ROBOT).predict(feed.snapshot, setpoint, [], trips_of(0.1))
    assert found.path is None
    assert found.arrival_pose is None


@pytest.mark.parametrize("broken", [math.nan, math.inf])
def test_commanded_twist_replaces_a_non_finite_estimate(broken: float) -> None:
    feed, forward = RobotFeed(), np.array([0.5, 0.0, 0.0])
    sent = commands(feed, forward)
    status = RobotStatus(Mode.DRIVING, limits=LimitStatus(1.0, 3.0, 1.0))
    setpoint = DRIVE.inverse(forward)
    feed.say(pose=np.zeros(3), twist=np.full(3, broken), setpoint=setpoint, status=status)
    found = MotionPredictor(DRIVE, ROBOT).predict(feed.snapshot, setpoint, sent, trips_of(0.3))
    assert found.arrival_pose is not None
    assert found.arrival_pose[0] == pytest.approx(0.15, abs=0.02)
