"""Self-calibration of a simulated camera recovers its lens and place."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tsd_twin.camera import guide
from tsd_twin.camera.board import Board
from tsd_twin.camera.calibration import Distances
from tsd_twin.camera.lens import PARAMETERS
from tsd_twin.camera.render import Body, SimulatedCamera, cylinder
from tsd_twin.camera.setup_file import CameraSetup, read_setup
from tsd_twin.camera.simulated import floor_tags, random_view
from tsd_twin.camera.tags import Tag
from tsd_twin.camera.tracker import TagTracker
from tsd_twin.errors import TwinError
from tsd_twin.lie import SE2, wrap

ROBOT = Tag(3, 0.16, "tsd", 0.3)
SIZE = 960, 540


def calibrated(file: Path, seed: int) -> tuple[SimulatedCamera, CameraSetup]:
    """Return a camera with unknown lens and place, and its calibration result."""
    random = np.random.default_rng(seed)
    view = random_view(SIZE, 60.0, 2.0, random)
    on_floor = floor_tags(view, 0.16, random)
    camera = SimulatedCamera(view, on_floor, seed=seed)
    guide.calibrate_lens_simulated(camera, Board(), str(file), seed)
    numbers, origin, distances_m = guide.measured(on_floor, seed)
    tags = {number: Tag(number, 0.16) for number in numbers}
    pictures = [camera.draw([]) for _ in range(3)]
    guide.calibrate_floor(read_setup(file), pictures, tags, origin, distances_m, str(file))
    return camera, read_setup(file)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_robot_is_within_what_the_calibration_states(tmp_path: Path, seed: int) -> None:
    camera, setup = calibrated(tmp_path / "camera.toml", seed)
    known = CameraSetup(setup.lens, setup.place, setup.covariance, (ROBOT,), setup.errors)
    for x, y, heading in np.random.default_rng(seed).uniform(-0.4, 0.4, (6, 3)):
        robot = Body([cylinder(0.2, 0.29)], [ROBOT])
        picture = camera.draw([(robot, [np.array([x, y, heading])])])
        found = TagTracker(known).observe(picture, 0.0).poses["tsd"]
        error = found.pose.xy_heading - [x, y, heading]
        error[2] = wrap(error[2])
        assert np.hypot(*error[:2]) < 0.006
        # Chance of a larger error in 12 sets of 3 numbers: 1e-5.
        assert error @ np.linalg.solve(found.covariance, error) < 31.0


def test_tags_that_are_fewer_than_three_determine_no_place(tmp_path: Path) -> None:
    view = random_view(SIZE, 60.0, 2.0, np.random.default_rng(1))
    tags = floor_tags(view, 0.16, np.random.default_rng(1))[:2]
    camera = SimulatedCamera(view, tags)
    setup = CameraSetup(view.lens, covariance=np.eye(14))
    known = {tag.number: tag for tag in tags}
    with pytest.raises(TwinError, match="too few"):
        guide.calibrate_floor(
            setup, [camera.draw([])], known, SE2.identity(), {}, str(tmp_path / "camera.toml")
        )


@pytest.mark.parametrize(("unseen", "distances_m"), [(100, {}), (103, {(101, 103): 1.0})])
def test_tag_of_origin_or_scale_out_of_view_is_named_instead_of_replaced(
    tmp_path: Path, unseen: int, distances_m: Distances
) -> None:
    view = random_view(SIZE, 60.0, 2.0, np.random.default_rng(1))
    tags = floor_tags(view, 0.16, np.random.default_rng(1))
    camera = SimulatedCamera(view, [tag for tag in tags if tag.number != unseen])
    setup = CameraSetup(view.lens, covariance=np.eye(14))
    known = {tag.number: tag for tag in tags}
    file = str(tmp_path / "camera.toml")
    with pytest.raises(TwinError, match=f"tag {unseen} is not seen"):
        guide.calibrate_floor(setup, [camera.draw([])], known, SE2.identity(), distances_m, file)


@pytest.mark.parametrize("seed", [3, 4])
def test_each_measured_distance_makes_the_height_of_the_camera_more_certain(
    tmp_path: Path, seed: int
) -> None:
    random = np.random.default_rng(seed)
    view = random_view(SIZE, 60.0, 2.0, random)
    on_floor = floor_tags(view, 0.16, random)
    pictures = [SimulatedCamera(view, on_floor, seed=seed).draw([])]
    setup = CameraSetup(view.lens, covariance=1e-6 * np.eye(14))
    numbers, origin, distances_m = guide.measured(on_floor, seed)
    tags = {number: Tag(number, 0.16) for number in numbers}
    found = [
        guide.calibrate_floor(setup, pictures, tags, origin, known, str(tmp_path / "camera.toml"))
        for count in range(len(distances_m) + 1)
        for known in [dict(list(distances_m.items())[:count])]
    ]
    sigmas_m = [math.sqrt(fit.covariance[PARAMETERS - 1, PARAMETERS - 1]) for fit in found]
    assert sigmas_m == sorted(sigmas_m, reverse=True)
    assert sigmas_m[1] < 0.5 * sigmas_m[0]
    for fit, sigma_m in zip(found, sigmas_m, strict=True):
        off_m = fit.view.place.position_m[2] - view.place.position_m[2]
        assert abs(off_m) < 4.5 * sigma_m


@pytest.mark.parametrize("seed", range(1, 9))
def test_floor_tags_of_a_simulated_camera_are_in_view_however_it_is_turned(seed: int) -> None:
    random = np.random.default_rng(seed)
    view = random_view(SIZE, 94.0, 2.5, random)
    corners = [tag.place.transform(tag.corners_m) for tag in floor_tags(view, 0.16, random)]
    pixels = view.project(np.column_stack([np.concatenate(corners), np.zeros(24)]))
    assert (pixels > 0.0).all()
    assert (pixels < np.array(SIZE) - 1.0).all()
