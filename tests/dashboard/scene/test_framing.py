"""The camera frames a robot in the uncovered part of the view."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tsd_twin.dashboard.scene.framing import (
    CHASE_RAD,
    ELEVATION_RAD,
    SHARE_OF_WIDTH,
    TOP_RAD,
    CameraPose,
    Rectangle,
    Stand,
    frame_robot,
    pictured,
    rim_points,
)
from tsd_twin.lie import SO3, Array

pytestmark = pytest.mark.computes
few = settings(max_examples=40)

stands = st.builds(
    lambda xy, reach_m, slim: Stand(xy, reach_m, slim * reach_m),
    xy=st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0)),
    reach_m=st.floats(0.05, 1.0),
    slim=st.floats(0.1, 2.5),
)
headings = st.floats(-math.pi, math.pi)
aspects = st.floats(0.4, 3.0)
fields = st.floats(0.35, 1.0)
elevations = st.sampled_from([ELEVATION_RAD, CHASE_RAD, TOP_RAD])


@st.composite
def rectangles(draw: st.DrawFn) -> Rectangle:
    left, top = draw(st.floats(0.0, 0.4)), draw(st.floats(0.0, 0.4))
    return Rectangle(left, top, left + draw(st.floats(0.3, 0.6)), top + draw(st.floats(0.3, 0.6)))


def outline(stand: Stand, pose: CameraPose, aspect: float, fov: float) -> tuple[Array, Array]:
    """Corners of the robot in the view, upper left and lower right."""
    seen = pictured(pose, rim_points(stand), aspect, fov)
    return seen.min(axis=0), seen.max(axis=0)


@few
@given(stands, headings, aspects, fields, rectangles(), elevations)
def test_a_robot_fills_half_of_the_free_height_unless_the_width_bounds_it(
    stand: Stand, heading: float, aspect: float, fov: float, free: Rectangle, elevation: float
) -> None:
    pose = frame_robot(stand, heading, aspect, fov, free, elevation)
    low, high = outline(stand, pose, aspect, fov)
    wide, tall = (high - low) / (free.right - free.left, free.bottom - free.top)
    assert wide <= SHARE_OF_WIDTH + 0.01
    assert tall <= 0.55
    assert tall >= 0.45 or wide == pytest.approx(SHARE_OF_WIDTH, abs=0.01)


@few
@given(stands, headings, aspects, fields, rectangles(), elevations)
def test_a_robot_is_in_the_middle_of_the_free_rectangle(
    stand: Stand, heading: float, aspect: float, fov: float, free: Rectangle, elevation: float
) -> None:
    low, high = outline(
        stand, frame_robot(stand, heading, aspect, fov, free, elevation), aspect, fov
    )
    middle = 0.5 * np.array([free.left + free.right, free.top + free.bottom])
    np.testing.assert_allclose(0.5 * (low + high), middle, atol=0.01)


@few
@given(stands, headings, aspects, fields, rectangles())
def test_ahead_of_the_robot_is_up_in_the_picture(
    stand: Stand, heading: float, aspect: float, fov: float, free: Rectangle
) -> None:
    pose = frame_robot(stand, heading, aspect, fov, free)
    ahead = pose.look_at - pose.position
    azimuth = math.atan2(ahead[1], ahead[0])
    assert math.remainder(azimuth - heading, math.tau) == pytest.approx(0.0, abs=1e-6)
    assert math.atan2(-ahead[2], math.hypot(ahead[0], ahead[1])) == pytest.approx(ELEVATION_RAD)
    assert pose.position[2] > stand.height_m


@few
@given(stands, headings, aspects, fields)
def test_moving_and_turning_a_robot_moves_the_camera_along(
    stand: Stand, heading: float, aspect: float, fov: float
) -> None:
    there = frame_robot(stand, heading, aspect, fov)
    at_origin = frame_robot(stand._replace(xy=(0.0, 0.0)), 0.0, aspect, fov)
    turn = SO3.exp(np.array([0.0, 0.0, heading]))
    expected = turn.rotate(at_origin.position) + np.array([*stand.xy, 0.0])
    np.testing.assert_allclose(there.position, expected, atol=1e-6)


@few
@given(stands, aspects, fields)
def test_a_rectangle_in_which_no_robot_could_be_seen_is_the_whole_picture(
    stand: Stand, aspect: float, fov: float
) -> None:
    empty = frame_robot(stand, 0.0, aspect, fov, Rectangle(0.5, 0.5, 0.5, 0.4))
    np.testing.assert_array_equal(empty.position, frame_robot(stand, 0.0, aspect, fov).position)


def test_a_point_ahead_of_the_camera_is_in_the_middle_and_left_is_left() -> None:
    pose = CameraPose(np.array([0.0, 0.0, 1.0]), np.array([2.0, 0.0, 1.0]))
    points = np.array([[5.0, 0.0, 1.0], [2.0, 1.0, 1.0], [2.0, 0.0, 2.0]])
    seen = pictured(pose, points, 2.0, math.pi / 2.0)
    np.testing.assert_allclose(seen, [[0.5, 0.5], [0.375, 0.5], [0.5, 0.25]], atol=1e-9)
