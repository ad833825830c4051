"""Previews and exaggerated tilt replace the live gimbals only for the requesting page."""

from __future__ import annotations

import numpy as np
import pytest

from tests.dashboard.scene.view_desk import PAGE, ViewDesk
from tests.support.scene_doubles import RobotFeed, link_poses
from tests.support.viser_client import Node, ViserClient, chosen
from tsd_twin.dashboard.scene.robot_visual import exaggerate_tilt
from tsd_twin.dashboard.wire.view import TiltFactor
from tsd_twin.lie import SE2
from tsd_twin.robots import load_robot

GIMBALS = ("outer", "inner", "wheel")


def hidden(viewer: ViserClient, kind: str) -> list[bool]:
    """Return whether each link of a kind is hidden from this client."""
    (node,) = (node for name, node in viewer.shared.items() if name.endswith(f"/m{kind}"))
    scales = node.props["batched_scales"]
    return [] if scales is None else [bool(scale == 0.0) for scale in scales]


def previewed(viewer: ViserClient, kind: str) -> Node:
    return viewer.own[f"/w/r/tsd/p{kind}"]


def enlarged(viewer: ViserClient, kind: str) -> Node:
    return viewer.own[f"/w/r/tsd/q{kind}"]


def preview(desk: ViewDesk, feed: RobotFeed, *twist: float) -> None:
    """Preview a twist of a robot on the page."""
    desk.view().show_preview(feed.id, feed.kinematics.inverse(np.array(twist)))


def test_a_preview_replaces_the_gimbals_for_its_own_client(
    desk: ViewDesk, feed: RobotFeed, viewer: ViserClient, onlooker: ViserClient
) -> None:
    preview(desk, feed, 0.0, 0.0, 1.5)
    k = feed.kinematics.modules
    viewer.until(lambda: all(hidden(viewer, kind) == [True] * k for kind in GIMBALS))
    joints = exaggerate_tilt(feed.kinematics.inverse(np.array([0.0, 0.0, 1.5])), 5.0)
    poses = link_poses(feed.robot, SE2.identity(), joints)
    for kind in GIMBALS:
        assert previewed(viewer, kind).visible
        shown = np.reshape(previewed(viewer, kind).props["batched_wxyzs"], (-1, 4))
        np.testing.assert_allclose(shown, poses[kind].wxyz, atol=1e-6)
    # Other clients receive nothing of it.
    assert chosen(onlooker) == {}
    assert onlooker.shared["/w/r/tsd/mouter"].props["batched_scales"] is None


def test_the_live_gimbals_return_after_a_preview(
    desk: ViewDesk, feed: RobotFeed, viewer: ViserClient
) -> None:
    preview(desk, feed, 0.5, 0.0, 0.0)
    viewer.until(lambda: previewed(viewer, "wheel").visible)
    desk.view().show_preview(feed.id, None)
    viewer.until(lambda: not previewed(viewer, "wheel").visible)
    viewer.until(lambda: not any(any(hidden(viewer, kind)) for kind in GIMBALS))
    # Live throughout.
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


def test_a_preview_hides_the_gimbals_of_its_robot_only(
    desk: ViewDesk, feed: RobotFeed, viewer: ViserClient
) -> None:
    preview(desk, feed, 0.5, 0.0, 0.0)
    k = feed.kinematics.modules
    viewer.until(lambda: hidden(viewer, "outer") == [True] * k)
    desk.scene.add(RobotFeed("bob"))
    viewer.until(lambda: hidden(viewer, "outer") == [True] * k + [False] * k)
    desk.scene.remove(feed.id)
    viewer.until(lambda: "/w/r/bob/mouter" in viewer.shared and not any(hidden(viewer, "outer")))


def test_selecting_another_robot_ends_the_preview(
    desk: ViewDesk, feed: RobotFeed, viewer: ViserClient
) -> None:
    desk.scene.add(RobotFeed("bob"))
    preview(desk, feed, 0.5, 0.0, 0.0)
    viewer.until(lambda: previewed(viewer, "outer").visible)
    for name in ("bob", feed.id):
        desk.view().select_robot(name)
        viewer.until(lambda: not any(hidden(viewer, "outer")))
        viewer.until(lambda: "/w/r/tsd/pouter" not in viewer.own)


def test_exaggerated_tilt_is_drawn_and_labelled_for_its_own_client(
    desk: ViewDesk, feed: RobotFeed, viewer: ViserClient, onlooker: ViserClient
) -> None:
    k = feed.kinematics.modules
    desk.apply(tilt=TiltFactor.TEN)
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
    # The shared rings show the true setpoint; this client has separate ones.
    assert not viewer.own["/w/r/tsd/s"].visible
    assert "/w/r/tsd/qs/s" in viewer.own
    assert "/w/r/tsd/qd/r" in viewer.own
    assert chosen(onlooker) == {}
    desk.apply(tilt=TiltFactor.FIVE)
    viewer.until(lambda: chosen(viewer) == {})
    viewer.until(lambda: not any(any(hidden(viewer, kind)) for kind in GIMBALS))


def test_a_preview_is_exaggerated_and_the_enlarged_gimbals_return_after_it(
    desk: ViewDesk, feed: RobotFeed, viewer: ViserClient
) -> None:
    desk.apply(tilt=TiltFactor.THREE)
    viewer.until(lambda: enlarged(viewer, "inner").visible)
    preview(desk, feed, 0.5, 0.0, 0.0)
    joints = exaggerate_tilt(feed.kinematics.inverse(np.array([0.5, 0.0, 0.0])), 3.0)
    poses = link_poses(feed.robot, SE2.identity(), joints)
    viewer.until(
        lambda: previewed(viewer, "inner").visible and not enlarged(viewer, "inner").visible
    )
    shown = np.reshape(previewed(viewer, "inner").props["batched_wxyzs"], (-1, 4))
    np.testing.assert_allclose(shown, poses["inner"].wxyz, atol=1e-6)
    desk.view().show_preview(feed.id, None)
    viewer.until(
        lambda: enlarged(viewer, "inner").visible and not previewed(viewer, "inner").visible
    )
    # The true links remain hidden next to the enlarged ones.
    viewer.until(lambda: hidden(viewer, "inner") == [True] * feed.kinematics.modules)


def test_a_robot_without_gimbals_has_no_tilt_to_exaggerate(desk: ViewDesk) -> None:
    feed = RobotFeed("kiwi", load_robot("kiwi"))
    desk.scene.add(feed)
    with desk.opened(PAGE) as viewer:
        desk.apply(tilt=TiltFactor.TEN)
        preview(desk, feed, 0.5, 0.0, 0.0)
        viewer.until(lambda: any(name.startswith("/w/r/kiwi/p") for name in viewer.own))
        assert not any("/q" in name for name in viewer.own)
