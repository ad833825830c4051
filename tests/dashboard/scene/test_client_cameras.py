"""Per-client cameras: presets, follow and chase, and selection of the robot in view."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.dashboard.scene.view_desk import PAGE, ViewDesk
from tests.support.link_sockets import eventually
from tests.support.scene_doubles import RobotFeed
from tests.support.viser_client import CAMERA, ViserClient, chosen
from tsd_twin.dashboard.scene.framing import CameraPose, ClientCamera, Rectangle, pictured
from tsd_twin.dashboard.scene.viser_compat import FIELD_OF_VIEW_RAD
from tsd_twin.dashboard.wire.view import CameraPreset, Layer
from tsd_twin.lie import SE2

PLACES = {"tsd": (0.0, 0.0), "bob": (1.0, 0.5), "eve": (0.0, -1.0), "zero": (0.0, 0.0)}


def seen_at(viewer: ViserClient, point: tuple[float, float]) -> Any:
    """Return the image coordinates (2,) of a floor point of the scene."""
    position = np.array(viewer.camera["SetCameraPositionMessage"]["position"])
    look_at = np.array(viewer.camera["SetCameraLookAtMessage"]["look_at"])
    aspect = CAMERA["image_width"] / CAMERA["image_height"]
    pose = CameraPose(position, look_at)
    return pictured(pose, np.array([[*point, 0.05]]), aspect, FIELD_OF_VIEW_RAD)[0]


def test_the_selected_robot_keeps_its_place_in_the_scene(
    desk: ViewDesk, feed: RobotFeed, viewer: ViserClient
) -> None:
    del feed
    bob = RobotFeed("bob")
    desk.scene.add(bob)
    desk.view().select_robot("bob")
    for x in (1.0, 2.0):
        bob.say(pose=np.array([x, 0.5, 0.0]))
        desk.scene.draw()
        viewer.until(lambda x=x: np.allclose(viewer.node("/w").position, (-x, -0.5, 0.0)))


@pytest.mark.parametrize("hidden", [(), (Layer.TRAIL,)])
def test_the_selected_robot_is_in_view_regardless_of_earlier_selections(
    desk: ViewDesk, feed: RobotFeed, viewer: ViserClient, hidden: Sequence[Layer]
) -> None:
    """From each robot to each other one, with two robots in one place and a hidden layer."""
    for name, place in PLACES.items():
        robot = feed if name == feed.id else RobotFeed(name)
        if robot is not feed:
            desk.scene.add(robot)
        robot.say(pose=np.array([*place, 0.0]))
    desk.scene.draw()
    desk.apply(hidden=hidden)
    viewer.until(lambda: viewer.node("/w/k").visible is not bool(hidden))
    for names in itertools.permutations(PLACES, 2):
        for name in names:
            desk.view().select_robot(name)
            x, y = PLACES[name]
            viewer.until(lambda x=x, y=y: np.allclose(viewer.node("/w").position, (-x, -y, 0.0)))


def test_a_camera_that_was_moved_away_frames_the_next_robot(
    desk: ViewDesk, viewer: ViserClient
) -> None:
    bob = RobotFeed("bob")
    desk.scene.add(bob)
    bob.say(pose=np.array([5.0, 2.0, 0.0]))
    desk.scene.draw()
    desk.apply(follow=False)
    viewer.until(lambda: "/w" in chosen(viewer))
    away = (3.0, 1.0, 1.0)
    viewer.send(CAMERA | {"position": list(away), "look_at": [2.0, 0.0, 0.0]})
    eventually(lambda: np.allclose(desk.view().client.camera.position, away))
    viewer.camera.clear()
    desk.view().select_robot("bob")
    viewer.until(lambda: np.allclose(seen_at(viewer, (0.0, 0.0)), 0.5, atol=0.1))


def test_a_scene_counts_as_complete_only_when_its_client_reports_the_placed_camera(
    desk: ViewDesk,
) -> None:
    """A slow browser receives the scene long after it was sent, and is black before."""
    feed = RobotFeed()
    desk.scene.add(feed)
    feed.say(pose=np.zeros(3))
    desk.scene.draw()
    with desk.opened(PAGE) as viewer:
        desk.scene.draw()
        viewer.until(lambda: len(viewer.camera) >= 2)
        view = desk.view()
        assert view.camera_state is None, "sent, and not reported"
        placed = {
            key: list(viewer.camera[f"SetCamera{name}Message"][key])
            for key, name in (("position", "Position"), ("look_at", "LookAt"))
        }
        viewer.send(CAMERA | placed)
        eventually(lambda: view.camera_state is not None)


def test_a_new_client_frames_the_robot_in_the_free_part_of_its_page(desk: ViewDesk) -> None:
    feed = RobotFeed()
    desk.scene.add(feed)
    feed.say(pose=np.array([1.0, 2.0, 0.5]))
    desk.scene.draw()
    desk.frames[PAGE] = Rectangle(0.2, 0.1, 0.9, 0.6)
    with desk.opened(PAGE) as viewer:
        viewer.until(lambda: np.allclose(seen_at(viewer, (0.0, 0.0)), (0.55, 0.35), atol=0.07))


def test_a_client_that_does_not_follow_sees_the_robot_drive_away(
    desk: ViewDesk, feed: RobotFeed, viewer: ViserClient, onlooker: ViserClient
) -> None:
    def say(x: float) -> None:
        feed.say(pose=np.array([x, 0.0, 0.0]))
        desk.scene.draw()
        onlooker.until(lambda: np.allclose(onlooker.node("/w").position, (-x, 0.0, 0.0)))

    say(1.0)
    desk.apply(follow=False)
    viewer.until(lambda: np.allclose(viewer.own["/w"].position, (-1.0, 0.0, 0.0)))
    say(2.0)
    assert np.allclose(viewer.node("/w").position, (-1.0, 0.0, 0.0))
    desk.apply(follow=True)
    viewer.until(lambda: np.allclose(viewer.node("/w").position, (-2.0, 0.0, 0.0)))
    say(3.0)
    viewer.until(lambda: np.allclose(viewer.node("/w").position, (-3.0, 0.0, 0.0)))


@pytest.mark.parametrize("side", list(CameraPreset))
def test_a_preset_turns_the_camera_to_the_robot(
    desk: ViewDesk, feed: RobotFeed, viewer: ViserClient, side: CameraPreset
) -> None:
    heading = 0.5 * math.pi
    feed.say(pose=np.array([4.0, 0.0, heading]))
    desk.scene.draw()
    desk.apply(follow=False)
    viewer.until(lambda: "/w" in chosen(viewer))
    feed.say(pose=np.array([5.0, 0.0, heading]))
    desk.scene.draw()
    viewer.camera.clear()
    desk.apply(follow=False, camera=side, look=True)
    viewer.until(lambda: viewer.camera["SetCameraLookAtMessage"])
    eye = np.array(viewer.camera["SetCameraPositionMessage"]["position"])
    # One metre outside the world.
    np.testing.assert_allclose(seen_at(viewer, (1.0, 0.0)), 0.5, atol=0.1)
    assert eye[2] > 0.2
    if side is not CameraPreset.TOP:  # Behind the robot.
        np.testing.assert_allclose(eye[0], 1.0, atol=1e-6)
        assert eye[1] < -0.5


def in_scene(viewer: ViserClient, point: Sequence[float]) -> np.ndarray:
    """Return the scene coordinates (2,) of a point in `odom`."""
    world = viewer.node("/w")
    half = math.atan2(world.wxyz[3], world.wxyz[0])
    return SE2(np.array([*world.position[:2], 2.0 * half])).transform(np.array(point))


def test_chase_turns_the_world_under_the_robot_and_places_are_picked_in_it(
    desk: ViewDesk, feed: RobotFeed, viewer: ViserClient
) -> None:
    pose = SE2(np.array([2.0, -1.0, 0.7]))
    moved, ahead = pose, pose.xy_heading[:2]

    def say(pose: SE2) -> None:
        feed.say(pose=pose.xy_heading)
        desk.scene.draw()

    say(pose)
    desk.apply(camera=CameraPreset.CHASE, look=True)
    turns = [0.0, 1.2, -3.0]
    for moved in [pose.plus(np.array([0.3, 0.1, turn])) for turn in turns]:
        say(moved)
        ahead = moved.transform(np.array([0.5, 0.0]))
        viewer.until(lambda at=ahead: np.allclose(in_scene(viewer, at), (0.5, 0.0), atol=1e-5))
        np.testing.assert_allclose(in_scene(viewer, moved.xy_heading[:2]), (0.0, 0.0), atol=1e-5)
    # A camera straight above a point 0.5 m ahead picks that point.
    above = {"position": [0.5, 0.0, 2.0], "wxyz": [0.0, 1.0, 0.0, 0.0]}
    viewer.send(CAMERA | above)
    middle = np.array([[0.5, 0.5]])
    eventually(lambda: np.allclose(desk.views.pick_floor(PAGE, middle), [ahead], atol=1e-5))
    # Afterwards the world has no rotation, even if that requires sending a zero rotation.
    desk.apply(camera=CameraPreset.TOP, look=True)
    viewer.until(lambda: np.allclose(viewer.node("/w").wxyz, (1.0, 0.0, 0.0, 0.0)))
    np.testing.assert_allclose(in_scene(viewer, moved.xy_heading[:2]), (0.0, 0.0), atol=1e-5)
    desk.apply(camera=CameraPreset.CHASE, look=True)
    viewer.until(lambda: not np.allclose(viewer.node("/w").wxyz, (1.0, 0.0, 0.0, 0.0)))
    desk.apply(camera=CameraPreset.CHASE, follow=False)  # Only a camera in follow mode turns along.
    viewer.until(lambda: np.allclose(viewer.node("/w").wxyz, (1.0, 0.0, 0.0, 0.0)))


def test_labels_have_their_size_in_pixels_of_the_page_else_of_the_canvas() -> None:
    """The device pixel ratio may be above or below 1."""

    def px_per_m(image_height: float, picture_px: float = 0.0) -> float:
        client: Any = SimpleNamespace(camera=SimpleNamespace(image_height=image_height))
        return ClientCamera(client, Rectangle(picture_px=picture_px)).px_per_m

    assert px_per_m(1440) == pytest.approx(2.0 * px_per_m(720))
    for of_canvas in (360, 720, 1440, math.nan):
        assert px_per_m(of_canvas, 720.0) == px_per_m(720)
    assert 0.0 < px_per_m(math.nan) < math.inf
    assert px_per_m(-1.0) > 0.0
