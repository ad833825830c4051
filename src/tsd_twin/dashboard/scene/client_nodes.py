"""Nodes of a client's scene besides the shared ones: links of a robot in another pose.

They show a preview, a past state, an exaggerated tilt, or the robot of the Student tab.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import viser

from tsd_twin.client.monitor import Snapshot
from tsd_twin.dashboard.scene.appearance import (
    AXLES,
    PAST_NODE,
    ROOT,
    Palette,
    layer_nodes,
    overlay_node,
    robot_node,
)
from tsd_twin.dashboard.scene.drive_marks import (
    AxleMarks,
    PushLines,
    add_axles,
    add_setpoint_rings,
    push_strokes,
)
from tsd_twin.dashboard.scene.robot_geometry import JointReader, LinkPoses, RobotShape, robot_shape
from tsd_twin.dashboard.scene.robot_overlays import add_wireframe, set_planar_pose
from tsd_twin.dashboard.scene.robot_visual import RobotVisual, exaggerate_tilt
from tsd_twin.dashboard.scene.themed import add_lines
from tsd_twin.dashboard.scene.viser_compat import scale_instances
from tsd_twin.dashboard.wire.view import Layer, TiltFactor
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.models import Link
from tsd_twin.robots import RobotDescription

_LABEL_ABOVE_M = 0.05
_BESIDE = 2.2
"""Distance between a sphere and its ghost, in radii of the robot."""

_Poses: TypeAlias = dict[Link, LinkPoses]


def hide_links(
    client: viser.ClientHandle, body: RobotVisual, robot_id: str | None, kinds: Iterable[Link]
) -> None:
    """Hide links of a robot for a client; None shows them."""
    for kind in kinds:
        scales = body.meshes.scales_without(robot_id, kind)
        scale_instances(client, body.meshes.node(kind), scales)


class ClientLinks:
    """Links of a robot in a client's scene."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._scene = client.scene
        self._handles: dict[Link, viser.BatchedGlbHandle] = {}

    @property
    def are_drawn(self) -> bool:
        """Whether there are nodes."""
        return bool(self._handles)

    def draw(
        self, prefix: str, kinds: Iterable[Link], poses: _Poses, glb_of: Callable[[Link], bytes]
    ) -> None:
        """Show links at their poses; nodes have the name `prefix` with the kind."""
        for kind in kinds:
            wxyz = poses[kind].wxyz.reshape(-1, 4).astype(np.float32)
            position = poses[kind].position.reshape(-1, 3).astype(np.float32)
            if (handle := self._handles.get(kind)) is not None:
                handle.batched_wxyzs, handle.batched_positions = wxyz, position
            else:
                self._handles[kind] = self._scene.add_batched_glb(
                    f"{prefix}{kind}", glb_of(kind), wxyz, position, lod="off"
                )

    def set_visible(self, visible: bool) -> None:
        """Show or hide the links."""
        for handle in self._handles.values():
            handle.visible = visible

    def clear(self) -> None:
        """Forget the nodes, which a reset of the scene has removed."""
        self._handles.clear()


def _add_push_arrows(
    scene: viser.SceneApi, name: str, shape: RobotShape, joints: Array, palette: Palette
) -> PushLines | None:
    """Add arrows of the push of the wheels at joints (n,), unless none turns."""
    strokes = push_strokes(shape, *shape.skeleton.contacts(joints))
    if not len(strokes):
        return None
    arrows = PushLines(scene, name, palette.plan, palette.casing)
    arrows.update(strokes)
    return arrows


class PosePreview:
    """Pose preview in a client's scene: gimbal poses, or arrows for wheels without gimbals."""

    def __init__(self, client: viser.ClientHandle, palette: Palette) -> None:
        self._client = client
        self.palette = palette
        self._links = ClientLinks(client)
        self._arrows: PushLines | None = None

    def draw(self, body: RobotVisual, joints: Array | None) -> None:
        """Preview a joint vector (n,); None ends the preview."""
        shape = body.meshes.shape
        if not shape.tilts:
            self._point(body, joints)
        elif joints is not None:
            angles = np.where(shape.rolls, body.angles, _all_joints(shape, joints))
            poses = shape.skeleton.poses(SE2.identity(), body.ball, angles)
            prefix = f"{robot_node(body.id)}/p"
            tint = self.palette.plan
            self._links.draw(prefix, shape.moving, poses, lambda kind: shape.tinted(kind, tint))
            self._links.set_visible(True)
            hide_links(self._client, body, body.id, shape.moving)
        elif self._links.are_drawn:
            self._links.set_visible(False)
            hide_links(self._client, body, None, shape.moving)

    def forget(self, body: RobotVisual) -> None:
        """Show the links of a robot again."""
        if self._links.are_drawn:
            hide_links(self._client, body, None, body.meshes.shape.moving)

    def clear(self) -> None:
        """Forget this client's nodes."""
        self._links.clear()
        self._arrows = None

    def _point(self, body: RobotVisual, joints: Array | None) -> None:
        if self._arrows is not None:
            self._arrows.remove()
            self._arrows = None
        if joints is not None:
            name = f"{robot_node(body.id)}/pa"
            self._arrows = _add_push_arrows(
                self._client.scene, name, body.meshes.shape, joints, self.palette
            )


class HistoryGhost:
    """Ghost in a client's scene: wireframe and moving links of a robot's past state, labelled."""

    def __init__(self, client: viser.ClientHandle, palette: Palette) -> None:
        self._scene = client.scene
        self.palette = palette
        self._frame: viser.FrameHandle | None = None
        self._label: viser.LabelHandle | None = None
        self._links = ClientLinks(client)

    def draw(self, body: RobotVisual | None, past: Snapshot | None, ago_s: float) -> None:
        """Show the state that a robot sent `ago_s` ago; None hides the ghost."""
        shown = body is not None and past is not None and past.odom is not None
        if self._frame is not None and self._frame.visible != shown:
            self._frame.visible = shown
        if body is None or past is None or past.odom is None:
            return
        shape, ball = body.meshes.shape, SO3.identity()
        frame, label = self._nodes(shape)
        if past.odom.wxyz is None:
            set_planar_pose(frame, past.odom.xy_heading)
        else:
            ball = SO3(past.odom.wxyz)
            aside_m = _BESIDE * shape.reach_m  # Otherwise it would be inside the sphere.
            frame.position = (float(body.pose[0]), float(body.pose[1]) - aside_m, 0.0)
        text = f"{body.id} {ago_s:.1f} s ago"
        if label.text != text:
            label.text = text
        joints = None if past.joints is None else JointReader(shape.joints).vector(past.joints)
        if joints is not None:
            angles = np.where(shape.rolls, 0.0, joints)
            poses = shape.skeleton.poses(SE2.identity(), ball, angles)
            tint = self.palette.caution
            self._links.draw(
                f"{PAST_NODE}/", shape.moving, poses, lambda kind: shape.tinted(kind, tint)
            )

    def clear(self) -> None:
        """Forget this client's nodes."""
        self._frame = self._label = None
        self._links.clear()

    def _nodes(self, shape: RobotShape) -> tuple[viser.FrameHandle, viser.LabelHandle]:
        """Return the moving frame and the label, which are added when they are first needed."""
        if self._frame is None or self._label is None:
            self._frame = self._scene.add_frame(PAST_NODE, show_axes=False)
            name, hue = f"{PAST_NODE}/c", self.palette.caution
            add_wireframe(self._scene, name, shape, hue, visible=True)
            above = (0.0, 0.0, shape.height_m + _LABEL_ABOVE_M)
            self._label = self._scene.add_label(
                f"{PAST_NODE}/n", "", position=above, anchor="bottom-center"
            )
        return self._frame, self._label


class ExaggeratedTilt:
    """Gimbals, axles and setpoints of a robot in a client's scene, with another tilt."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self.factor = TiltFactor.FIVE
        self._client = client
        self._links = ClientLinks(client)
        self._rings: AxleMarks | None = None
        self._axles: AxleMarks | None = None

    def is_on(self, body: RobotVisual | None) -> bool:
        """Return whether this robot is drawn with another tilt than for all clients."""
        return body is not None and self.factor is not body.tilt and bool(body.meshes.shape.tilts)

    def start(self, body: RobotVisual, palette: Palette, hidden: Iterable[Layer]) -> None:
        """Create this client's nodes, after the reset of its other nodes."""
        scene, node, shape = self._client.scene, robot_node(body.id), body.meshes.shape
        if Layer.SETPOINT not in hidden:  # Otherwise the shared ones are already hidden.
            scene.add_frame(overlay_node(Layer.SETPOINT, body.id), show_axes=False, visible=False)
            self._rings = add_setpoint_rings(scene, [(f"{node}/qs", palette)], shape)
        if Layer.ARROWS not in hidden:
            scene.add_frame(f"{node}/{AXLES}", show_axes=False, visible=False)
            self._axles = add_axles(scene, [(f"{node}/qd", palette)], shape)
        self.update(body)
        self.hide_links(body, body.id)

    def update(self, body: RobotVisual) -> None:
        """Redraw the joints of a robot."""
        shape, at_s = body.meshes.shape, body.drawn.received_s
        angles = body.tilted(body.angles, self.factor)
        poses = shape.skeleton.poses(SE2.identity(), body.ball, angles)
        prefix = f"{robot_node(body.id)}/q"
        self._links.draw(prefix, shape.moving, poses, shape.glbs.__getitem__)
        if self._axles is not None:
            self._axles.update(body.tilted(body.joints, self.factor), at_s)
        if self._rings is not None and (setpoint := body.setpoint) is not None:
            self._rings.update(body.tilted(setpoint, self.factor), at_s)

    def hide_links(self, body: RobotVisual, robot_id: str | None) -> None:
        """Hide the shared links that this client draws itself; None shows them."""
        hide_links(self._client, body, robot_id, body.meshes.shape.moving)

    def set_visible(self, visible: bool) -> None:
        """Show or hide the gimbals, which a preview replaces."""
        self._links.set_visible(visible)

    def clear(self) -> None:
        """Forget this client's nodes."""
        self._links.clear()
        self._rings = self._axles = None


_HIDDEN = (Layer.SETPOINT, Layer.ARROWS, Layer.REGION, Layer.PREDICTED, Layer.ENVELOPE)
"""Layers of the selected robot that would be drawn through the other one."""
_CROSS_M = 0.06
"""Half the size of the cross at the centre of rotation."""
_CROSS_WIDTH_M = 0.006
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
    """Robot of the Student tab in a client's scene, in place of the selected robot."""

    def __init__(self, client: viser.ClientHandle, palette: Palette) -> None:
        self._client = client
        self.palette = palette
        self._pose: StudentPose | None = None
        self._shape: RobotShape | None = None
        self._links = ClientLinks(client)
        self._marks: list[viser.SceneNodeHandle | PushLines] = []
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
        """Forget this client's nodes and show the replaced robot again, if it is in `bodies`."""
        replaced = self._replaced
        if replaced is not None and any(replaced is body for body in bodies):
            hide_links(self._client, replaced, None, replaced.meshes.shape.glbs)
        self._links.clear()
        self._marks.clear()
        self._replaced = None

    def draw(self, body: RobotVisual | None, tilt: TiltFactor) -> None:
        """Draw the pose at the place of the selected robot, which is hidden."""
        shape, pose = self._shape, self._pose
        if shape is None or pose is None:
            return
        parent = ROOT if body is None else robot_node(body.id)
        if body is not None and self._replaced is not body:
            for layer in _HIDDEN:
                for node in layer_nodes(layer, [body.id]):
                    self._client.scene.add_frame(node, show_axes=False, visible=False)
            hide_links(self._client, body, body.id, body.meshes.shape.glbs)
            self._replaced = body
        joints = exaggerate_tilt(pose.joints, tilt.number) if shape.tilts else pose.joints
        angles = np.where(shape.rolls, 0.0, _all_joints(shape, joints))
        poses = shape.skeleton.poses(SE2.identity(), SO3.identity(), angles)
        tint = self.palette.plan
        self._links.draw(f"{parent}/v", shape.glbs, poses, lambda kind: shape.tinted(kind, tint))
        self._draw_marks(parent, shape, pose)

    def _draw_marks(self, parent: str, shape: RobotShape, pose: StudentPose) -> None:
        for mark in self._marks:
            mark.remove()
        self._marks.clear()
        scene, joints = self._client.scene, _all_joints(shape, pose.joints)
        arrows = _add_push_arrows(scene, f"{parent}/va", shape, joints, self.palette)
        if arrows is not None:
            self._marks.append(arrows)
        if pose.centre is not None and np.hypot(*pose.centre) <= _FARTHEST_M:
            cross = _CROSS_M * np.array([[[-1, 0, 0], [1, 0, 0]], [[0, -1, 0], [0, 1, 0]]])
            lines = cross + np.array([*pose.centre, _LIFT_M])
            line = lines, self.palette.plan, _CROSS_WIDTH_M
            self._marks.append(add_lines(scene, f"{parent}/vc", *line))


def _all_joints(shape: RobotShape, joints: Array) -> Array:
    """Return all drawn joints: those of the drive (n,), then measured ones at zero."""
    return np.append(joints, np.zeros(len(shape.joints) - len(joints)))
