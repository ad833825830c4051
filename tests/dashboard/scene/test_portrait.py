"""Portraits of robots show the nearest surfaces and nothing else."""

from __future__ import annotations

import io
import math
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from PIL import Image

from tsd_twin.dashboard.scene.portrait import HEIGHT_PX, WIDTH_PX, rasterize
from tsd_twin.dashboard.scene.robot_geometry import robot_shape
from tsd_twin.lie import Array
from tsd_twin.robots import load_robot, robot_names

WIDTH, HEIGHT = 7, 5
corners = arrays.arrays(
    float, st.tuples(st.integers(1, 6), st.just(3), st.just(3)), elements=st.integers(-300, 900)
)


@given(triangles=corners.map(lambda drawn: drawn / 100.0))
def test_each_pixel_shows_the_nearest_triangle_over_its_middle(triangles: Array) -> None:
    for (row, column), shown in np.ndenumerate(rasterize(triangles, WIDTH, HEIGHT)):
        over = [over_point(each, np.array([column + 0.5, row + 0.5])) for each in triangles]
        assert shown < 0 or over[shown].margin >= -1e-6
        surely = [each.depth for each in over if each.margin > 1e-3]
        if surely:
            assert shown >= 0
            assert over[shown].margin <= 1e-3 or over[shown].depth <= min(surely) + 1e-6


class Over(NamedTuple):
    """Distance of a point inside a triangle, as a fraction, and the depth there."""

    margin: float
    depth: float


def over_point(triangle: Array, at: Array) -> Over:
    """Solve for the weights of the three corners, all of which are positive inside."""
    flat = np.vstack([triangle[:, :2].T, np.ones(3)])
    if abs(np.linalg.det(flat)) < 1e-6:
        return Over(0.0, math.inf)  # Edge-on, so either result is right.
    weights = np.linalg.solve(flat, [*at, 1.0])
    return Over(float(weights.min()), float(weights @ triangle[:, 2]))


@pytest.mark.parametrize("name", robot_names())
def test_a_shipped_robot_fills_its_portrait_before_a_transparent_background(name: str) -> None:
    picture = Image.open(io.BytesIO(robot_shape(load_robot(name)).portrait))
    assert picture.size == (WIDTH_PX, HEIGHT_PX)
    alpha = np.asarray(picture.convert("RGBA"))[..., 3]
    rows, columns = np.nonzero(alpha > 128)
    spans = np.ptp(columns) / WIDTH_PX, np.ptp(rows) / HEIGHT_PX
    assert 0.9 < max(spans) < 1.0
    corners_of_picture = alpha[[0, 0, -1, -1], [0, -1, 0, -1]]
    assert corners_of_picture.max() == 0
