"""The robot of the Student tab and previews, in the scene of the requesting page."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np
import pytest
import viser

from tests.support.scene_doubles import RobotFeed, link_poses
from tests.support.viser_client import ViserClient, chosen, viser_client
from tsd_twin.dashboard.scene.client_nodes import StudentPose
from tsd_twin.dashboard.scene.client_views import ClientViews
from tsd_twin.dashboard.scene.robot_visual import exaggerate_tilt
from tsd_twin.dashboard.scene.scene import Scene
from tsd_twin.dashboard.sessions.variants import variant
from tsd_twin.dashboard.wire.view import TiltFactor, ViewSettings
from tsd_twin.lie import SE2, Array

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


def pose_of(base: str, twist: tuple[float, float, float], **knobs: float) -> StudentPose:
    robot = variant(base, {key.replace("__", "."): value for key, value in knobs.items()})
    joints = robot.kinematics().inverse(np.array(twist))
    centre = None if twist[2] == 0.0 else (-twist[1] / twist[2], twist[0] / twist[2])
    return StudentPose(robot, joints, centre)


def is_hidden(viewer: ViserClient, kind: str) -> bool:
    scales = viewer.shared[f"/w/r/tsd/m{kind}"].props["batched_scales"]
    return scales is not None and not np.any(scales)


def shown(viewer: ViserClient, node: str) -> Array:
    return np.reshape(viewer.own[node].props["batched_wxyzs"], (-1, 4))


def test_a_variant_replaces_the_robot_on_the_page_that_asked_and_follows_its_joints(
    scene: Scene, views: ClientViews, viewers: tuple[ViserClient, ViserClient]
) -> None:
    asking, other = viewers
    scene.add(RobotFeed())
    asking.until(lambda: "/w/r/tsd/mchassis" in asking.shared)
    for twist in ((0.5, 0.0, 1.0), (0.0, 0.9, 0.0)):
        pose = pose_of("tsd", twist, drive__pivot_radius_m=0.2)
        views.of_page(PAGE)[0].show_student(pose)
        drawn = exaggerate_tilt(pose.joints, 5.0)
        poses = link_poses(pose.robot, SE2.identity(), drawn)
        asking.until(
            lambda poses=poses: np.allclose(
                shown(asking, "/w/r/tsd/vinner"), poses["inner"].wxyz, atol=1e-6
            )
        )
        at_m = np.reshape(asking.own["/w/r/tsd/vouter"].props["batched_positions"], (-1, 3))
        np.testing.assert_allclose(np.hypot(*at_m[:, :2].T), 0.2, atol=1e-6)
        asking.until(lambda twist=twist: ("/w/r/tsd/vc" in asking.own) is (twist[2] != 0.0))
    asking.until(lambda: is_hidden(asking, "chassis") and is_hidden(asking, "wheel"))
    assert not asking.own["/w/r/tsd/s"].visible  # Rings of the robot that does not exist.
    assert chosen(other) == {}
    views.of_page(PAGE)[0].show_student(None)
    asking.until(lambda: chosen(asking) == {})
    asking.until(lambda: not is_hidden(asking, "chassis") and not is_hidden(asking, "wheel"))


def test_the_cross_lies_at_the_centre_of_rotation(
    scene: Scene, views: ClientViews, viewers: tuple[ViserClient, ViserClient]
) -> None:
    asking, _ = viewers
    scene.add(RobotFeed())
    views.of_page(PAGE)[0].show_student(pose_of("tsd", (0.5, -0.25, 0.5)))
    asking.until(lambda: "/w/r/tsd/vc" in asking.own)
    points = np.reshape(asking.own["/w/r/tsd/vc"].props["points"], (-1, 3))
    np.testing.assert_allclose(points.mean(axis=0)[:2], (0.5, 1.0), atol=1e-6)


@pytest.mark.parametrize("base", ["kiwi", "mecanum", "atlas"])
def test_another_kind_is_drawn_with_its_pushes_without_any_robot(
    base: str, views: ClientViews, viewers: tuple[ViserClient, ViserClient]
) -> None:
    asking, _ = viewers
    views.of_page(PAGE)[0].show_student(pose_of(base, (0.2, 0.3, 0.4)))
    asking.until(lambda: {"/w/vchassis", "/w/vwheel", "/w/va"} <= asking.own.keys())
    views.of_page(PAGE)[0].show_student(None)
    asking.until(lambda: not any("/w/v" in name for name in asking.own))


def test_the_robot_that_is_replaced_may_go(
    scene: Scene, views: ClientViews, viewers: tuple[ViserClient, ViserClient]
) -> None:
    asking, _ = viewers
    scene.add(RobotFeed())
    views.of_page(PAGE)[0].show_student(pose_of("tsd", (0.5, 0.0, 0.0)))
    asking.until(lambda: "/w/r/tsd/vwheel" in asking.own)
    scene.remove("tsd")
    asking.until(lambda: "/w/vwheel" in asking.own)


def test_exaggerated_gimbals_are_not_drawn_through_the_variant(
    scene: Scene, views: ClientViews, viewers: tuple[ViserClient, ViserClient]
) -> None:
    asking, _ = viewers
    scene.add(RobotFeed())
    views.of_page(PAGE)[0].apply(ViewSettings(tilt=TiltFactor.THREE), look=False)
    asking.until(lambda: "/w/r/tsd/qinner" in asking.own)
    pose = pose_of("tsd", (0.5, 0.0, 0.0))
    views.of_page(PAGE)[0].show_student(pose)
    asking.until(lambda: not asking.own["/w/r/tsd/qinner"].visible)
    true = link_poses(pose.robot, SE2.identity(), pose.joints)["inner"].wxyz
    cosine = np.sum(shown(asking, "/w/r/tsd/vinner") * true, axis=-1)
    assert (2.0 * np.arccos(np.abs(cosine)) > 0.03).any()  # Three times 2.7 degrees.
    assert not {"/w/r/tsd/qd/r", "/w/r/tsd/qs/s"} & asking.own.keys()


def test_a_preview_is_drawn_for_the_robot_it_was_computed_for(
    scene: Scene, views: ClientViews, viewers: tuple[ViserClient, ViserClient]
) -> None:
    asking, other = viewers
    feed = RobotFeed()
    scene.add(feed)
    joints = feed.kinematics.inverse(np.array([0.3, 0.2, 0.1]))
    views.of_page(PAGE)[0].show_preview("another", np.zeros(4))
    views.of_page(PAGE)[0].show_preview("tsd", joints)
    poses = link_poses(feed.robot, SE2.identity(), exaggerate_tilt(joints, 5.0))
    asking.until(
        lambda: np.allclose(shown(asking, "/w/r/tsd/pinner"), poses["inner"].wxyz, atol=1e-6)
    )
    assert chosen(other) == {}
    views.of_page(PAGE)[0].show_preview("tsd", None)
    asking.until(lambda: not asking.own["/w/r/tsd/pinner"].visible)
