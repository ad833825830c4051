"""Where links are drawn, against the URDF as another program reads it, and rigid bodies."""

from __future__ import annotations

import io
from collections.abc import Mapping

import numpy as np
import pytest
import yourdfpy
from hypothesis import given, settings
from hypothesis import strategies as st

from tsd_twin import robots
from tsd_twin.dashboard.poses import Poses, contact_velocities, joint_vector, link_poses
from tsd_twin.description import parts, urdf
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages.ros import JointState

ROBOT = robots.load("tsd")
DRIVE = ROBOT.kinematics()
K = DRIVE.modules

small = st.floats(-1e-9, 1e-9)
angles = st.floats(-0.5, 0.5) | small
anything = st.floats(-50.0, 50.0) | small
bases = st.tuples(anything, anything, st.floats(-7.0, 7.0) | small)
gimbals = st.lists(angles, min_size=2 * K, max_size=2 * K)
turns = st.lists(st.floats(-4.0, 4.0) | small, min_size=K, max_size=K)


@pytest.fixture(scope="module")
def tree() -> yourdfpy.URDF:
    text = urdf(ROBOT, parts(ROBOT))
    return yourdfpy.URDF.load(io.BytesIO(text.encode()), load_meshes=False)


def joints_of(alpha_beta: list[float]) -> Array:
    """A joint vector; the speeds of the wheels are anything, they turn no link."""
    return np.column_stack([np.reshape(alpha_beta, (K, 2)), np.full(K, 77.0)]).reshape(-1)


def matrices(poses: Poses) -> Array:
    made = np.tile(np.eye(4), (*poses.wxyz.shape[:-1], 1, 1))
    made[..., :3, :3] = SO3(poses.wxyz).as_matrix()
    made[..., :3, 3] = poses.position
    return made


@settings(deadline=None)
@given(base=bases, alpha_beta=gimbals, turned=turns)
def test_links_are_where_the_urdf_has_them(
    tree: yourdfpy.URDF, base: tuple[float, float, float], alpha_beta: list[float], turned: Array
) -> None:
    """The footprint is where the base is; joints of the URDF are the angles, and the turns."""
    joints = joints_of(alpha_beta)
    drawn = link_poses(DRIVE, SE2(np.array(base)), joints, np.array(turned))
    for i in range(K):
        for name, value in (("alpha", joints[3 * i]), ("beta", joints[3 * i + 1])):
            tree.update_cfg({f"module{i + 1}_{name}": value})
        tree.update_cfg({f"module{i + 1}_wheel": turned[i]})
    x, y, heading = base
    c, s = np.cos(heading), np.sin(heading)
    floor = np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, 0], [0, 0, 0, 1]])
    at = {
        kind: np.array(
            [
                floor @ tree.get_transform(f"module{i + 1}_{kind}", "base_footprint")
                for i in range(K)
            ]
        )
        for kind in ("outer", "inner", "wheel")
    }
    at["chassis"] = (floor @ tree.get_transform("base_link", "base_footprint"))[None]
    for kind, poses in drawn.items():
        np.testing.assert_allclose(matrices(poses), at[kind], atol=1e-8)


@given(base=bases, alpha_beta=gimbals, turned=turns)
def test_many_robots_at_once_are_the_same_as_one_at_a_time(
    base: tuple[float, float, float], alpha_beta: list[float], turned: list[float]
) -> None:
    joints = joints_of(alpha_beta)
    two = link_poses(
        DRIVE,
        SE2(np.array([base, (0.0, 0.0, 0.0)])),
        np.array([joints, np.zeros(3 * K)]),
        np.array([turned, np.zeros(K)]),
    )
    one = link_poses(DRIVE, SE2(np.array(base)), joints, np.array(turned))
    for kind, poses in one.items():
        np.testing.assert_array_equal(two[kind].wxyz[0], poses.wxyz)
        np.testing.assert_array_equal(two[kind].position[0], poses.position)


@given(
    direction=st.tuples(*[st.floats(-1.0, 1.0) | small] * 3),
    share=st.floats(0.0, 1.0),
)
def test_wheels_move_the_ground_as_a_rigid_body_does(
    direction: tuple[float, float, float], share: float
) -> None:
    """v + omega x p at each pivot, in the axes of the robot."""
    twist = DRIVE.limit(share * np.array(direction))
    vx, vy, omega = twist
    pivots = DRIVE.pivot_radius_m * np.array(
        [(np.cos(np.radians(a)), np.sin(np.radians(a))) for a in ROBOT.drive.azimuths_deg]
    )
    expected = [(vx - omega * y, vy + omega * x) for x, y in pivots]
    seen = contact_velocities(DRIVE, DRIVE.inverse(twist))
    np.testing.assert_allclose(seen, expected, atol=1e-12)


def message(changed: Mapping[str, str]) -> JointState:
    names = [changed.get(joint.name, joint.name) for joint in DRIVE.joints]
    position = np.tile([0.1, 0.2, np.nan], K)
    return JointState(names, position, np.tile([9.0, 9.0, 260.0], K))


def test_a_joint_vector_has_angles_of_gimbals_and_speeds_of_wheels() -> None:
    joints = joint_vector(DRIVE, message({}))
    assert joints is not None
    np.testing.assert_array_equal(joints, np.tile([0.1, 0.2, 260.0], K))


def test_joints_of_another_robot_are_not_taken_for_ours() -> None:
    assert joint_vector(DRIVE, message({"module1_alpha": "elbow"})) is None
