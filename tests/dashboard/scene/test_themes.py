"""Dark and light overlays per client, and framing of the robot."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np
import pytest
import viser

from tests.support.link_sockets import eventually
from tests.support.scene_doubles import RobotFeed
from tests.support.viser_client import CAMERA, ViserClient, viser_client
from tsd_twin.dashboard.scene.appearance import Theme
from tsd_twin.dashboard.scene.client_views import ClientViews
from tsd_twin.dashboard.scene.framing import CameraPose, Rectangle, pictured
from tsd_twin.dashboard.scene.scene import Scene
from tsd_twin.dashboard.scene.viser_compat import CAMERA_OFFSET_M, FIELD_OF_VIEW_RAD, LOOK_AT_M
from tsd_twin.dashboard.wire.view import ViewSettings
from tsd_twin.lie import Array

PAGE = "00000000000000aa"
OVERLAYS = ("/w/r/tsd/a", "/w/r/tsd/d", "/w/r/tsd/e", "/w/r/tsd/b", "/w/k/tsd", "/w/t/tsd")
FREE = Rectangle(0.2, 0.1, 0.9, 0.6)


@pytest.fixture(scope="module")
def views(server: viser.ViserServer) -> Generator[ClientViews]:
    scene = Scene(server)
    feed = RobotFeed()
    scene.add(feed)
    feed.say(pose=np.array([1.0, 2.0, 0.5]))
    scene.draw()
    yield ClientViews(server, scene)
    server.scene.reset()


@pytest.fixture
def viewer(server: viser.ViserServer, views: ClientViews) -> Generator[ViserClient]:
    del views
    with viser_client(server.get_port(), PAGE) as made:
        made.until(lambda: not made.camera["SetCameraLookAtMessage"]["initial"])
        yield made


def shown(viewer: ViserClient) -> set[tuple[str, Theme]]:
    return {
        (name, theme) for name in OVERLAYS for theme in Theme if f"{name}/{theme}" in viewer.shared
    }


def test_a_client_sees_the_overlays_of_its_theme(views: ClientViews, viewer: ViserClient) -> None:
    for dark, theme in ((True, Theme.DARK), (False, Theme.LIGHT), (True, Theme.DARK)):
        views.of_page(PAGE)[0].apply(ViewSettings(dark=dark), look=False)
        expected = {(name, theme) for name in OVERLAYS}
        viewer.until(lambda expected=expected: shown(viewer) == expected)


def robot_in_picture(viewer: ViserClient, width: int = CAMERA["image_width"]) -> Array:
    position, look_at = (
        np.array(viewer.camera[f"SetCamera{kind}Message"][key])
        for kind, key in (("Position", "position"), ("LookAt", "look_at"))
    )
    aspect = width / CAMERA["image_height"]
    centre = np.array([[0.0, 0.0, 0.07]])  # The world moves so that the robot is at the origin.
    return pictured(CameraPose(position, look_at), centre, aspect, FIELD_OF_VIEW_RAD)[0]


def test_the_robot_is_framed_in_the_free_rectangle_at_first_sight_and_when_it_changes(
    views: ClientViews, viewer: ViserClient
) -> None:
    viewer.until(lambda: np.allclose(robot_in_picture(viewer), 0.5, atol=0.1))
    views.of_page(PAGE)[0].set_frame(FREE)
    viewer.until(lambda: np.allclose(robot_in_picture(viewer), (0.55, 0.35), atol=0.07))


def test_the_robot_is_framed_again_in_a_narrower_window(
    views: ClientViews, viewer: ViserClient
) -> None:
    views.of_page(PAGE)[0].set_frame(FREE)
    viewer.until(lambda: np.allclose(robot_in_picture(viewer), (0.55, 0.35), atol=0.07))
    assert viewer.camera["SetCameraFovMessage"]["fov"] == FIELD_OF_VIEW_RAD
    placed = {
        "position": viewer.camera["SetCameraPositionMessage"]["position"],
        "look_at": viewer.camera["SetCameraLookAtMessage"]["look_at"],
        "fov": FIELD_OF_VIEW_RAD,
    }
    viewer.send(CAMERA | placed | {"image_width": 400})
    viewer.until(
        lambda: viewer.camera["SetCameraPositionMessage"]["position"] != placed["position"]
    )
    viewer.until(lambda: np.allclose(robot_in_picture(viewer, 400), (0.55, 0.35), atol=0.07))


def test_a_camera_that_somebody_has_moved_stays_until_home(
    views: ClientViews, viewer: ViserClient
) -> None:
    (panel,) = views.of_page(PAGE)
    away = (3.0, 1.0, 1.0)
    viewer.send(CAMERA | {"position": list(away), "look_at": [2.0, 0.0, 0.0]})
    eventually(lambda: np.allclose(panel.client.camera.position, away))
    views.of_page(PAGE)[0].set_frame(FREE)
    np.testing.assert_allclose(panel.client.camera.position, away)
    views.of_page(PAGE)[0].apply(ViewSettings(), look=True)
    viewer.until(lambda: np.allclose(robot_in_picture(viewer), (0.55, 0.35), atol=0.07))


def test_a_client_that_resets_its_camera_to_the_start_has_it_placed_again(
    views: ClientViews, viewer: ViserClient
) -> None:
    del views
    viewer.until(lambda: np.allclose(robot_in_picture(viewer), 0.5, atol=0.1))
    placed = viewer.camera.pop("SetCameraPositionMessage")
    viewer.send(CAMERA | {"position": list(CAMERA_OFFSET_M), "look_at": list(LOOK_AT_M)})
    viewer.until(lambda: viewer.camera.get("SetCameraPositionMessage") == placed)
