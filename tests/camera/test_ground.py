"""Pictures on the scene floor: each point has the colour seen there by the camera."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.camera.ground import ground_grid
from tsd_twin.camera.lens import CameraPlace, Lens, View
from tsd_twin.dashboard.pictures.ground import seen_from_above
from tsd_twin.lie import Array
from tsd_twin.messages.pictures import GroundGrid

WIDTH, HEIGHT = 640, 360
PERIOD_M = 0.8


def colours(places: Array) -> Array:
    """Colours (n, 3) of a floor with smooth waves along x and y."""
    waves = 0.5 + 0.4 * np.sin(2.0 * np.pi * places / PERIOD_M)
    return 255.0 * np.column_stack([waves, np.full(len(places), 0.5)])


def pinhole(position_m: Array, rotation: Array, focal_px: float) -> Array:
    """Render that floor with a pinhole camera, by independent ray casting."""
    columns, rows = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    rays = np.stack(
        [
            (columns - 0.5 * (WIDTH - 1)) / focal_px,
            (rows - 0.5 * (HEIGHT - 1)) / focal_px,
            np.ones_like(columns, float),
        ],
        axis=-1,
    ).reshape(-1, 3)
    down = rays @ rotation
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(down[:, 2] < 0.0, -position_m[2] / down[:, 2], np.nan)
    floor = position_m[:2] + reach[:, None] * down[:, :2]
    seen = np.nan_to_num(colours(np.nan_to_num(floor)), nan=0.0)
    return seen.reshape(HEIGHT, WIDTH, 3).astype(np.uint8)


views = st.tuples(
    st.floats(-2.0, 2.0),
    st.floats(-2.0, 2.0),
    st.floats(1.5, 4.0),
    st.floats(0.0, math.radians(40.0)),
    st.floats(-math.pi, math.pi),
    st.floats(50.0, 90.0),
)


@given(views)
def test_the_floor_from_above_has_the_colours_of_the_floor(
    drawn: tuple[float, float, float, float, float, float],
) -> None:
    x_m, y_m, height_m, tilt, heading, across_deg = drawn
    position = np.array([x_m, y_m, height_m])
    ahead = np.array([math.cos(heading), math.sin(heading), 0.0]) * height_m * math.tan(tilt)
    place = CameraPlace.looking_at(position, position * [1.0, 1.0, 0.0] + ahead)
    focal = 0.5 * WIDTH / math.tan(0.5 * math.radians(across_deg))
    picture = pinhole(position, place.matrix, focal)
    grid = ground_grid(View(Lens.ideal(WIDTH, HEIGHT, across_deg), place))
    assert grid is not None
    flat = seen_from_above(picture, grid)
    height, width = flat.shape[:2]
    u, v = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    floor = np.column_stack([u.ravel(), 1.0 - v.ravel()]) * grid.size_m + grid.corner_m
    blank = picture[::16, ::16].mean(axis=(0, 1)).astype(np.uint8)
    known = ~np.all(flat.reshape(-1, 3) == blank, axis=1)
    error = np.abs(flat.reshape(-1, 3) - colours(floor))[known]
    assert known.mean() > 0.2
    assert np.median(error) < 12.0
    assert np.quantile(error, 0.95) < 60.0


def test_a_camera_that_sees_no_floor_has_no_grid() -> None:
    place = CameraPlace.looking_at(np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 3.0]))
    assert ground_grid(View(Lens.ideal(WIDTH, HEIGHT, 40.0), place)) is None


def test_what_the_camera_does_not_show_has_the_mean_colour() -> None:
    outside = [[(-10.0, -10.0)] * 3] * 3
    flat = seen_from_above(
        np.full((40, 60, 3), 77, np.uint8), GroundGrid((0.0, 0.0), (2.0, 1.0), outside)
    )
    assert flat.shape[1] == 2 * flat.shape[0]
    assert np.unique(flat) == pytest.approx(77)
