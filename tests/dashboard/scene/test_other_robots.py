"""Robots without gimbals in the scene, alone and with other robots."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np
import pytest
import viser

from tests.support.scene_doubles import RobotFeed, link_poses
from tests.support.viser_client import ViserClient, viser_client
from tsd_twin import robots
from tsd_twin.dashboard.scene.scene import Scene
from tsd_twin.lie import SE2, SO3

TURN = SO3.exp(np.array([0.4, -0.3, 0.8]))


@pytest.fixture
def scene(server: viser.ViserServer) -> Generator[Scene]:
    yield Scene(server)
    server.scene.reset()


@pytest.fixture
def viewer(server: viser.ViserServer, scene: Scene) -> Generator[ViserClient]:
    del scene
    with viser_client(server.get_port()) as watching:
        yield watching


def shown(viewer: ViserClient, robot_id: str, kind: str) -> np.ndarray:
    node = viewer.node(f"/w/r/{robot_id}/m{kind}")
    return np.reshape(node.props["batched_wxyzs"], (-1, 4))


def test_a_sphere_turns_in_place(scene: Scene, viewer: ViserClient) -> None:
    feed = RobotFeed("atlas", robots.load_robot("atlas"))
    scene.add(feed)
    viewer.until(lambda: "/w/r/atlas/msphere" in viewer.shared)
    feed.say(ball=TURN, true_ball=TURN, other_ball=SO3.identity())
    scene.draw()
    expected = link_poses(feed.robot, SE2.identity(), np.zeros(3), TURN)
    viewer.until(
        lambda: np.allclose(shown(viewer, "atlas", "sphere"), expected["sphere"].wxyz, atol=1e-6)
    )
    # The two estimates differ.
    viewer.until(lambda: viewer.node("/w/o/atlas/dark/c").visible is True)
    assert viewer.node("/w/t/atlas/dark/c").visible is False
    np.testing.assert_allclose(viewer.node("/w/t/atlas").wxyz, TURN.wxyz, atol=1e-6)


def test_wheels_that_roll_are_drawn_as_fast_as_they_are(scene: Scene, viewer: ViserClient) -> None:
    feed = RobotFeed("omni4", robots.load_robot("omni4"))
    scene.add(feed)
    viewer.until(lambda: "/w/r/omni4/mwheel" in viewer.shared)
    joints = feed.kinematics.inverse(np.array([0.3, 0.0, 0.0]))
    feed.say(pose=np.zeros(3), joints=joints)
    scene.draw()
    feed.say(pose=np.zeros(3), joints=joints, after_s=0.02)
    scene.draw()
    skeleton = scene.visuals["omni4"].meshes.shape.skeleton
    expected = skeleton.poses(
        SE2.identity(), SO3.identity(), np.remainder(0.02 * joints, 2.0 * np.pi)
    )["wheel"].wxyz
    viewer.until(lambda: np.allclose(shown(viewer, "omni4", "wheel"), expected, atol=1e-5))


def test_robots_of_all_kinds_share_a_scene(scene: Scene, viewer: ViserClient) -> None:
    for name in robots.robot_names():
        scene.add(RobotFeed(name, robots.load_robot(name)))
    for name in robots.robot_names():
        for kind in scene.visuals[name].meshes.shape.glbs:
            viewer.until(lambda at=f"/w/r/{name}/m{kind}": at in viewer.shared)
    # Wheels without commanded angles have no hoops.
    assert "/w/r/tsd/s" in viewer.shared
    assert "/w/r/omni4/s" not in viewer.shared
    scene.remove("atlas")
    viewer.until(lambda: "/w/r/atlas/msphere" not in viewer.shared)
