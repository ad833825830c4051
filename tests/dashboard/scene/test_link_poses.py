"""Poses of drawn links against another URDF reader, and against rigid bodies."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np
import pytest
import yourdfpy
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tsd_twin import robots
from tsd_twin.dashboard.scene.robot_geometry import JointReader, LinkPoses, Skeleton, robot_shape
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages.cdr import JointState
from tsd_twin.models import kinematic_tree, load_parts, urdf

small = st.floats(-1e-9, 1e-9)
anything = st.floats(-50.0, 50.0) | small
bases = st.tuples(anything, anything, st.floats(-7.0, 7.0) | small)
turns = st.tuples(*[st.floats(-2.0, 2.0) | small] * 3)
tilts = st.lists(st.floats(-0.5, 0.5) | small, min_size=12, max_size=12)


class Model:
    """A robot with its skeleton, and its URDF in another program."""

    def __init__(self, name: str) -> None:
        self.robot: Any = robots.load_robot(name)
        self.drive: Any = self.robot.kinematics()
        self.tree = kinematic_tree(self.robot)
        self.skeleton = Skeleton(self.tree, self.drive.joints)
        text = urdf(self.robot, load_parts(self.robot))
        self.urdf = yourdfpy.URDF.load(io.BytesIO(text.encode()), load_meshes=False)

    def names(self, kind: str) -> tuple[str, ...]:
        return ("base_link",) if kind == "chassis" else self.tree.link_group(kind).names


@pytest.fixture(scope="module", params=robots.robot_names())
def model(request: pytest.FixtureRequest) -> Model:
    return Model(request.param)


def matrices(poses: LinkPoses) -> Array:
    made = np.tile(np.eye(4), (*poses.wxyz.shape[:-1], 1, 1))
    made[..., :3, :3] = SO3(poses.wxyz).as_matrix()
    made[..., :3, 3] = poses.position
    return made


@settings(max_examples=25)
@given(base=bases, angles=tilts, turn=turns)
def test_links_are_where_the_urdf_has_them(
    model: Model,
    base: tuple[float, float, float],
    angles: list[float],
    turn: tuple[float, float, float],
) -> None:
    """The footprint is at the base; URDF joints have the angles and the spin."""
    joints = np.array(angles[: len(model.drive.joints)])
    drawn = model.skeleton.poses(SE2(np.array(base)), SO3.exp(np.array(turn)), joints)
    said = {joint.name: value for joint, value in zip(model.drive.joints, joints, strict=True)}
    if model.skeleton.has_ball:
        yaw, pitch, roll = Rotation.from_rotvec(turn).as_euler("ZYX")
        said |= {
            f"sphere_turn_{n}": v
            for n, v in zip(("yaw", "pitch", "roll"), (yaw, pitch, roll), strict=True)
        }
    for name, value in said.items():
        model.urdf.update_cfg({name: value})
    x, y, heading = base
    c, s = np.cos(heading), np.sin(heading)
    floor = np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, 0], [0, 0, 0, 1]])
    for kind, poses in drawn.items():
        at = [
            floor @ model.urdf.get_transform(name, "base_footprint") for name in model.names(kind)
        ]
        np.testing.assert_allclose(matrices(poses), at, atol=1e-7)


@settings(max_examples=20)
@given(base=bases, angles=tilts, turn=turns)
def test_many_robots_at_once_are_the_same_as_one_at_a_time(
    model: Model,
    base: tuple[float, float, float],
    angles: list[float],
    turn: tuple[float, float, float],
) -> None:
    joints = np.array(angles[: len(model.drive.joints)])
    ball = SO3.exp(np.array(turn))
    two = model.skeleton.poses(
        SE2(np.array([base, (0.0, 0.0, 0.0)])),
        SO3(np.stack([ball.wxyz, SO3.identity().wxyz])),
        np.array([joints, 0.0 * joints]),
    )
    one = model.skeleton.poses(SE2(np.array(base)), ball, joints)
    for kind, poses in one.items():
        np.testing.assert_array_equal(two[kind].wxyz[0], poses.wxyz)
        np.testing.assert_array_equal(two[kind].position[0], poses.position)


@settings(max_examples=30)
@given(
    direction=st.tuples(*[st.floats(-1.0, 1.0) | small] * 3),
    share=st.floats(0.0, 0.3),
)
def test_wheels_move_floor_or_ball_as_a_rigid_body_does(
    model: Model, direction: tuple[float, float, float], share: float
) -> None:
    """v + omega x p at each contact, along the constrained directions of the wheel."""
    twist = share * np.array(direction)
    places, velocities = model.skeleton.contacts(model.drive.inverse(twist))
    if model.skeleton.has_ball:
        centre = np.array([0.0, 0.0, model.tree.height_m])
        rigid = np.cross(twist, places - centre)
    else:
        vx, vy, omega = twist
        rigid = np.array([vx, vy, 0.0]) + np.cross([0.0, 0.0, omega], places)
    if not any(group.range for group in model.tree.link_groups):
        # Along the roller axles, which for straight rollers is the driven direction.
        slant = [getattr(wheel, "roller_deg", 0.0) for wheel in model.robot.drive.wheels]
        if any(slant):
            return
        along = velocities / np.maximum(np.linalg.norm(velocities, axis=-1, keepdims=True), 1e-12)
        rigid = along * np.sum(rigid * along, axis=-1, keepdims=True)
    np.testing.assert_allclose(velocities, rigid, atol=1e-9)


TSD = robots.load_robot("tsd").kinematics()
K = len(TSD.actuators)


def message(changed: Mapping[str, str], more: tuple[str, ...] = ()) -> JointState:
    names = [changed.get(joint.name, joint.name) for joint in TSD.joints]
    position = np.append(np.tile([0.1, 0.2, np.nan], K), [5.0] * len(more))
    speed = np.append(np.tile([9.0, 9.0, 260.0], K), [5.0] * len(more))
    return JointState([*names, *more], position, speed)


@pytest.mark.parametrize("more", [(), ("gyro",)])
def test_a_joint_vector_has_angles_of_gimbals_and_speeds_of_wheels(more: tuple[str, ...]) -> None:
    """Other sensors in the message do not matter."""
    joints = JointReader(TSD.joints).vector(message({}, more))
    assert joints is not None
    np.testing.assert_array_equal(joints, np.tile([0.1, 0.2, 260.0], K))


def test_joints_of_another_robot_are_not_taken_for_ours() -> None:
    assert JointReader(TSD.joints).vector(message({"module1_alpha": "elbow"})) is None


def test_equal_descriptions_share_one_shape_however_often_they_are_read() -> None:
    shapes = [robot_shape(robots.load_robot("kiwi")) for _ in range(3)]
    assert shapes[0] is shapes[1] is shapes[2]
    renamed = msgspec.structs.replace(robots.load_robot("kiwi"), name="another")
    assert robot_shape(renamed) is not shapes[0]
