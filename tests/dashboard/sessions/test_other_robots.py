"""Which robots are obstacles for the paths of another, and which a stop envelope reaches."""

from __future__ import annotations

import math
from typing import cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.scene_doubles import RobotFeed
from tsd_twin import robots
from tsd_twin.client.monitor import RobotMonitor
from tsd_twin.dashboard.sessions.other_robots import MARGIN_M, OtherRobots
from tsd_twin.messages.status import PoseSensorStatus, RobotStatus
from tsd_twin.motion.obstacles import Disc

REACH_M = {"tsd": 0.4, "kiwi": 0.2, "atlas": 0.3}


class Feed(RobotFeed):
    """Robot whose states the test sets; never a recording."""

    is_recording = False


def feed(name: str, pose: tuple[float, float, float], *, seen: bool = True, **more: object) -> Feed:
    made = Feed(id=name, robot=robots.load_robot(name))
    sensor = PoseSensorStatus(used=1 if seen else 0)
    made.say(pose=np.array(pose), status=RobotStatus("ready", pose_sensor=sensor), **more)  # type: ignore[arg-type]
    return made


def discs(own: Feed, other: Feed) -> list[Disc]:
    links = {each.id: cast(RobotMonitor, each) for each in (own, other)}
    return OtherRobots(links, REACH_M.__getitem__).discs(cast(RobotMonitor, own))


def reached(own: Feed, other: Feed, envelope: np.ndarray) -> str | None:
    links = {each.id: cast(RobotMonitor, each) for each in (own, other)}
    return OtherRobots(links, REACH_M.__getitem__).reached_by(cast(RobotMonitor, own), envelope)


@given(st.booleans(), st.booleans())
def test_only_localized_robots_are_obstacles_for_localized_robots(own: bool, other: bool) -> None:
    found = discs(feed("tsd", (0.0, 0.0, 0.0), seen=own), feed("kiwi", (2.0, 1.0, 0.0), seen=other))
    assert bool(found) == (own and other)


def test_a_disc_has_both_radii_both_uncertainties_and_a_margin() -> None:
    covariance = np.diag([0.03**2, 0.01**2, 0.1])
    own = feed("tsd", (0.0, 0.0, 0.0), covariance=covariance)
    (disc,) = discs(own, feed("kiwi", (2.0, 1.0, 0.0)))
    assert disc.robot == "kiwi"
    assert disc.xy == (2.0, 1.0)
    # Chi-square with two degrees of freedom: 95 % within 2.4477 standard deviations.
    assert disc.radius_m == pytest.approx(0.6 + MARGIN_M + 2.4477 * 0.03, abs=1e-3)


def test_a_moving_robot_is_also_where_it_will_be_in_a_second() -> None:
    moving = feed("kiwi", (2.0, 1.0, math.pi / 2.0), twist=np.array([0.5, 0.0, 0.3]))
    here, ahead = discs(feed("tsd", (0.0, 0.0, 0.0)), moving)
    assert here.xy == pytest.approx((2.0, 1.0))
    assert ahead.xy == pytest.approx((2.0, 1.5))


def test_spheres_recordings_and_poses_that_are_no_numbers_are_no_obstacles() -> None:
    own = feed("tsd", (0.0, 0.0, 0.0))
    past = feed("kiwi", (1.0, 0.0, 0.0))
    past.is_recording = True
    assert discs(own, past) == []
    assert discs(own, feed("kiwi", (math.nan, 0.0, 0.0))) == []
    assert discs(own, feed("atlas", (1.0, 0.0, 0.0))) == []


@given(
    st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.floats(-3, 3)),
    st.tuples(st.floats(-2, 2), st.floats(-2, 2)),
)
def test_a_stop_envelope_reaches_a_robot_if_a_point_of_it_is_within_its_radius(
    pose: tuple[float, float, float], place: tuple[float, float]
) -> None:
    square = 0.5 * np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 41), np.linspace(-0.5, 0.5, 41))
    c, s = math.cos(pose[2]), math.sin(pose[2])
    points = np.stack([pose[0] + c * x - s * y, pose[1] + s * x + c * y], axis=-1)
    gap_m = float(np.hypot(*np.moveaxis(points - place, -1, 0)).min()) - REACH_M["kiwi"]
    found = reached(feed("tsd", pose), feed("kiwi", (*place, 0.0)), square)
    if abs(gap_m) > 0.02:  # Distance of the points from each other.
        assert found == ("kiwi" if gap_m < 0.0 else None)
    assert reached(feed("tsd", pose, seen=False), feed("kiwi", (*place, 0.0)), square) is None


def test_an_envelope_at_rest_reaches_nobody() -> None:
    own, other = feed("tsd", (0.0, 0.0, 0.0)), feed("kiwi", (0.3, 0.0, 0.0))
    links = {each.id: cast(RobotMonitor, each) for each in (own, other)}
    robots_around = OtherRobots(links, REACH_M.__getitem__)
    assert robots_around.reached_by(cast(RobotMonitor, own), None) is None
