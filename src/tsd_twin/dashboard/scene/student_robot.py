"""Robot of the Student tab in a client's scene, in place of the selected robot."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import viser

from tsd_twin.dashboard.scene import appearance
from tsd_twin.dashboard.scene.appearance import ROOT, layer_nodes, robot_node
from tsd_twin.dashboard.scene.overlays import (
    ARROW_HEAD_M,
    MIN_ARROW_SPEED_MPS,
    add_lines,
    arrow_points,
)
from tsd_twin.dashboard.scene.robot_geometry import RobotShape, robot_shape
from tsd_twin.dashboard.scene.robot_visual import ExaggeratedTilt, RobotVisual
from tsd_twin.dashboard.scene.viser_compat import scale_instances
from tsd_twin.dashboard.wire.view import Layer
from tsd_twin.kinematics import JointKind
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.models import Link
from tsd_twin.robots import RobotDescription

_HIDDEN = (Layer.SETPOINT, Layer.ARROWS, Layer.REGION, Layer.PREDICTED, Layer.ENVELOPE)
"""Layers of the selected robot that would be drawn through the other one."""
_CROSS_M = 0.06
"""Half the size of the cross at the centre of rotation."""
_FARTHEST_M = 20.0
"""A centre of rotation farther away is not drawn."""
_LIFT_M = 0.003


@dataclass(frozen=True, slots=True, eq=False)
class StudentPose:
    """Robot to draw with its joints."""

    robot: RobotDescription
    joints: Array
    """(n,): joint vector of its drive."""
    centre: tuple[float, float] | None
    """Instantaneous centre of rotation in `base_link`, metres."""


class StudentRobot:
    """Nodes of the Student tab's robot in a client's scene."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._pose: StudentPose | None = None
        self._shape: RobotShape | None = None
        self._links: dict[Link, viser.BatchedGlbHandle] = {}
        self._marks: list[viser.SceneNodeHandle] = []
        self._replaced: RobotVisual | None = None

    def set(self, pose: StudentPose | None) -> bool:
        """Set the pose to draw; return whether the nodes must be made again.

        A changed description takes 0.1 s.

        Raises:
            TwinError: As in `robot_shape`.
        """
        shape = None if pose is None else robot_shape(pose.robot)
        changed, self._shape = shape is not self._shape, shape
        self._pose = pose
        return changed

    @property
    def is_shown(self) -> bool:
        """Whether the selected robot is replaced."""
        return self._pose is not None

    def clear(self, bodies: Iterable[RobotVisual]) -> None:
        """Discard this client's nodes and show the replaced robot again, if it is in `bodies`."""
        if self._replaced is not None and any(self._replaced is body for body in bodies):
            _hide(self._client, self._replaced, None)
        self._links.clear()
        self._marks.clear()
        self._replaced = None

    def draw(self, body: RobotVisual | None, tilt: ExaggeratedTilt) -> None:
        """Draw the pose at the place of the selected robot, which is hidden."""
        shape, pose = self._shape, self._pose
        if shape is None or pose is None:
            return
        parent = ROOT if body is None else robot_node(body.id)
        if body is not None and self._replaced is not body:
            for layer in _HIDDEN:
                for node in layer_nodes(layer, [body.id]):
                    self._client.scene.add_frame(node, show_axes=False, visible=False)
            _hide(self._client, body, body.id)
            self._replaced = body
        self._draw_links(parent, shape, tilt.applied(pose.joints) if shape.tilts else pose.joints)
        self._draw_marks(parent, shape, pose)

    def _draw_links(self, parent: str, shape: RobotShape, joints: Array) -> None:
        rolls = np.array([joint.kind is JointKind.VELOCITY for joint in shape.kinematics.joints])
        angles = _all_joints(shape, np.where(rolls, 0.0, joints))
        poses = shape.skeleton.poses(SE2.identity(), SO3.identity(), angles)
        for kind in shape.glbs:
            if kind in self._links:
                self._links[kind].batched_wxyzs = poses[kind].wxyz.astype(np.float32)
                self._links[kind].batched_positions = poses[kind].position.astype(np.float32)
            else:
                self._links[kind] = self._client.scene.add_batched_glb(
                    f"{parent}/v{kind}",
                    shape.tinted(kind, appearance.PREVIEW),
                    poses[kind].wxyz.reshape(-1, 4),
                    poses[kind].position.reshape(-1, 3),
                    lod="off",
                )

    def _draw_marks(self, parent: str, shape: RobotShape, pose: StudentPose) -> None:
        for mark in self._marks:
            mark.remove()
        self._marks.clear()
        places, velocities = shape.skeleton.contacts(_all_joints(shape, pose.joints))
        speeds = np.linalg.norm(velocities, axis=-1)
        fast = speeds >= MIN_ARROW_SPEED_MPS
        if fast.any():
            arrows = self._client.scene.add_arrows(
                f"{parent}/va",
                arrow_points(places[fast], velocities[fast], speeds[fast]),
                appearance.PREVIEW,
                shaft_radius=0.005,
                head_radius=0.013,
                head_length=ARROW_HEAD_M,
            )
            self._marks.append(arrows)
        if pose.centre is not None and np.hypot(*pose.centre) <= _FARTHEST_M:
            cross = _CROSS_M * np.array([[[-1, 0, 0], [1, 0, 0]], [[0, -1, 0], [0, 1, 0]]])
            lines = cross + np.array([*pose.centre, _LIFT_M])
            node = f"{parent}/vc"
            self._marks.append(add_lines(self._client.scene, node, lines, appearance.PREVIEW, 3.0))


def _all_joints(shape: RobotShape, joints: Array) -> Array:
    """Return all drawn joints: those of the drive (n,), then measured ones at zero."""
    values = np.zeros(len(shape.joints))
    values[: len(joints)] = joints
    return values


def _hide(client: viser.ClientHandle, body: RobotVisual, robot_id: str | None) -> None:
    """Hide all links of a robot for a client; None shows them."""
    for kind in body.meshes.shape.glbs:
        scales = body.meshes.scales_without(robot_id, kind)
        scale_instances(client, body.meshes.node(kind), scales)
