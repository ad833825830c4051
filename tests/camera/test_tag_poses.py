"""Robot poses from simulated pictures, against the true poses."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tsd_twin.camera.board import Board, board_pdf, tags_pdf
from tsd_twin.camera.lens import CameraPlace, Lens, View
from tsd_twin.camera.planar_fit import Refusal
from tsd_twin.camera.render import Body, SimulatedCamera, cylinder
from tsd_twin.camera.setup_file import CameraSetup, read_setup, write_setup
from tsd_twin.camera.tags import Tag
from tsd_twin.camera.tracker import TagTracker
from tsd_twin.errors import TwinError
from tsd_twin.lie import wrap

VIEW = View(
    Lens(640, 360, np.array([555.0, 552.0, 321.0, 178.0, -0.08, 0.02, 0.0005, -0.0005])),
    CameraPlace.looking_at(np.array([0.1, -0.1, 1.4]), np.zeros(3)),
)
TAG = Tag(3, 0.16, "tsd", 0.3, 0.02, -0.01, 0.4)
BODY = Body([cylinder(0.2, 0.29)], [TAG])
CAMERA = SimulatedCamera(VIEW)


def seen_by(picture, tag=TAG):
    return TagTracker(CameraSetup(VIEW.lens, VIEW.place, tags=(tag,))).observe(picture, 0.0)


@pytest.mark.parametrize("seed", range(3))
def test_poses_are_within_a_fifth_of_a_millimetre(seed):
    poses = np.random.default_rng(seed).uniform([-0.25, -0.08, -3.1], [0.25, 0.08, 3.1], (30, 3))
    found = 0
    for pose in poses:
        observed = seen_by(CAMERA.draw([(BODY, [pose])]))
        for planar in observed.poses.values():
            error = planar.pose.xy_heading - pose
            assert np.hypot(*error[:2]) < 0.0002
            assert abs(wrap(error[2])) < np.radians(0.1)
            found += 1
    # OpenCV misses a few tags.
    assert found >= 0.9 * len(poses)


def test_a_tag_seen_twice_is_not_believed():
    places = [np.array([x, 0.0, 0.0]) for x in (-0.25, 0.25)]
    observed = seen_by(CAMERA.draw([(BODY, [place]) for place in places]))
    assert not observed.poses
    assert {reason for _, reason in observed.refused} == {Refusal.TWICE}


def test_a_robot_that_leans_by_half_a_radian_is_not_believed():
    observed = seen_by(CAMERA.draw([(BODY, [np.array([0.0, 0.0, 0.2, 0.5, 0.0])])]))
    assert not observed.poses


def test_a_mirrored_picture_shows_no_robot():
    picture = CAMERA.draw([(BODY, [np.zeros(3)])])
    assert seen_by(picture).poses
    assert not seen_by(np.ascontiguousarray(picture[:, ::-1])).poses


def test_a_picture_of_another_size_than_the_calibration_gives_no_poses():
    picture = CAMERA.draw([(BODY, [np.zeros(3)])])
    with pytest.raises(TwinError, match="calibrated with 640 x 360"):
        seen_by(np.ascontiguousarray(picture[::2, ::2]))


@settings(max_examples=20)
@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(0.0, 0.5))
def test_pixels_lead_back_to_the_point_that_they_show(x, y, height):
    pixels = VIEW.project(np.array([[0.3 * x, 0.2 * y, height]]))
    assert VIEW.on_plane(pixels, height)[0] == pytest.approx([0.3 * x, 0.2 * y], abs=1e-6)


def test_pixels_are_those_of_opencv():
    points = np.random.default_rng(0).uniform([-0.4, -0.3, 0.0], [0.4, 0.3, 0.5], (50, 3))
    assert VIEW.project(points) == pytest.approx(VIEW.derivatives(points)[0], abs=1e-9)


def test_a_camera_file_is_read_as_it_was_written(tmp_path):
    covariance = np.diag(np.arange(1.0, 15.0))
    setup = CameraSetup(VIEW.lens, VIEW.place, covariance, (TAG, Tag(100, 0.1)), exposure_s=0.01)
    write_setup(tmp_path / "camera.toml", setup)
    again = read_setup(tmp_path / "camera.toml")
    assert again.view.parameters == pytest.approx(setup.view.parameters, rel=1e-8)
    assert again.covariance == pytest.approx(covariance)
    assert [tag.number for tag in again.tags] == [3, 100]
    assert again.tags[0].heading_rad == pytest.approx(TAG.heading_rad)


def test_a_misspelt_key_of_a_camera_file_is_refused(tmp_path):
    path = tmp_path / "camera.toml"
    write_setup(path, CameraSetup(VIEW.lens))
    path.write_text(path.read_text().replace("delay_s", "delay_ms"))
    with pytest.raises(TwinError, match="delay_ms"):
        read_setup(path)


def test_the_squares_of_a_printed_board_are_the_picture_that_is_searched():
    board = Board()
    picture = np.full((900, 1260), 255, np.uint8)
    for left, top, side in board.squares():
        corner, end = np.rint([5 * left, 5 * top]), np.rint([5 * (left + side), 5 * (top + side)])
        cv2.rectangle(picture, corner.astype(int), end.astype(int) - 1, 0, -1)
    found = board.find(np.pad(picture, 60, constant_values=255))
    assert found is not None
    points, pixels = found
    assert len(points) == (board.columns - 1) * (board.rows - 1)
    assert np.abs((pixels - 59.5) / 5000.0 - points[:, :2]).max() < 5e-4


def test_a_tag_that_does_not_fit_on_the_paper_is_refused():
    assert tags_pdf([Tag(3, 0.16)]).startswith(b"%PDF-1.4")
    assert b"/PrintScaling /None" in board_pdf(Board())
    with pytest.raises(TwinError, match="do not fit"):
        tags_pdf([Tag(3, 0.3)])
