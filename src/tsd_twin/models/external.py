"""Model of an external ROS robot from its description: parts, kinematic tree.

`external_urdf` reads the shape in the description from a URDF.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from manifold3d import Manifold

from tsd_twin.lie import SO3, Array
from tsd_twin.models.links import (
    JointLimits,
    JointType,
    KinematicTree,
    Link,
    LinkGroup,
    from_roll_pitch_yaw,
)
from tsd_twin.models.solids import Drawing, Material, Parts, drawn
from tsd_twin.robots import ExternalDescription
from tsd_twin.robots.external import ExternalJoint, ExternalPart

_SEGMENTS = 32
_PLACEHOLDER_KG = 1.0
"""Placeholder mass of each link in the generated URDF."""
_WIDE_LIMITS = JointLimits(1000.0, 1000.0, 1000.0)
"""Placeholder limits in the generated URDF, whose joints only display measurements."""


@dataclass(frozen=True, slots=True)
class FramePose:
    """Pose of a frame in another one."""

    at: Array
    turn: SO3

    def __matmul__(self, other: FramePose) -> FramePose:
        return FramePose(self.at + self.turn.rotate(other.at), self.turn @ other.turn)


def frame_pose(entry: ExternalPart | ExternalJoint) -> FramePose:
    """Return the pose of a part or joint in the frame of its parent."""
    return FramePose(np.array(entry.at_m), from_roll_pitch_yaw(np.radians(entry.rpy_deg)))


def draw(robot: ExternalDescription) -> Parts:
    """Return the parts of the base and of each joint, in the frame of the joint."""
    parts: Parts = {}
    for kind, on in _kinds(robot):
        mine = [part for part in robot.drive.parts if part.on == on]
        # A joint without parts may carry others that have some.
        shown = mine or [ExternalPart(shape="box", size_m=(0.002, 0.002, 0.002))]
        parts[kind] = drawn(kind, (_drawing(f"p{i}", part) for i, part in enumerate(shown)))
    return parts


def tree(robot: ExternalDescription) -> KinematicTree:
    """Return the tree of joints, with a separate kind of link for each."""
    kinds = {on: kind for kind, on in _kinds(robot)}
    groups: list[LinkGroup] = []
    for joint in robot.drive.joints:
        pose = frame_pose(joint)
        groups.append(
            LinkGroup(
                kind=kinds[joint.name],
                names=(kinds[joint.name],),
                joints=(joint.name,),
                parent=kinds[joint.on],
                at_m=pose.at[None],
                turn=SO3(pose.turn.wxyz[None]),
                joint_type=JointType.SLIDE if joint.slides else JointType.ANGLE,
                axes=np.array([joint.axis]),
                range=_WIDE_LIMITS,
            )
        )
    return KinematicTree(robot.drive.height_m, tuple(groups), core_m=0.0)


def masses_kg(robot: ExternalDescription) -> dict[Link, float]:
    """Return a placeholder mass for each kind of link."""
    return {kind: _PLACEHOLDER_KG for kind, _ in _kinds(robot)}


def _kinds(robot: ExternalDescription) -> list[tuple[Link, str]]:
    """Return the kinds of links, each with the joint that moves it."""
    joints = ((f"link{i + 1}", joint.name) for i, joint in enumerate(robot.drive.joints))
    return [("chassis", ""), *joints]


def _drawing(name: str, part: ExternalPart) -> Drawing:
    x, y, z = (1000.0 * size for size in part.size_m)
    if part.shape == "box":
        solid = Manifold.cube((x, y, z), True)
    elif part.shape == "cylinder":
        solid = Manifold.cylinder(z, 0.5, 0.5, _SEGMENTS, True).scale((x, y, 1.0))
    else:
        solid = Manifold.sphere(0.5, _SEGMENTS).scale((x, y, z))
    pose = frame_pose(part)
    solid = solid.transform(np.hstack([pose.turn.as_matrix(), 1000.0 * pose.at[:, None]]))
    return Drawing(name, solid, Material(part.colour_rgba, 0.1, 0.6, 1000.0))
