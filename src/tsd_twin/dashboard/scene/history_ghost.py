"""Past state of a robot in a client's scene."""

from __future__ import annotations

import numpy as np
import viser

from tsd_twin.client.monitor import Snapshot
from tsd_twin.dashboard.scene import appearance
from tsd_twin.dashboard.scene.appearance import PAST_NODE
from tsd_twin.dashboard.scene.robot_geometry import JointReader, RobotShape
from tsd_twin.dashboard.scene.robot_overlays import add_wireframe, set_planar_pose
from tsd_twin.dashboard.scene.robot_visual import RobotVisual
from tsd_twin.kinematics import JointKind
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.models import Link

_LABEL_ABOVE_M = 0.05
_BESIDE = 2.2
"""Distance between a sphere and its ghost, in radii of the robot."""


class HistoryGhost:
    """Ghost in a client's scene: wireframe and moving links of a robot's past state, labelled."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._frame: viser.FrameHandle | None = None
        self._label: viser.LabelHandle | None = None
        self._links: dict[Link, viser.BatchedGlbHandle] = {}
        self._reader: JointReader | None = None

    def draw(self, body: RobotVisual | None, past: Snapshot | None, ago_s: float) -> None:
        """Show the state that a robot sent `ago_s` ago; None hides the ghost."""
        shown = body is not None and past is not None and past.odom is not None
        if self._frame is not None and self._frame.visible != shown:
            self._frame.visible = shown
        if body is None or past is None or past.odom is None:
            return
        if self._frame is None:
            self._frame = self._client.scene.add_frame(PAST_NODE, show_axes=False)
            add_wireframe(
                self._client.scene,
                f"{PAST_NODE}/c",
                body.meshes.shape,
                appearance.PAST,
                visible=True,
            )
            self._reader = JointReader(body.meshes.shape.joints)
        shape, ball = body.meshes.shape, SO3.identity()
        if past.odom.wxyz is None:
            set_planar_pose(self._frame, past.odom.xy_heading)
        else:
            ball = SO3(past.odom.wxyz)
            aside_m = _BESIDE * shape.reach_m  # Otherwise it would be inside the sphere.
            self._frame.position = (float(body.pose[0]), float(body.pose[1]) - aside_m, 0.0)
        text = f"{body.id} {ago_s:.1f} s ago"
        if self._label is None:
            self._label = self._client.scene.add_label(
                f"{PAST_NODE}/n",
                text,
                position=(0.0, 0.0, shape.height_m + _LABEL_ABOVE_M),
                anchor="bottom-center",
            )
        elif self._label.text != text:
            self._label.text = text
        joints = (
            None
            if past.joints is None or self._reader is None
            else self._reader.vector(past.joints)
        )
        if joints is not None:
            self._pose(shape, joints, ball)

    def clear(self) -> None:
        """Discard this client's nodes."""
        self._frame = self._label = self._reader = None
        self._links.clear()

    def _pose(self, shape: RobotShape, joints: Array, ball: SO3) -> None:
        wheels = np.array([joint.kind is JointKind.VELOCITY for joint in shape.joints])
        poses = shape.skeleton.poses(SE2.identity(), ball, np.where(wheels, 0.0, joints))
        for kind in shape.moving:
            if kind in self._links:
                self._links[kind].batched_wxyzs = poses[kind].wxyz.astype(np.float32)
                self._links[kind].batched_positions = poses[kind].position.astype(np.float32)
            else:
                self._links[kind] = self._client.scene.add_batched_glb(
                    f"{PAST_NODE}/{kind}",
                    shape.tinted(kind, appearance.PAST),
                    *poses[kind],
                    lod="off",
                )
