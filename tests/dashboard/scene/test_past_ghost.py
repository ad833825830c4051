"""Ghost of the robot's past pose, shown only to the page that requested it."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np
import pytest
import viser

from tests.support.scene_doubles import RobotFeed
from tests.support.viser_client import ViserClient, viser_client
from tsd_twin import robots
from tsd_twin.dashboard.scene.client_views import ClientViews
from tsd_twin.dashboard.scene.scene import Scene
from tsd_twin.lie import SO3

PAGE, OTHER = "00000000000000aa", "00000000000000bb"


@pytest.fixture
def scene(server: viser.ViserServer) -> Generator[Scene]:
    yield Scene(server)
    server.scene.reset()


@pytest.fixture
def views(server: viser.ViserServer, scene: Scene) -> ClientViews:
    return ClientViews(server, scene)


@pytest.fixture
def viewers(
    server: viser.ViserServer, views: ClientViews
) -> Generator[tuple[ViserClient, ViserClient]]:
    del views
    port = server.get_port()
    with viser_client(port, PAGE) as asking, viser_client(port, OTHER) as other:
        yield asking, other


def test_the_ghost_is_where_the_robot_was_and_says_so(
    scene: Scene, views: ClientViews, viewers: tuple[ViserClient, ViserClient]
) -> None:
    asking, other = viewers
    feed = RobotFeed()
    scene.add(feed)
    joints = np.tile([0.2, -0.1, 200.0], 3)
    feed.say(pose=np.array([0.5, -0.2, 1.0]), joints=joints)
    past = feed.snapshot
    scene.draw()
    feed.say(pose=np.array([1.5, 0.4, 0.0]), joints=0.0 * joints)
    scene.draw()
    asking.until(lambda: "/w/r/tsd/mchassis" in asking.shared)
    asking.until(lambda: np.allclose(asking.node("/w/r/tsd").position, (1.5, 0.4, 0.0)))
    views.of_page(PAGE)[0].show_past(past, 2.5)
    asking.until(lambda: asking.own["/w/h/n"].props["text"] == "tsd 2.5 s ago")
    ghost = asking.own["/w/h"]
    np.testing.assert_allclose(ghost.position, (0.5, -0.2, 0.0))
    np.testing.assert_allclose(ghost.wxyz, (np.cos(0.5), 0.0, 0.0, np.sin(0.5)))
    assert asking.own["/w/h/c"].visible
    # The live robot is unchanged, and no other page shows the ghost.
    np.testing.assert_allclose(asking.node("/w/r/tsd").position, (1.5, 0.4, 0.0))
    assert "/w/h" not in other.own
    assert "/w/h" not in other.shared
    views.of_page(PAGE)[0].show_past(feed.snapshot, 0.5)
    asking.until(lambda: asking.own["/w/h/n"].props["text"] == "tsd 0.5 s ago")
    np.testing.assert_allclose(asking.own["/w/h"].position, (1.5, 0.4, 0.0))
    views.of_page(PAGE)[0].show_past(None, 0.0)
    asking.until(lambda: not asking.own["/w/h"].visible)


def test_the_ghost_goes_when_another_robot_is_chosen(
    scene: Scene, views: ClientViews, viewers: tuple[ViserClient, ViserClient]
) -> None:
    asking, _ = viewers
    feed = RobotFeed()
    for each in (feed, RobotFeed("atlas", robots.load_robot("atlas"))):
        scene.add(each)
    feed.say(pose=np.zeros(3))
    scene.draw()
    views.of_page(PAGE)[0].show_past(feed.snapshot, 1.0)
    asking.until(lambda: "/w/h" in asking.own)
    views.of_page(PAGE)[0].select_robot("atlas")
    asking.until(lambda: "/w/h" not in asking.own)


def test_the_ghost_of_a_sphere_is_beside_it(
    scene: Scene, views: ClientViews, viewers: tuple[ViserClient, ViserClient]
) -> None:
    asking, _ = viewers
    feed = RobotFeed("atlas", robots.load_robot("atlas"))
    scene.add(feed)
    turn = SO3.exp(np.array([0.4, -0.3, 0.8]))
    feed.say(ball=turn, joints=np.zeros(len(feed.kinematics.joints)))
    scene.draw()
    views.of_page(PAGE)[0].show_past(feed.snapshot, 1.0)
    asking.until(lambda: "/w/h/sphere" in asking.own)
    reach_m = scene.visuals["atlas"].meshes.shape.reach_m
    assert asking.own["/w/h"].position[1] < -2.0 * reach_m
    shown = np.reshape(asking.own["/w/h/sphere"].props["batched_wxyzs"], (-1, 4))
    np.testing.assert_allclose(shown[0], turn.wxyz, atol=1e-6)
