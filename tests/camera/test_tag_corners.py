"""Corners of tags in simulated pictures, against the true projections."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tsd_twin.camera.detect import Gray, Window, detect, find_tags, refine_corners, refined, side_px
from tsd_twin.camera.lens import View
from tsd_twin.camera.planar_fit import corner_points
from tsd_twin.camera.render import Body, Sensor, SimulatedCamera, cylinder, exposure_poses
from tsd_twin.camera.simulated import random_view
from tsd_twin.camera.tags import Tag
from tsd_twin.lie import SE2, Array

SIZE = (1280, 720)
TAG = Tag(3, 0.16, "tsd", 0.3)
CELLS = np.array([8])
MOST_OFF_PX = 0.3
"""Seven standard deviations of a corner of the smallest of these tags, 30 px."""


def shown(
    across_deg: float, height_m: float, seed: int, count: int
) -> list[tuple[View, Gray, Array]]:
    """Return the view, the picture and the true corners (4, 2) of tags on robots.

    The outer edge of the white border has much contrast, or little.
    """
    random = np.random.default_rng(seed)
    view = random_view(SIZE, across_deg, height_m, random)
    camera = SimulatedCamera(view, seed=seed)
    found: list[tuple[View, Gray, Array]] = []
    for i in range(count):
        inset = TAG.size_m * float(view.lens.parameters[0]) / (height_m - TAG.height_m)
        spot = random.uniform(inset, np.array(SIZE) - inset)
        place = view.on_plane(spot[None], TAG.height_m)[0]
        pose = np.array([*place, random.uniform(-math.pi, math.pi)])
        robot = Body([cylinder(0.2, 0.28, [70, 235, 40][i % 3])], [TAG])
        found.append((view, camera.draw([(robot, [pose])]), view.project(corner_points(TAG, pose))))
    return found


@pytest.mark.parametrize(("across_deg", "height_m"), [(60.0, 1.6), (60.0, 5.5), (94.0, 2.5)])
def test_corners_are_where_the_lens_shows_them(across_deg: float, height_m: float) -> None:
    """For sides of 30 to 135 px."""
    for view, picture, true in shown(across_deg, height_m, 7, 20):
        window = Window.around(true, 40.0, picture.shape)
        (seen,) = refined(picture, detect(picture, window, TAG.family), view.lens)
        assert np.linalg.norm(seen.corners - true, axis=1).max() < MOST_OFF_PX


def test_a_window_shows_the_corners_of_the_whole_picture() -> None:
    ((view, picture, true),) = shown(94.0, 2.5, 3, 1)
    (whole,) = find_tags(picture, [TAG.family], view.lens)
    for margin_px in (8.0, 20.0, 33.5):
        window = Window.around(true, margin_px, picture.shape)
        (seen,) = refined(picture, detect(picture, window, TAG.family), view.lens)
        assert np.abs(seen.corners - whole.corners).max() < 0.02


@pytest.mark.parametrize("across_deg", [60.0, 94.0])
def test_corners_of_a_driving_tag_are_those_in_the_middle_of_the_exposure(
    across_deg: float,
) -> None:
    """RMS at 1 m/s and 2 rad/s, in any direction.

    Four samples across a pixel place an edge along the pixels up to 0.125 px off.
    """
    random = np.random.default_rng(1)
    view = random_view(SIZE, across_deg, 2.5, random)
    camera = SimulatedCamera(view, sensor=Sensor(noise=0.0))
    robot, errors = Body([cylinder(0.2, 0.28)], [TAG]), list[Array]()
    for way in np.linspace(0.0, 2.0 * math.pi, 12):
        pose = np.array([*random.uniform(-0.4, 0.4, 2), random.uniform(-math.pi, math.pi)])
        half = 0.5 * camera.sensor.exposure_s * np.array([math.cos(way), math.sin(way), 2.0])
        driven = exposure_poses(SE2(pose - half), SE2(pose + half))
        (seen,) = find_tags(camera.draw([(robot, driven)]), [TAG.family], view.lens)
        errors.append(seen.corners - view.project(corner_points(TAG, pose)))
    assert np.sqrt(np.square(errors).mean()) < 0.06


@functools.cache
def pictures() -> list[tuple[View, Gray, Array]]:
    """Return three pictures, drawn once."""
    return shown(94.0, 2.5, 4, 3)


@given(
    number=st.integers(0, 2),
    errors=st.lists(st.floats(-0.3, 0.3), min_size=8, max_size=8),
)
@settings(max_examples=100)
def test_corners_do_not_depend_on_the_first_guess(number: int, errors: list[float]) -> None:
    """Guesses are off by 0.3 cells in each coordinate, which is 1.6 px; OpenCV's, by 2 px."""
    view, pixels, true = pictures()[number]
    cell_px = np.linalg.norm(true[1] - true[0]) / CELLS
    guess = true + cell_px * np.reshape(errors, (4, 2))
    (found,), (is_tag,) = refine_corners(pixels, guess[None], CELLS, view.lens)
    assert is_tag
    assert np.linalg.norm(found - true, axis=1).max() < MOST_OFF_PX


@given(st.lists(st.floats(-40.0, 40.0), min_size=8, max_size=8))
@settings(max_examples=200)
def test_corners_never_leave_their_cell(errors: list[float]) -> None:
    """Any quadrilateral, also one that crosses itself, is refused or stays within a cell."""
    view, pixels, true = pictures()[0]
    guess = true + np.reshape(errors, (4, 2))
    (found,), _ = refine_corners(pixels, guess[None], CELLS, view.lens)
    assert np.linalg.norm(found - guess, axis=1).max() <= side_px(guess) / CELLS
