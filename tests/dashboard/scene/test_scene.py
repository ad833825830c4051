"""Messages sent to a viser client in response to robot messages or their absence."""

from __future__ import annotations

import itertools
import math
from collections.abc import Generator
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest
import viser
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.scene_doubles import PERIOD_S, RobotFeed, link_poses
from tests.support.viser_client import Node, ViserClient, viser_client
from tsd_twin import robots
from tsd_twin.dashboard.scene import paths
from tsd_twin.dashboard.scene.drive_marks import ARROW_LENGTH_PER_SPEED_S, LEAST_ARROW_M
from tsd_twin.dashboard.scene.overlays import _LEAST_SIGMA_M, _VISIBLE_M, PoseRegion
from tsd_twin.dashboard.scene.robot_overlays import VISIBLE_DIFFERENCE_M
from tsd_twin.dashboard.scene.robot_visual import SPIN_SLOWDOWN
from tsd_twin.dashboard.scene.scene import Scene
from tsd_twin.dashboard.wire.view import TiltFactor
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.robots import RPM, RobotDescription

_NUMBERS = itertools.count()
POSE = np.array([3.0, -2.0, 0.7])


@pytest.fixture(scope="module")
def drawn(server: viser.ViserServer) -> Scene:
    return Scene(server, tilt=TiltFactor.TRUE)


@pytest.fixture
def scene(drawn: Scene) -> Generator[Scene]:
    """An empty scene with cached robot models."""
    yield drawn
    for robot_id in list(drawn.visuals):
        drawn.remove(robot_id)


@pytest.fixture
def feed(scene: Scene) -> RobotFeed:
    made = RobotFeed()
    scene.add(made)
    return made


@pytest.fixture
def viewer(server: viser.ViserServer, feed: RobotFeed) -> Generator[ViserClient]:
    del feed  # The robot exists before the client connects.
    with viser_client(server.get_port()) as made:
        yield made


def rows(node: Node) -> tuple[Array, Array]:
    """Orientations (n, 4) and positions (n, 3) of a node's instances."""
    return (
        np.reshape(node.props["batched_wxyzs"], (-1, 4)),
        np.reshape(node.props["batched_positions"], (-1, 3)),
    )


def batches(viewer: ViserClient) -> dict[str, Node]:
    """Nodes of the solid parts, by kind of link."""
    found = {name: node for name, node in viewer.shared.items() if "/m" in name}
    return {name.rsplit("/m", 1)[1]: node for name, node in found.items()}


def in_world(viewer: ViserClient, kind: str) -> tuple[Array, Array]:
    """Orientations (n, 4) and positions (n, 3) of the links of a kind, in `odom`."""
    (name,) = (name for name in viewer.shared if name.endswith(f"/m{kind}"))
    wxyz, position = rows(viewer.shared[name])
    carrier = viewer.node(name.rsplit("/", 1)[0])
    turn = SO3(np.array(carrier.wxyz))
    turned = turn @ SO3(np.float64(wxyz))
    return turned.wxyz, turn.rotate(np.float64(position)) + np.array(carrier.position)


def fence(scene: Scene, viewer: ViserClient) -> list[dict[str, object]]:
    """Wait until all sent messages have arrived, and return those since the last fence."""
    name = f"/fence{next(_NUMBERS)}"
    post = scene.server.scene.add_frame(name, show_axes=False)
    scene.server.flush()
    viewer.until(lambda: name in viewer.shared)
    post.remove()
    viewer.until(lambda: name not in viewer.shared)
    found = [m for m in viewer.messages if not str(m.get("name")).startswith("/fence")]
    viewer.messages.clear()
    return found


def test_every_kind_of_link_is_one_node(viewer: ViserClient, feed: RobotFeed) -> None:
    found = batches(viewer)
    assert found.keys() == {"chassis", "outer", "inner", "wheel"}
    for kind, node in found.items():
        assert len(rows(node)[0]) == (1 if kind == "chassis" else feed.kinematics.modules)
        assert node.props["glb_data"][:4] == b"glTF"


def test_links_are_sent_where_the_kinematics_have_them(
    scene: Scene, feed: RobotFeed, viewer: ViserClient
) -> None:
    joints = feed.kinematics.inverse(np.array([0.4, 0.2, -1.0]))
    feed.say(pose=POSE, joints=joints)
    scene.draw()
    fence(scene, viewer)
    for kind, poses in link_poses(feed.robot, SE2(POSE), joints).items():
        wxyz, position = in_world(viewer, kind)
        np.testing.assert_allclose(wxyz, poses.wxyz, atol=1e-6)
        np.testing.assert_allclose(position, poses.position, atol=1e-6)


def test_the_world_moves_so_that_the_robot_keeps_its_place(
    scene: Scene, feed: RobotFeed, viewer: ViserClient
) -> None:
    for x in (0.5, 1.0, 30.0):
        feed.say(pose=np.array([x, -2.0 * x, 0.1]))
        scene.draw()
        fence(scene, viewer)
        seen = in_world(viewer, "chassis")[1][0] + viewer.node("/w").position
        np.testing.assert_allclose(seen, (0.0, 0.0, feed.kinematics.wheel_radius_m), atol=1e-5)


def test_nothing_new_sends_nothing(scene: Scene, feed: RobotFeed, viewer: ViserClient) -> None:
    feed.say(pose=POSE, joints=feed.kinematics.inverse(np.zeros(3)), truth=POSE)
    scene.draw()
    fence(scene, viewer)
    for _ in range(5):
        scene.draw()
    assert fence(scene, viewer) == []


def test_a_robot_at_rest_sends_the_turning_of_its_wheels_alone(
    scene: Scene, feed: RobotFeed, viewer: ViserClient
) -> None:
    joints = feed.kinematics.inverse(np.zeros(3))
    for _ in range(2):
        feed.say(pose=POSE, joints=joints, setpoint=joints, truth=POSE)
        scene.draw()
    fence(scene, viewer)
    feed.say(pose=POSE, joints=joints, setpoint=joints, truth=POSE)
    scene.draw()
    (message,) = fence(scene, viewer)
    assert message["name"] == "/w/r/tsd/mwheel"


def test_the_last_change_before_a_robot_rests_is_drawn(scene: Scene, viewer: ViserClient) -> None:
    """States of a robot at rest are skipped once overlays with a limited rate are drawn."""
    feed = RobotFeed("kiwi", robots.load_robot("kiwi"))
    scene.add(feed)
    covariance = np.diag([1e-4, 4e-4, 1e-2])
    drives = feed.kinematics.inverse(np.array([0.3, 0.0, 0.0]))
    for step in range(8):
        pose = POSE + np.array([0.01 * step, 0.0, 0.0])
        feed.say(pose=pose, joints=drives, setpoint=drives, covariance=1e-3 * covariance)
        scene.draw()
    rest = np.zeros(3)
    for _ in range(60):
        feed.say(pose=POSE, joints=rest, setpoint=rest, truth=POSE + 0.1, covariance=covariance)
        scene.draw()
    fence(scene, viewer)
    assert not viewer.node("/w/r/kiwi/a/dark/v").visible
    assert viewer.node("/w/t/kiwi/dark/c").visible
    shown = np.reshape(viewer.node("/w/r/kiwi/e/dark/p").props["vertices"], (-1, 3))
    sigma = math.sqrt(float(covariance[1, 1]) + _LEAST_SIGMA_M**2)
    np.testing.assert_allclose(np.abs(shown[:, 1]).max(), 2.0 * sigma, rtol=0.02)
    feed.say(pose=POSE, joints=rest, setpoint=rest, truth=POSE + 0.1, covariance=covariance)
    scene.draw()
    assert fence(scene, viewer) == []


def test_wheels_turn_slower_than_they_do_and_not_in_a_gap(
    scene: Scene, feed: RobotFeed, viewer: ViserClient
) -> None:
    joints = feed.kinematics.inverse(np.zeros(3))
    spin = feed.robot.drive.cruise_speed_rpm * RPM

    def wheels() -> Array:
        scene.draw()
        fence(scene, viewer)
        return rows(batches(viewer)["wheel"])[0]

    feed.say(joints=joints)
    first = wheels()
    feed.say(joints=joints, after_s=PERIOD_S)
    second = wheels()
    turned = (SO3(np.float64(first)).inverse() @ SO3(np.float64(second))).log()
    expected = np.tile([0.0, 0.0, spin * PERIOD_S / SPIN_SLOWDOWN], (feed.kinematics.modules, 1))
    np.testing.assert_allclose(turned, expected, atol=1e-6)
    feed.say(joints=joints, after_s=5.0)
    np.testing.assert_array_equal(wheels(), second)


def test_joints_of_another_robot_move_nothing(
    scene: Scene, feed: RobotFeed, viewer: ViserClient
) -> None:
    joints = feed.kinematics.inverse(np.array([0.4, 0.2, -1.0]))
    feed.say(joints=joints)
    assert feed.snapshot.joints is not None
    stranger = replace(feed.snapshot.joints, names=["elbow"] * len(joints))
    feed.snapshot = replace(feed.snapshot, joints=stranger)
    scene.draw()
    fence(scene, viewer)
    upright = link_poses(feed.robot, SE2.identity(), 0.0 * joints)
    wxyz, _ = rows(batches(viewer)["inner"])
    np.testing.assert_allclose(wxyz, upright["inner"].wxyz, atol=1e-6)


def test_robots_of_one_description_share_their_nodes(
    scene: Scene, feed: RobotFeed, viewer: ViserClient
) -> None:
    other = RobotFeed("bob")
    scene.add(other)
    fence(scene, viewer)
    for robot, x in ((feed, 1.0), (other, 2.0)):
        robot.say(pose=np.array([x, 0.0, 0.0]))
    scene.draw()
    solid = [m for m in fence(scene, viewer) if "batched_positions" in str(m.get("updates"))]
    assert {m["name"] for m in solid} == {f"/w/r/tsd/m{kind}" for kind in batches(viewer)}
    np.testing.assert_allclose(in_world(viewer, "chassis")[1][:, 0], [1.0, 2.0])
    assert viewer.node("/w/r/bob/n").visible  # Names are shown if there are several robots.
    scene.remove("tsd")
    fence(scene, viewer)
    np.testing.assert_allclose(in_world(viewer, "chassis")[1][:, 0], [2.0])
    assert not [name for name in viewer.shared if name.startswith("/w/r/tsd")]


def test_a_robot_of_another_description_has_nodes_of_its_own(
    scene: Scene, feed: RobotFeed, viewer: ViserClient
) -> None:
    drive = feed.robot.drive
    wide = RobotFeed("wide", _with_drive(feed, pivot_radius_m=1.2 * drive.pivot_radius_m))
    scene.add(wide)
    fence(scene, viewer)
    assert len(rows(viewer.node("/w/r/tsd/mchassis"))[0]) == 1
    assert len(rows(viewer.node("/w/r/wide/mchassis"))[0]) == 1
    scene.remove("wide")
    fence(scene, viewer)
    assert "/w/r/wide/mchassis" not in viewer.shared


def _with_drive(feed: RobotFeed, **changed: float) -> RobotDescription:
    drive = msgspec.structs.replace(feed.robot.drive, **changed)
    return msgspec.structs.replace(feed.robot, drive=drive)


def test_a_robot_that_comes_back_takes_its_old_place(
    scene: Scene, feed: RobotFeed, viewer: ViserClient
) -> None:
    scene.add(RobotFeed("bob"))
    again = RobotFeed(feed.id)
    scene.add(again)
    assert list(scene.visuals) == ["tsd", "bob"]
    assert scene.default_robot_id == "tsd"
    again.say(pose=POSE)
    scene.draw()
    fence(scene, viewer)
    assert len(rows(batches(viewer)["chassis"])[0]) == 2
    np.testing.assert_allclose(viewer.node("/w").position, (-POSE[0], -POSE[1], 0.0))


def test_a_robot_that_left_is_drawn_no_more(
    scene: Scene, feed: RobotFeed, viewer: ViserClient
) -> None:
    scene.remove(feed.id)
    scene.remove(feed.id)
    feed.say(pose=POSE)
    scene.draw()
    fence(scene, viewer)
    assert batches(viewer) == {}


def test_who_comes_late_sees_the_same(
    server: viser.ViserServer, scene: Scene, feed: RobotFeed, viewer: ViserClient
) -> None:
    joints = feed.kinematics.inverse(np.array([0.4, 0.2, -1.0]))
    for _ in range(30):
        feed.say(pose=POSE + 0.03 * feed.now_s, joints=joints, setpoint=joints)
        scene.draw()
    fence(scene, viewer)
    with viser_client(server.get_port()) as late:
        assert late.shared.keys() == viewer.shared.keys()
        for name, node in viewer.shared.items():
            np.testing.assert_equal(vars(late.shared[name]), vars(node))


def test_the_setpoint_is_a_ring_across_the_axle_it_asks_for(
    scene: Scene, feed: RobotFeed, viewer: ViserClient
) -> None:
    joints = feed.kinematics.inverse(np.array([0.4, 0.2, -1.0]))
    feed.say(pose=POSE, joints=feed.kinematics.inverse(np.zeros(3)), setpoint=joints)
    scene.draw()
    fence(scene, viewer)
    wxyz, _ = rows(viewer.node("/w/r/tsd/s/dark/s"))
    axles = SO3(np.float64(wxyz)).rotate(np.tile([0.0, 0.0, 1.0], (feed.kinematics.modules, 1)))
    alpha, beta, _ = joints.reshape(-1, 3).T
    azimuths = np.radians(feed.robot.drive.azimuths_deg)
    # Eq. 24 and 25, from the module frame, whose X is azimuth - 90 degrees, to the base frame.
    lx, ly = np.cos(alpha) * np.sin(beta), np.sin(alpha)
    expected = [
        lx * np.sin(azimuths) + ly * np.cos(azimuths),
        -lx * np.cos(azimuths) + ly * np.sin(azimuths),
        np.cos(alpha) * np.cos(beta),
    ]
    np.testing.assert_allclose(axles.T, expected, atol=1e-6)


@pytest.mark.parametrize(
    ("off", "seen"),
    [(0.5 * VISIBLE_DIFFERENCE_M, False), (2.0 * VISIBLE_DIFFERENCE_M, True), (0.0, False)],
)
def test_the_true_pose_is_shown_when_it_is_another(
    scene: Scene, feed: RobotFeed, viewer: ViserClient, off: float, seen: bool
) -> None:
    feed.say(pose=POSE, truth=POSE + np.array([off, 0.0, 0.0]))
    scene.draw()
    fence(scene, viewer)
    assert viewer.node("/w/t/tsd/dark/c").visible is seen
    np.testing.assert_allclose(
        viewer.node("/w/t/tsd").position[:2], POSE[:2] + np.array([off, 0.0])
    )


def test_a_turn_is_another_pose_and_a_full_one_is_not(
    scene: Scene, feed: RobotFeed, viewer: ViserClient
) -> None:
    for turned, seen in ((2.0 * np.pi, False), (0.02, True)):
        feed.say(pose=POSE, truth=POSE + np.array([0.0, 0.0, turned]))
        scene.draw()
        fence(scene, viewer)
        assert viewer.node("/w/t/tsd/dark/c").visible is seen


def test_a_robot_that_is_not_heard_of_is_covered(
    scene: Scene, feed: RobotFeed, viewer: ViserClient
) -> None:
    for stale in (True, False):
        scene.set_stale(feed.id, stale)
        fence(scene, viewer)
        assert viewer.node("/w/r/tsd/c").visible is stale


def test_arrows_show_what_each_wheel_does(
    scene: Scene, feed: RobotFeed, viewer: ViserClient
) -> None:
    twist = np.array([0.6, -0.2, 0.5])
    feed.say(pose=POSE, joints=feed.kinematics.inverse(twist))
    scene.draw()
    fence(scene, viewer)
    assert viewer.node("/w/r/tsd/a/dark/v").visible
    strokes = np.reshape(viewer.node("/w/r/tsd/a/dark/v/p").props["points"], (6, -1, 2, 3))
    starts, ends = strokes[0, ..., :2].transpose(1, 0, 2)  # The shafts come first.
    # A rigid body: v + omega x p.
    velocities = twist[:2] + twist[2] * np.stack([-starts[:, 1], starts[:, 0]], axis=-1)
    speeds = np.linalg.norm(velocities, axis=-1)
    lengths = np.linalg.norm(ends - starts, axis=-1)
    np.testing.assert_allclose(
        lengths, LEAST_ARROW_M + ARROW_LENGTH_PER_SPEED_S * speeds, rtol=1e-5
    )
    np.testing.assert_allclose(
        (ends - starts) / lengths[:, None], velocities / speeds[:, None], atol=1e-5
    )
    feed.say(pose=POSE, joints=feed.kinematics.inverse(np.zeros(3)), after_s=1.0)
    scene.draw()
    fence(scene, viewer)
    assert not viewer.node("/w/r/tsd/a/dark/v").visible


class KeptMeshes:
    """viser's scene that keeps the handles of meshes by name."""

    def __init__(self, scene: viser.SceneApi) -> None:
        self.scene = scene
        self.meshes: dict[str, viser.MeshHandle] = {}

    def __getattr__(self, name: str) -> Any:
        return getattr(self.scene, name)

    def add_mesh_simple(self, name: str, *args: Any, **kwargs: Any) -> viser.MeshHandle:
        self.meshes[name] = self.scene.add_mesh_simple(name, *args, **kwargs)
        return self.meshes[name]


def pose_region(
    server: viser.ViserServer,
) -> tuple[PoseRegion, viser.MeshHandle, viser.MeshHandle]:
    """Return a region with its area and wedge in the dark theme."""
    scene: Any = KeptMeshes(server.scene)
    region = PoseRegion(scene, "/region", 0.2)
    return region, scene.meshes["/region/dark/p"], scene.meshes["/region/dark/w"]


spreads = st.floats(0.01, 0.5)


@settings(max_examples=30)
@given(x=spreads, y=spreads, correlation=st.floats(-0.8, 0.8), heading=st.floats(-4.0, 4.0))
def test_the_region_of_a_certain_heading_is_an_ellipse_of_two_sigma(
    server: viser.ViserServer, x: float, y: float, correlation: float, heading: float
) -> None:
    covariance = np.diag([x * x, y * y, 0.0])
    covariance[0, 1] = covariance[1, 0] = correlation * x * y
    region, area, wedge = pose_region(server)
    region.update(covariance, heading, now_s=0.0)
    in_base = SO3(np.array(area.wxyz)).rotate(np.float64(area.vertices))
    on_floor = SE2(np.array([0.0, 0.0, heading])).rotate(in_base[:, :2])
    shown = covariance[:2, :2] + _LEAST_SIGMA_M**2 * np.eye(2)
    distance = np.einsum("ni,ij,nj->n", on_floor, np.linalg.inv(shown), on_floor)
    # A turn is not sent if it moves no point by more than this, about either axis.
    moved_m = math.sqrt(2.0) * _VISIBLE_M
    narrowest_m = math.sqrt(np.linalg.eigvalsh(shown)[0])
    assert np.abs(np.sqrt(distance) - 2.0).max() < moved_m / narrowest_m + 0.001
    assert not wedge.visible


@pytest.mark.parametrize(("sigma_rad", "half_rad"), [(0.2, 0.2987), (0.05, 0.0747), (3.0, np.pi)])
def test_the_wedge_holds_the_heading_with_86_percent(
    server: viser.ViserServer, sigma_rad: float, half_rad: float
) -> None:
    region, _, wedge = pose_region(server)
    region.update(np.diag([1e-4, 1e-4, sigma_rad**2]), 0.7, now_s=0.0)
    assert region.half_rad == pytest.approx(half_rad, rel=1e-3)
    corners = np.float64(wedge.vertices[1:])
    angles = np.arctan2(corners[:, 1], corners[:, 0])
    assert np.abs(angles).max() == pytest.approx(half_rad, rel=1e-3)
    assert wedge.visible
    region.update(np.diag([1e-4, 1e-4, 1e-8]), 0.7, now_s=1.0)
    assert not wedge.visible


def drive_along(scene: Scene, feed: RobotFeed, xs: Array) -> None:
    for x in xs:
        feed.say(pose=np.array([x, 0.0, 0.0]))
        scene.draw()


def trail_of(viewer: ViserClient) -> Array:
    """Return the segments (n, 2, 3) of the trail, along x."""
    chunks = [
        n.props["points"] for name, n in viewer.shared.items() if name.startswith("/w/k/tsd/dark/")
    ]
    segments = np.concatenate([np.reshape(points, (-1, 2, 3)) for points in chunks])
    return segments[np.argsort(segments[:, 0, 0])]


def test_the_trail_is_the_path_without_gaps(
    scene: Scene, feed: RobotFeed, viewer: ViserClient
) -> None:
    xs = np.arange(0.0, 4.0, 1.5 * paths.TRAIL_SPACING_M)
    drive_along(scene, feed, xs)
    feed.say(pose=np.array([xs[-1], 0.0, 0.0]), after_s=1.0)
    scene.draw()
    fence(scene, viewer)
    segments = trail_of(viewer)
    np.testing.assert_allclose(segments[:, 0, 0], xs[:-1], atol=1e-6)
    np.testing.assert_allclose(segments[:, 1, 0], xs[1:], atol=1e-6)


def test_only_the_newest_piece_of_the_trail_is_sent_again(
    scene: Scene, feed: RobotFeed, viewer: ViserClient
) -> None:
    step = 1.5 * paths.TRAIL_SPACING_M
    drive_along(scene, feed, np.arange(3 * paths.TRAIL_CHUNK + 1) * step)
    fence(scene, viewer)
    drive_along(scene, feed, (3 * paths.TRAIL_CHUNK + 1 + np.arange(20)) * step)
    sent = {m["name"] for m in fence(scene, viewer) if str(m["name"]).startswith("/w/k/tsd/")}
    assert sent == {"/w/k/tsd/dark/3", "/w/k/tsd/light/3"}


def test_the_trail_forgets_its_oldest_piece(scene: Scene, viewer: ViserClient) -> None:
    step = 1.5 * paths.TRAIL_SPACING_M
    path = paths.Trail(scene.server.scene, "/w/k/tsd")
    for i in range((paths.TRAIL_CHUNKS + 1) * paths.TRAIL_CHUNK + 1):
        path.update(np.array([i * step, 0.0]), now_s=i * PERIOD_S)
    fence(scene, viewer)
    segments = trail_of(viewer)
    path.clear()
    assert len(segments) == paths.TRAIL_CHUNKS * paths.TRAIL_CHUNK
    assert segments[0, 0, 0] == pytest.approx(paths.TRAIL_CHUNK * step)


def test_a_pose_that_was_set_leaves_no_line(
    scene: Scene, feed: RobotFeed, viewer: ViserClient
) -> None:
    drive_along(scene, feed, np.array([0.0, 0.1, 5.0, 5.1]))
    feed.say(pose=np.array([5.1, 0.0, 0.0]), after_s=1.0)
    scene.draw()
    fence(scene, viewer)
    np.testing.assert_allclose(trail_of(viewer)[..., 0], [[0.0, 0.1], [5.0, 5.1]], atol=1e-6)


def test_a_trail_can_be_cleared_and_begins_anew(
    scene: Scene, feed: RobotFeed, viewer: ViserClient
) -> None:
    drive_along(scene, feed, np.array([0.0, 0.1, 0.2]))
    scene.clear_trails()
    fence(scene, viewer)
    assert not [name for name in viewer.shared if name.startswith("/w/k/tsd/dark/")]
    drive_along(scene, feed, np.array([0.3, 0.4]))
    feed.say(pose=np.array([0.4, 0.0, 0.0]), after_s=1.0)
    scene.draw()
    fence(scene, viewer)
    assert trail_of(viewer)[-1, 1, 0] == pytest.approx(0.4)
