"""Each client's view shows only the robot and settings of its page."""

from __future__ import annotations

import numpy as np
import pytest

from tests.dashboard.scene.view_desk import OTHER_PAGE, PAGE, ViewDesk
from tests.support.scene_doubles import RobotFeed
from tests.support.viser_client import Node, ViserClient, chosen
from tests.support.withheld import PATIENCE_S
from tsd_twin import robots
from tsd_twin.dashboard.scene.appearance import METRES
from tsd_twin.dashboard.scene.viser_compat import page_of
from tsd_twin.dashboard.wire.view import CameraPreset, Layer, TruePoseDisplay, ViewSettings
from tsd_twin.lie import SO3


def test_a_client_without_a_graphics_card_gets_cheap_light(
    desk: ViewDesk, viewer: ViserClient
) -> None:
    with desk.opened(OTHER_PAGE, plain=True) as plain:
        latest = {message["type"]: message for message in plain.messages}
        assert not latest["EnableLightsMessage"]["enabled"]
        assert not plain.own["/stage/key"].props["cast_shadow"]
        assert latest["EnvironmentMapMessage"]["hdri_data"] is None
        lights = [name for name, node in plain.own.items() if node.kind == "AmbientLightMessage"]
        assert len(lights) == 1
        sent = len(plain.messages)
        desk.scene.add(RobotFeed("other"))  # The nodes of each client are created again.
        plain.until(lambda: any(m.get("name") == lights[0] for m in plain.messages[sent:]))
        plain.until(lambda: plain.own[lights[0]].props["intensity"] > 0.0)
    assert viewer.own["/stage/key"].props["cast_shadow"]


def test_a_page_hides_layers_in_its_own_view(
    desk: ViewDesk, viewer: ViserClient, onlooker: ViserClient
) -> None:
    nodes = {
        Layer.SETPOINT: "/w/r/tsd/s",
        Layer.TRAIL: "/w/k",
        Layer.REGION: "/w/r/tsd/e",
        Layer.LABELS: METRES,
        Layer.ARROWS: "/w/r/tsd/a",
    }
    for layer, node in nodes.items():
        desk.apply(hidden=[layer])
        viewer.until(lambda node=node: not viewer.own[node].visible)
    desk.apply(hidden=list(nodes))
    viewer.until(lambda: not any(viewer.node(node).visible for node in nodes.values()))
    desk.apply(hidden=[layer for layer in nodes if layer is not Layer.TRAIL])
    viewer.until(lambda: "/w/k" not in viewer.own)
    assert not viewer.node("/w/r/tsd/s").visible
    assert chosen(onlooker) == {}


def test_a_page_shows_the_true_pose_always_or_never(
    desk: ViewDesk, feed: RobotFeed, viewer: ViserClient
) -> None:
    feed.say(pose=np.zeros(3), truth=np.zeros(3))
    desk.scene.draw()
    viewer.until(lambda: not viewer.node("/w/t/tsd/dark/c").visible)
    desk.apply(true_pose=TruePoseDisplay.ALWAYS)
    viewer.until(lambda: viewer.node("/w/t/tsd/dark/c").visible)
    desk.apply(true_pose=TruePoseDisplay.NEVER)
    viewer.until(lambda: not viewer.node("/w/t").visible)
    desk.apply(true_pose=TruePoseDisplay.DIFFERS)
    viewer.until(lambda: viewer.node("/w/t").visible and not viewer.node("/w/t/tsd/dark/c").visible)


def test_colours_belong_to_the_page(
    desk: ViewDesk, viewer: ViserClient, onlooker: ViserClient
) -> None:
    desk.apply(dark=False)
    viewer.until(lambda: viewer.dark is False)
    assert onlooker.dark is True


def test_several_robots_have_names_and_rings_of_different_colours(
    desk: ViewDesk, feed: RobotFeed, viewer: ViserClient
) -> None:
    def marks(name: str) -> list[Node]:
        return [viewer.shared[f"/w/r/{name}/{mark}"] for mark in "nq"]

    viewer.until(lambda: not any(mark.visible for mark in marks(feed.id)))
    desk.scene.add(RobotFeed("bob"))
    viewer.until(lambda: all(mark.visible for name in (feed.id, "bob") for mark in marks(name)))
    colours = [tuple(marks(name)[1].props["color"]) for name in (feed.id, "bob")]
    assert len(set(colours)) == 2
    desk.scene.remove("bob")
    viewer.until(lambda: not any(mark.visible for mark in marks(feed.id)))


def test_an_unknown_robot_is_not_selected(
    desk: ViewDesk, viewer: ViserClient, onlooker: ViserClient
) -> None:
    del viewer, onlooker
    desk.scene.add(RobotFeed("bob"))
    desk.view().select_robot("bob")
    desk.view().select_robot("nobody")
    assert desk.view().robot_id == "bob"
    assert desk.view(OTHER_PAGE).robot_id == "tsd"


def test_a_new_client_shows_the_robot_of_its_page_whenever_it_is_there(desk: ViewDesk) -> None:
    desk.scene.add(RobotFeed())
    desk.robots[PAGE] = "bob"
    with desk.opened(PAGE):
        assert desk.view().robot_id == "tsd"
        for _ in range(2):
            desk.scene.add(RobotFeed("bob"))
            assert desk.view().robot_id == "bob"
            desk.scene.remove("bob")
            assert desk.view().robot_id == "tsd"


def test_a_client_that_connects_before_the_robot_shows_it(desk: ViewDesk) -> None:
    with desk.opened(PAGE) as viewer:
        assert desk.view().robot_id is None
        desk.scene.add(RobotFeed())
        viewer.until(lambda: "/w/r/tsd/mchassis" in viewer.shared)
        assert desk.view().robot_id == "tsd"


def test_a_new_client_has_the_settings_of_its_page(desk: ViewDesk) -> None:
    desk.scene.add(RobotFeed())
    desk.settings[PAGE] = ViewSettings(
        camera=CameraPreset.CHASE, hidden=[Layer.TRAIL], true_pose=TruePoseDisplay.NEVER, dark=False
    )
    with desk.opened(PAGE) as viewer:
        viewer.until(lambda: not viewer.own["/w/k"].visible and not viewer.own["/w/t"].visible)
        viewer.until(lambda: viewer.dark is False)
        viewer.until(lambda: viewer.camera["SetCameraPositionMessage"])
        assert desk.view().settings == desk.settings[PAGE]


def test_a_client_without_a_page_keeps_the_defaults(desk: ViewDesk, viewer: ViserClient) -> None:
    desk.robots[PAGE] = "bob"
    desk.scene.add(RobotFeed("bob"))
    with desk.opened(None) as stranger:
        desk.apply(hidden=[Layer.TRAIL])
        desk.view().select_robot("bob")
        viewer.until(lambda: not viewer.own["/w/k"].visible)
        assert chosen(stranger) == {}


def test_the_gateway_determines_the_page_of_a_client(desk: ViewDesk) -> None:
    for page in (PAGE, None):
        with desk.opened(page):
            (client_id,) = desk.server.get_clients()
            assert page_of(desk.server, client_id) == page
        assert page_of(desk.server, 123456) is None


def click(robot_id: str, x_m: float, y_m: float) -> dict[str, object]:
    """Return a click straight down on a sphere, in scene axes."""
    return {
        "type": "SceneNodeClickMessage",
        "name": f"/w/r/{robot_id}/x",
        "instance_index": None,
        "ray_origin": [x_m, y_m, 2.0],
        "ray_direction": [0.0, 0.0, -1.0],
        "screen_pos": [0.5, 0.5],
        "modifier": None,
        "owner": "",
    }


def test_a_click_on_the_selected_sphere_reaches_its_page(desk: ViewDesk) -> None:
    feeds = {name: RobotFeed(name, robots.load_robot("atlas")) for name in ("atlas", "other")}
    for feed in feeds.values():
        desk.scene.add(feed)
        feed.say(ball=SO3.identity())
    desk.scene.draw()
    with desk.opened(PAGE) as viewer, desk.opened(None) as stranger:
        viewer.until(lambda: "/w/r/atlas/x" in viewer.shared)
        stranger.send(click("atlas", 0.0, 0.0))  # This client has no page.
        viewer.send(click("other", 0.0, 0.0))  # Another robot is selected.
        viewer.send(click("atlas", 5.0, 0.0))  # Outside the sphere.
        viewer.send(click("atlas", 0.0, 0.0))
        page, robot_id, at = desk.points.get(timeout=PATIENCE_S)
        assert (page, robot_id) == (PAGE, "atlas")
        assert at == pytest.approx((0.0, 0.0, 1.0), abs=1e-6)
        assert desk.points.empty()
