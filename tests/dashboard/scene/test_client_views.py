"""What clients do in their panels, and what each of them alone is shown for it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from queue import SimpleQueue
from typing import Any

import msgspec
import numpy as np
import pytest
import viser
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.link_sockets import eventually
from tests.support.robot_feed import RobotFeed, link_poses
from tests.support.viser_client import CAMERA, PATIENCE_S, Node, ViserClient, chosen, viser_client
from tsd_twin.dashboard.scene import viser_compat
from tsd_twin.dashboard.scene.appearance import METRES
from tsd_twin.dashboard.scene.client_views import ClientViews
from tsd_twin.dashboard.scene.framing import CameraPose, pictured
from tsd_twin.dashboard.scene.robot_visual import exaggerate_tilt
from tsd_twin.dashboard.scene.scene import Scene
from tsd_twin.dashboard.scene.viser_compat import page_of
from tsd_twin.dashboard.wire.view import CameraPreset, Layer, TruePoseDisplay, ViewSettings
from tsd_twin.lie import SE2
from tsd_twin.robots import load_robot

PAGE, OTHER_PAGE = "0123456789abcdef", "fedcba9876543210"
SLIDERS = ("Forward (m/s)", "Left (m/s)", "Turn left (rad/s)")
GIMBALS = ("outer", "inner", "wheel")


@dataclass
class Desk:
    """A scene with panels, and what they have told."""

    server: viser.ViserServer
    scene: Scene
    moves: SimpleQueue[tuple[Any, ...]] = field(default_factory=SimpleQueue)
    choices: SimpleQueue[tuple[str, str]] = field(default_factory=SimpleQueue)
    points: SimpleQueue[tuple[Any, ...]] = field(default_factory=SimpleQueue)
    views: SimpleQueue[tuple[str, ViewSettings]] = field(default_factory=SimpleQueue)
    kept: dict[str, ViewSettings] = field(default_factory=dict[str, ViewSettings])
    """View settings of pages, by their id."""
    gone: SimpleQueue[int] = field(default_factory=SimpleQueue)
    shown: dict[str, str] = field(default_factory=dict[str, str])
    """What pages show, by their id."""

    def __post_init__(self) -> None:
        self.panels = ClientViews(
            self.server,
            self.scene,
            lambda *move: self.moves.put(move),
            lambda page, robot: self.choices.put((page, robot)),
            lambda *point: self.points.put(point),
            robot_of=self.shown.get,
            on_view=lambda *view: self.views.put(view),
            view_of=self.kept.get,
        )
        self.server.on_client_disconnect(self._note)

    async def _note(self, client: viser.ClientHandle) -> None:
        self.gone.put(client.client_id)

    def move(self) -> tuple[Any, ...]:
        return self.moves.get(timeout=PATIENCE_S)


@pytest.fixture(scope="module")
def made() -> Generator[Desk]:
    server = viser_compat.start_server("test")
    yield Desk(server, Scene(server))
    server.stop()


@pytest.fixture
def desk(made: Desk) -> Generator[Desk]:
    yield made
    for robot_id in list(made.scene.visuals):
        made.scene.remove(robot_id)


@pytest.fixture
def feed(desk: Desk) -> RobotFeed:
    robot = RobotFeed()
    desk.scene.add(robot)
    return robot


@pytest.fixture
def viewer(desk: Desk, feed: RobotFeed) -> Generator[ViserClient]:
    del feed  # The robot is there before the client.
    with opened(desk, PAGE) as client:
        yield client


@pytest.fixture
def onlooker(desk: Desk, viewer: ViserClient) -> Generator[ViserClient]:
    del viewer
    with opened(desk, OTHER_PAGE) as client:
        yield client


@contextmanager
def opened(desk: Desk, page: str | None, *, plain: bool = False) -> Generator[ViserClient]:
    """A client with a panel, that the server has forgotten when this ends."""
    with viser_client(desk.server.get_port(), page, plain=plain) as viewer:
        viewer.until(lambda: viewer.control("dark"))
        yield viewer
    desk.gone.get(timeout=PATIENCE_S)


def hidden(viewer: ViserClient, kind: str) -> list[bool]:
    """Whether each link of a kind is hidden from this client."""
    (node,) = (node for name, node in viewer.shared.items() if name.endswith(f"/m{kind}"))
    scales = node.props["batched_scales"]
    return [] if scales is None else [bool(scale == 0.0) for scale in scales]


def tried(viewer: ViserClient, kind: str) -> Node:
    return viewer.own[f"/w/r/tsd/p{kind}"]


def test_who_draws_without_a_graphics_card_gets_light_that_costs_little(
    desk: Desk, viewer: ViserClient
) -> None:
    with opened(desk, OTHER_PAGE, plain=True) as plain:
        told = {message["type"]: message for message in plain.messages}
        assert not told["EnableLightsMessage"]["enabled"]
        assert not plain.own["/stage/key"].props["cast_shadow"]
        assert told["EnvironmentMapMessage"]["hdri_data"] is None
        lights = [name for name, node in plain.own.items() if node.kind == "AmbientLightMessage"]
        assert len(lights) == 1
        sent = len(plain.messages)
        desk.scene.add(RobotFeed("other"))  # The nodes of each client are made anew.
        plain.until(lambda: any(m.get("name") == lights[0] for m in plain.messages[sent:]))
        plain.until(lambda: plain.own[lights[0]].props["intensity"] > 0.0)
    assert viewer.own["/stage/key"].props["cast_shadow"]


def test_every_control_has_a_label_and_a_hint(viewer: ViserClient) -> None:
    controls = [c for c in viewer.controls.values() if c.kind != "GuiTabGroupMessage"]
    inputs = [c for c in controls if c.kind not in ("GuiHtmlMessage", "GuiMarkdownMessage")]
    assert len(inputs) >= 15
    for control in inputs:
        assert control.props["label"], control
        assert control.props["hint"], control


def test_the_page_finds_the_places_it_draws_in(viewer: ViserClient) -> None:
    content = [c.props["content"] for c in viewer.controls.values() if c.kind == "GuiHtmlMessage"]
    assert content == [
        f'<div data-tsd="{name}"></div>'
        for name in (
            "wheel_speed",
            "route",
            "joints",
            "presets",
            "page",
            "plots",
            "health",
            "student",
        )
    ]
    (tabs,) = (c for c in viewer.controls.values() if c.kind == "GuiTabGroupMessage")
    labels = ["Drive", "Gimbals", "View", "Plots", "Health", "Student"]
    assert list(tabs.props["_tab_labels"]) == labels


def test_sliders_have_the_limits_of_the_robot(viewer: ViserClient, feed: RobotFeed) -> None:
    limits = feed.robot.limits
    ends = [limits.speed_mps, limits.speed_mps, limits.turn_rate_rad_per_s]
    for label, end in zip(SLIDERS, ends, strict=True):
        assert viewer.control(label).props["max"] == end
        assert viewer.control(label).props["min"] == -end


def test_a_slider_tells_the_page_that_it_is_on(
    desk: Desk, viewer: ViserClient, onlooker: ViserClient
) -> None:
    viewer.set("Forward (m/s)", 0.5)
    assert desk.move() == (PAGE, 0.5, 0.0, 0.0, "preview", False)
    onlooker.set("Turn left (rad/s)", -1.0)
    assert desk.move() == (OTHER_PAGE, 0.0, 0.0, -1.0, "preview", False)
    viewer.set("Keep value", True)
    assert desk.move() == (PAGE, 0.5, 0.0, 0.0, "preview", True)


def test_a_change_of_mode_zeroes_the_sliders_first(desk: Desk, viewer: ViserClient) -> None:
    """So a robot never starts to move by a click on a word."""
    viewer.set("Forward (m/s)", 0.5)
    desk.move()
    viewer.set("Mode", "drive")
    assert desk.move() == (PAGE, 0.0, 0.0, 0.0, "drive", False)
    viewer.until(lambda: viewer.control("Forward (m/s)").value == 0.0)
    viewer.set("Left (m/s)", -0.25)
    assert desk.move() == (PAGE, 0.0, -0.25, 0.0, "drive", False)


def test_zero_is_all_sliders_at_once(desk: Desk, viewer: ViserClient) -> None:
    for label in SLIDERS:
        viewer.set(label, 0.25)
        desk.move()
    viewer.set("Zero", True)
    assert desk.move() == (PAGE, 0.0, 0.0, 0.0, "preview", False)
    viewer.until(lambda: all(viewer.control(label).value == 0.0 for label in SLIDERS))


def test_a_page_that_lets_go_springs_its_own_sliders_back(
    desk: Desk, viewer: ViserClient, onlooker: ViserClient
) -> None:
    for client in (viewer, onlooker):
        client.set("Forward (m/s)", 0.5)
        desk.move()
    desk.panels.reset_sliders(PAGE)
    viewer.until(lambda: viewer.control("Forward (m/s)").value == 0.0)
    assert onlooker.control("Forward (m/s)").value == 0.5
    assert desk.moves.empty()  # It was the page that let go: it knows.


@settings(deadline=None, max_examples=40)
@given(numbers=st.lists(st.floats(), min_size=3, max_size=3))
def test_no_client_can_ask_for_more_than_the_limits(made: Desk, numbers: list[float]) -> None:
    """A client may send what no slider can: not a number, no end, or far too much."""
    robot = RobotFeed()
    if robot.id not in made.scene.visuals:
        made.scene.add(robot)
    with opened(made, PAGE) as viewer:
        viewer.set("Keep value", True)
        made.move()
        for label, number in zip(SLIDERS, numbers, strict=True):
            viewer.set(label, number)
        viewer.set("Keep value", False)
        while (move := made.move())[-1]:
            pass
    _, vx, vy, omega, _, _ = move
    limits = robot.robot.limits
    assert math.hypot(vx, vy) <= limits.speed_mps * (1.0 + 1e-9)
    assert abs(omega) <= limits.turn_rate_rad_per_s * (1.0 + 1e-9)


def test_a_mode_that_there_is_not_is_no_driving(desk: Desk, viewer: ViserClient) -> None:
    viewer.set("Mode", "ludicrous")
    viewer.set("Forward (m/s)", 0.25)
    assert desk.move()[-2] == "preview"
    viewer.set("Mode", "drive")
    assert desk.move()[-2] == "drive"


def test_preview_shows_its_own_gimbals_to_its_own_client(
    desk: Desk, feed: RobotFeed, viewer: ViserClient, onlooker: ViserClient
) -> None:
    viewer.set("Turn left (rad/s)", 1.5)
    desk.move()
    k = feed.kinematics.modules
    viewer.until(lambda: all(hidden(viewer, kind) == [True] * k for kind in GIMBALS))
    joints = exaggerate_tilt(feed.kinematics.inverse(np.array([0.0, 0.0, 1.5])), 5.0)
    poses = link_poses(feed.robot, SE2.identity(), joints)
    for kind in GIMBALS:
        assert tried(viewer, kind).visible
        shown = np.reshape(tried(viewer, kind).props["batched_wxyzs"], (-1, 4))
        np.testing.assert_allclose(shown, poses[kind].wxyz, atol=1e-6)
    # Nothing of it is for others, nor for who comes later.
    assert chosen(onlooker) == {}
    assert onlooker.shared["/w/r/tsd/mouter"].props["batched_scales"] is None


def test_the_live_gimbals_come_back(desk: Desk, feed: RobotFeed, viewer: ViserClient) -> None:
    viewer.set("Forward (m/s)", 0.5)
    desk.move()
    viewer.until(lambda: tried(viewer, "wheel").visible)
    desk.panels.reset_sliders(PAGE)
    viewer.until(lambda: not tried(viewer, "wheel").visible)
    viewer.until(lambda: not any(any(hidden(viewer, kind)) for kind in GIMBALS))
    # All the while they were live.
    joints = feed.kinematics.inverse(np.array([0.2, 0.1, 0.0]))
    feed.say(joints=joints)
    desk.scene.draw()
    poses = link_poses(feed.robot, SE2.identity(), exaggerate_tilt(joints, 5.0))["inner"]
    viewer.until(
        lambda: np.allclose(
            np.reshape(viewer.shared["/w/r/tsd/minner"].props["batched_wxyzs"], (-1, 4)),
            poses.wxyz,
            atol=1e-6,
        )
    )


def enlarged(viewer: ViserClient, kind: str) -> Node:
    return viewer.own[f"/w/r/tsd/q{kind}"]


def test_exaggerated_tilt_is_drawn_and_labelled_for_its_own_client(
    desk: Desk, feed: RobotFeed, viewer: ViserClient, onlooker: ViserClient
) -> None:
    k = feed.kinematics.modules
    viewer.set("tilt drawn", "x10")
    viewer.until(lambda: all(hidden(viewer, kind) == [True] * k for kind in GIMBALS))
    for vx_mps in (0.2, 0.5):
        joints = feed.kinematics.inverse(np.array([vx_mps, 0.0, 0.0]))
        feed.say(joints=joints, setpoint=joints)
        desk.scene.draw()
        tilted = exaggerate_tilt(joints, 10.0)
        assert feed.kinematics.tilt(tilted) == pytest.approx(10.0 * feed.kinematics.tilt(joints))
        poses = link_poses(feed.robot, SE2.identity(), tilted)
        viewer.until(
            lambda poses=poses: np.allclose(
                np.reshape(enlarged(viewer, "inner").props["batched_wxyzs"], (-1, 4)),
                poses["inner"].wxyz,
                atol=1e-6,
            )
        )
    # The shared rings show the true set-point; this client has its own instead.
    assert not viewer.own["/w/r/tsd/s"].visible
    assert "/w/r/tsd/qs/s" in viewer.own
    assert "/w/r/tsd/qd/r" in viewer.own
    assert chosen(onlooker) == {}
    viewer.set("tilt drawn", "x5")
    viewer.until(lambda: chosen(viewer) == {})
    viewer.until(lambda: not any(any(hidden(viewer, kind)) for kind in GIMBALS))


def test_a_preview_is_exaggerated_too_and_the_live_gimbals_come_back_after_it(
    desk: Desk, feed: RobotFeed, viewer: ViserClient
) -> None:
    viewer.set("tilt drawn", "x3")
    viewer.until(lambda: enlarged(viewer, "inner").visible)
    viewer.set("Forward (m/s)", 0.5)
    desk.move()
    joints = exaggerate_tilt(feed.kinematics.inverse(np.array([0.5, 0.0, 0.0])), 3.0)
    poses = link_poses(feed.robot, SE2.identity(), joints)
    viewer.until(lambda: tried(viewer, "inner").visible and not enlarged(viewer, "inner").visible)
    shown = np.reshape(tried(viewer, "inner").props["batched_wxyzs"], (-1, 4))
    np.testing.assert_allclose(shown, poses["inner"].wxyz, atol=1e-6)
    desk.panels.reset_sliders(PAGE)
    viewer.until(lambda: enlarged(viewer, "inner").visible and not tried(viewer, "inner").visible)
    # The true ones stay hidden beside the enlarged ones.
    viewer.until(lambda: hidden(viewer, "inner") == [True] * feed.kinematics.modules)


def test_a_factor_that_there_is_not_and_a_robot_without_gimbals_change_nothing(
    desk: Desk, viewer: ViserClient, feed: RobotFeed
) -> None:
    viewer.set("tilt drawn", "x1000000")
    viewer.set("Forward (m/s)", 0.25)
    desk.move()
    assert not any("/q" in name for name in viewer.own)
    desk.scene.remove(feed.id)
    assert viewer.control("tilt drawn").props["visible"]
    desk.scene.add(RobotFeed("kiwi", load_robot("kiwi")))
    viewer.until(lambda: not viewer.control("tilt drawn").props["visible"])
    viewer.set("tilt drawn", "x10")
    viewer.until(lambda: viewer.control("Forward (m/s)").props["max"] == 0.8)
    viewer.set("Forward (m/s)", 0.5)
    desk.move()
    assert not any("/q" in name for name in viewer.own)


def test_mode_drive_shows_no_preview(desk: Desk, viewer: ViserClient) -> None:
    viewer.set("Mode", "drive")
    desk.move()
    viewer.set("Forward (m/s)", 0.5)
    desk.move()
    assert chosen(viewer) == {}


def test_preview_hides_the_gimbals_of_its_robot_only(
    desk: Desk, feed: RobotFeed, viewer: ViserClient
) -> None:
    viewer.set("Forward (m/s)", 0.5)
    desk.move()
    k = feed.kinematics.modules
    viewer.until(lambda: hidden(viewer, "outer") == [True] * k)
    desk.scene.add(RobotFeed("bob"))
    viewer.until(lambda: hidden(viewer, "outer") == [True] * k + [False] * k)
    desk.scene.remove(feed.id)
    viewer.until(lambda: "/w/r/bob/mouter" in viewer.shared and not any(hidden(viewer, "outer")))


def test_a_client_that_comes_before_the_robot_gets_its_sliders_with_it(desk: Desk) -> None:
    with opened(desk, PAGE) as viewer:
        assert viewer.control("Forward (m/s)").props["disabled"]
        desk.scene.add(RobotFeed())
        viewer.until(lambda: not viewer.control("Turn left (rad/s)").props["disabled"])
        viewer.until(lambda: viewer.control("Turn left (rad/s)").props["max"] == 3.0)


def test_robots_can_be_chosen_when_there_are_several(desk: Desk, viewer: ViserClient) -> None:
    assert not viewer.control("Robot").props["visible"]
    bob = RobotFeed("bob")
    desk.scene.add(bob)
    viewer.until(lambda: viewer.control("Robot").props["visible"])
    viewer.until(lambda: list(viewer.control("Robot").props["options"]) == ["tsd", "bob"])
    viewer.set("Robot", "bob")
    assert desk.choices.get(timeout=PATIENCE_S) == (PAGE, "bob")
    # The world of this client now keeps bob in its place.
    for x in (1.0, 2.0):
        bob.say(pose=np.array([x, 0.5, 0.0]))
        desk.scene.draw()
        viewer.until(lambda x=x: np.allclose(viewer.node("/w").position, (-x, -0.5, 0.0)))


PLACES = {"tsd": (0.0, 0.0), "bob": (1.0, 0.5), "eve": (0.0, -1.0), "zero": (0.0, 0.0)}


@pytest.mark.parametrize("hides", [False, True])
def test_the_robot_that_is_chosen_is_in_view_whatever_was_chosen_before(
    desk: Desk, feed: RobotFeed, viewer: ViserClient, hides: bool
) -> None:
    """From each robot to each other one, with two of them in one place, and a hidden layer."""
    for name, place in PLACES.items():
        robot = feed if name == feed.id else RobotFeed(name)
        if robot is not feed:
            desk.scene.add(robot)
        robot.say(pose=np.array([*place, 0.0]))
    desk.scene.draw()
    if hides:
        viewer.set("trail", False)
        viewer.until(lambda: not viewer.node("/w/k").visible)
    for names in itertools.permutations(PLACES, 2):
        for name in names:
            desk.panels.select_robot(PAGE, name)
            viewer.until(lambda name=name: viewer.control("Robot").value == name)
            x, y = PLACES[name]
            viewer.until(lambda x=x, y=y: np.allclose(viewer.node("/w").position, (-x, -y, 0.0)))


def seen_at(viewer: ViserClient, point: tuple[float, float]) -> Any:
    """Place (2,) in the picture of a point on the floor of the scene."""
    position = np.array(viewer.camera["SetCameraPositionMessage"]["position"])
    look_at = np.array(viewer.camera["SetCameraLookAtMessage"]["look_at"])
    aspect = CAMERA["image_width"] / CAMERA["image_height"]
    pose = CameraPose(position, look_at)
    return pictured(pose, np.array([[*point, 0.05]]), aspect, CAMERA["fov"])[0]


def test_a_camera_that_was_moved_away_frames_the_robot_that_is_chosen(
    desk: Desk, viewer: ViserClient
) -> None:
    bob = RobotFeed("bob")
    desk.scene.add(bob)
    bob.say(pose=np.array([5.0, 2.0, 0.0]))
    desk.scene.draw()
    viewer.set("follow", False)
    viewer.until(lambda: "/w" in chosen(viewer))
    away = {"position": [3.0, 1.0, 1.0], "look_at": [2.0, 0.0, 0.0]}
    viewer.send(CAMERA | away)
    viewer.set("Forward (m/s)", 0.5)
    desk.move()  # The camera has come before.
    viewer.camera.clear()
    desk.panels.select_robot(PAGE, "bob")
    viewer.until(lambda: np.allclose(seen_at(viewer, (0.0, 0.0)), 0.5, atol=0.1))


def test_several_robots_have_names_and_rings_of_different_colours(
    desk: Desk, feed: RobotFeed, viewer: ViserClient
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


def test_a_robot_chosen_elsewhere_in_the_page_is_chosen_here(
    desk: Desk, viewer: ViserClient
) -> None:
    desk.scene.add(RobotFeed("bob"))
    viewer.set("Forward (m/s)", 0.5)
    desk.move()
    desk.panels.select_robot(PAGE, "bob")
    viewer.until(lambda: viewer.control("Robot").value == "bob")
    viewer.until(lambda: viewer.control("Forward (m/s)").value == 0.0)
    assert desk.choices.empty()
    desk.panels.select_robot(PAGE, "nobody")
    assert viewer.control("Robot").value == "bob"


def test_a_panel_has_the_robot_of_its_page_as_soon_as_it_is_there(
    desk: Desk, feed: RobotFeed
) -> None:
    """Else its sliders would be those of another robot than the one that they drive."""
    del feed
    desk.shown[PAGE] = "bob"
    with opened(desk, PAGE) as viewer:
        for _ in range(2):
            desk.scene.add(RobotFeed("bob"))
            viewer.until(lambda: viewer.control("Robot").value == "bob")
            desk.scene.remove("bob")
            viewer.until(lambda: viewer.control("Robot").value == "tsd")
    desk.shown.clear()
    assert desk.choices.empty()


def test_each_client_hides_what_it_likes(
    desk: Desk, viewer: ViserClient, onlooker: ViserClient
) -> None:
    nodes = {
        "set-point": "/w/r/tsd/s",
        "trail": "/w/k",
        "region of the pose": "/w/r/tsd/e",
        "labels": METRES,
        "thrust arrows": "/w/r/tsd/a",
    }
    for label, node in nodes.items():
        viewer.set(label, False)
        viewer.until(lambda node=node: not viewer.own[node].visible)
    viewer.set("trail", True)
    viewer.until(lambda: "/w/k" not in viewer.own)
    assert not viewer.node("/w/r/tsd/s").visible
    assert chosen(onlooker) == {}
    assert desk.moves.empty()


def test_a_client_may_always_see_the_true_pose_or_never(
    desk: Desk, feed: RobotFeed, viewer: ViserClient
) -> None:
    feed.say(pose=np.zeros(3), truth=np.zeros(3))
    desk.scene.draw()
    viewer.until(lambda: not viewer.node("/w/t/tsd/dark/c").visible)
    viewer.set("true pose", "always")
    viewer.until(lambda: viewer.node("/w/t/tsd/dark/c").visible)
    viewer.set("true pose", "never")
    viewer.until(lambda: not viewer.node("/w/t").visible)
    viewer.set("true pose", "when it differs")
    viewer.until(lambda: viewer.node("/w/t").visible and not viewer.node("/w/t/tsd/dark/c").visible)


def test_a_client_that_does_not_follow_sees_the_robot_drive_away(
    desk: Desk, feed: RobotFeed, viewer: ViserClient, onlooker: ViserClient
) -> None:
    def say(x: float) -> None:
        feed.say(pose=np.array([x, 0.0, 0.0]))
        desk.scene.draw()
        onlooker.until(lambda: np.allclose(onlooker.node("/w").position, (-x, 0.0, 0.0)))

    say(1.0)
    viewer.set("follow", False)
    viewer.until(lambda: np.allclose(viewer.own["/w"].position, (-1.0, 0.0, 0.0)))
    say(2.0)
    assert np.allclose(viewer.node("/w").position, (-1.0, 0.0, 0.0))
    viewer.set("follow", True)
    viewer.until(lambda: np.allclose(viewer.node("/w").position, (-2.0, 0.0, 0.0)))
    say(3.0)
    viewer.until(lambda: np.allclose(viewer.node("/w").position, (-3.0, 0.0, 0.0)))


@pytest.mark.parametrize("side", ["3-D", "chase", "top"])
def test_the_camera_turns_to_the_robot(
    desk: Desk, feed: RobotFeed, viewer: ViserClient, side: str
) -> None:
    heading = 0.5 * math.pi
    feed.say(pose=np.array([4.0, 0.0, heading]))
    desk.scene.draw()
    viewer.set("follow", False)
    viewer.until(lambda: "/w" in chosen(viewer))
    feed.say(pose=np.array([5.0, 0.0, heading]))
    desk.scene.draw()
    viewer.camera.clear()
    viewer.set("camera", side)
    viewer.until(lambda: viewer.camera["SetCameraLookAtMessage"])
    eye = np.array(viewer.camera["SetCameraPositionMessage"]["position"])
    # A metre farther than the world.
    np.testing.assert_allclose(seen_at(viewer, (1.0, 0.0)), 0.5, atol=0.1)
    assert eye[2] > 0.2
    if side != "top":  # Behind the robot.
        np.testing.assert_allclose(eye[0], 1.0, atol=1e-6)
        assert eye[1] < -0.5


def test_chase_turns_the_world_under_the_robot_and_places_are_picked_in_it(
    desk: Desk, feed: RobotFeed, viewer: ViserClient
) -> None:
    pose = SE2(np.array([2.0, -1.0, 0.7]))
    moved, ahead = pose, pose.xy_heading[:2]

    def say(pose: SE2) -> None:
        feed.say(pose=pose.xy_heading)
        desk.scene.draw()

    def in_scene(point: Sequence[float]) -> np.ndarray:
        """Where the picture has a point of `odom`."""
        world = viewer.node("/w")
        half = math.atan2(world.wxyz[3], world.wxyz[0])
        return SE2(np.array([*world.position[:2], 2.0 * half])).transform(np.array(point))

    say(pose)
    viewer.set("camera", "chase")
    turns = [0.0, 1.2, -3.0]
    for moved in [pose.plus(np.array([0.3, 0.1, turn])) for turn in turns]:
        say(moved)
        ahead = moved.transform(np.array([0.5, 0.0]))
        viewer.until(lambda at=ahead: np.allclose(in_scene(at), (0.5, 0.0), atol=1e-5))
        np.testing.assert_allclose(in_scene(moved.xy_heading[:2]), (0.0, 0.0), atol=1e-5)
    # A camera straight above a place half a metre ahead picks that place of the world.
    above = {"position": [0.5, 0.0, 2.0], "wxyz": [0.0, 1.0, 0.0, 0.0]}
    viewer.send(CAMERA | above)
    middle = np.array([[0.5, 0.5]])
    eventually(lambda: np.allclose(desk.panels.pick_floor(PAGE, middle), [ahead], atol=1e-5))
    # Then the world stands again, also where it would have to be told a turn of zero.
    viewer.set("camera", "top")
    viewer.until(lambda: np.allclose(viewer.node("/w").wxyz, (1.0, 0.0, 0.0, 0.0)))
    np.testing.assert_allclose(in_scene(moved.xy_heading[:2]), (0.0, 0.0), atol=1e-5)
    viewer.set("camera", "chase")
    viewer.set("follow", False)  # Only a camera that follows turns along.
    viewer.until(lambda: np.allclose(viewer.node("/w").wxyz, (1.0, 0.0, 0.0, 0.0)))


def test_a_page_keeps_what_its_panel_changes_and_a_new_panel_has_what_it_kept(desk: Desk) -> None:
    desk.scene.add(RobotFeed())
    kept = ViewSettings(
        camera=CameraPreset.CHASE, hidden=[Layer.TRAIL], true_pose=TruePoseDisplay.NEVER, dark=False
    )
    desk.kept[PAGE] = kept
    while not desk.views.empty():  # Of other tests.
        desk.views.get()
    try:
        with opened(desk, PAGE) as viewer:
            viewer.until(lambda: not viewer.own["/w/k"].visible and not viewer.own["/w/t"].visible)
            viewer.until(lambda: viewer.control("trail").value is False and viewer.dark is False)
            viewer.until(lambda: viewer.camera["SetCameraPositionMessage"])
            assert desk.views.empty(), "it was not the operator who changed them"
            viewer.set("labels", False)
            changed = msgspec.structs.replace(kept, hidden=[Layer.LABELS, Layer.TRAIL])
            assert desk.views.get(timeout=PATIENCE_S) == (PAGE, changed)
            # A preset of the page: all at once, and the boxes show it.
            desk.panels.set_view(PAGE, ViewSettings(), look=False)
            viewer.until(lambda: viewer.control("labels").value and viewer.node("/w/l").visible)
            assert desk.views.empty()
    finally:
        desk.kept.clear()


def test_colours_are_a_matter_of_the_client(viewer: ViserClient, onlooker: ViserClient) -> None:
    viewer.set("dark", False)
    viewer.until(lambda: viewer.dark is False)
    assert onlooker.dark is True


def test_a_client_without_a_page_moves_its_own_picture_only(desk: Desk, feed: RobotFeed) -> None:
    del feed
    with opened(desk, None) as viewer:
        viewer.set("Forward (m/s)", 0.5)
        viewer.until(lambda: tried(viewer, "wheel").visible)
    assert desk.moves.empty()


def test_the_page_of_a_client_is_what_the_gateway_says(desk: Desk) -> None:
    for page in (PAGE, None):
        with opened(desk, page):
            (client_id,) = desk.server.get_clients()
            assert page_of(desk.server, client_id) == page
        assert page_of(desk.server, 123456) is None
