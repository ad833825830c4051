"""Clicked points on a sphere, invalid clicks, and the direction to a point off screen."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tsd_twin.dashboard.gateway.viewport import filter_message
from tsd_twin.dashboard.scene.picking import off_screen_direction, sphere_point
from tsd_twin.lie import SO3
from tsd_twin.security import Role

parts = st.floats(-1.0, 1.0)
vectors = st.tuples(parts, parts, parts)
CENTRE = np.array([0.3, -0.2, 0.22])
RADIUS_M = 0.15


@given(at=vectors, eye=vectors, turn=vectors, length=st.floats(0.1, 9.0))
def test_the_point_that_is_looked_at_is_the_one_that_is_met(
    at: tuple[float, float, float],
    eye: tuple[float, float, float],
    turn: tuple[float, float, float],
    length: float,
) -> None:
    """A point on the near side of the ball, in ball axes."""
    assume(np.linalg.norm(at) > 0.1)
    point = np.array(at) / np.linalg.norm(at)
    turned = SO3.exp(3.0 * np.array(turn))
    seen = CENTRE + RADIUS_M * turned.rotate(point)
    # From anywhere above the tangent plane, the ball does not block the view.
    outward = turned.rotate(point)
    place = seen + 2.0 * outward + 0.9 * (np.array(eye) - outward * (np.array(eye) @ outward))
    met = sphere_point(place, length * (seen - place), CENTRE, RADIUS_M, turned)
    assert met is not None
    np.testing.assert_allclose(met, point, atol=1e-6)


@pytest.mark.parametrize(
    ("origin", "direction"),
    [
        ((2.0, 0.0, 2.0), (0.0, 0.0, 1.0)),
        ((0.0, 0.0, 2.0), (0.0, 0.0, 0.0)),
        ((np.nan, 0.0, 2.0), (0.0, 0.0, -1.0)),
        ((0.3, -0.2, 2.0), (0.0, 0.0, np.inf)),
        ((0.3, -0.2, 2.0), (0.0, np.nan, -1.0)),
    ],
)
def test_what_is_no_ray_or_misses_meets_nothing(
    origin: tuple[float, float, float], direction: tuple[float, float, float]
) -> None:
    with np.errstate(invalid="ignore"):
        met = sphere_point(np.array(origin), np.array(direction), CENTRE, RADIUS_M, SO3.identity())
    assert met is None


@given(share=st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0)), turn=vectors, aspect=parts)
def test_a_point_outside_the_picture_has_the_direction_in_which_it_lies(
    share: tuple[float, float], turn: tuple[float, float, float], aspect: float
) -> None:
    """In fractions of half the width to the right, and half the height up."""
    assume(all(abs(abs(each) - 1.0) > 1e-6 for each in share))
    aspect, view_rad, eye = 2.0**aspect, 0.9, np.array([1.0, -2.0, 3.0])
    right, up = share[0] * np.tan(0.45) * aspect, share[1] * np.tan(0.45)
    camera = SO3.exp(3.0 * np.array(turn))
    point = eye + camera.rotate(np.array([right, -up, 1.0]))
    met = off_screen_direction(eye, camera.wxyz, view_rad, aspect, point)
    if max(np.abs(share)) < 1.0:
        assert met is None
    else:
        assert met is not None
        assert np.exp(1j * met) == pytest.approx((right + 1j * up) / abs(right + 1j * up))


def test_a_point_behind_the_camera_is_outside_and_a_broken_camera_shows_no_arrow() -> None:
    eye, ahead = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    behind = np.array([0.5, 0.0, -5.0])
    assert off_screen_direction(eye, ahead, 0.9, 1.5, behind) == pytest.approx(0.0)
    assert off_screen_direction(eye, np.nan * ahead, 0.9, 1.5, behind) is None


CLICK = {
    "type": "SceneNodeClickMessage",
    "name": "/w/r/atlas/x",
    "instance_index": None,
    "ray_origin": [0.0, 0.0, 1.0],
    "ray_direction": [0.0, 0.0, -1.0],
    "screen_pos": [0.5, 0.5],
    "modifier": None,
    "owner": "",
}


@pytest.mark.parametrize(
    ("changed", "role", "passes"),
    [
        ({}, Role.OPERATOR, True),
        ({}, Role.VIEWER, False),
        ({"name": "/w/r/atlas/msphere"}, Role.OPERATOR, False),
        ({"name": "/w/r/atlas/x\n"}, Role.OPERATOR, False),
        ({"ray_origin": [0.0, 0.0]}, Role.OPERATOR, False),
        ({"ray_direction": "up"}, Role.OPERATOR, False),
    ],
)
def test_of_clicks_only_those_on_a_sphere_by_an_operator_reach_viser(
    changed: dict[str, object], role: Role, passes: bool
) -> None:
    assert (filter_message(msgspec.msgpack.encode(CLICK | changed), role) is not None) is passes
