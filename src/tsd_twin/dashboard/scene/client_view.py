"""Client-specific scene: hidden layers, followed robot, camera, and the pose preview."""

from __future__ import annotations

import math
import threading

import numpy as np
import viser

from tsd_twin.client.monitor import Snapshot
from tsd_twin.dashboard.scene import appearance
from tsd_twin.dashboard.scene.appearance import (
    ROOT,
    disable_shadows_and_reflections,
    layer_nodes,
    robot_node,
)
from tsd_twin.dashboard.scene.history_ghost import HistoryGhost
from tsd_twin.dashboard.scene.overlays import ARROW_HEAD_M, MIN_ARROW_SPEED_MPS, arrow_points
from tsd_twin.dashboard.scene.picking import floor_points, sphere_point
from tsd_twin.dashboard.scene.robot_overlays import add_wireframe
from tsd_twin.dashboard.scene.robot_visual import ExaggeratedTilt, RobotVisual, hide_links
from tsd_twin.dashboard.scene.scene import Scene
from tsd_twin.dashboard.scene.student_robot import StudentPose, StudentRobot
from tsd_twin.dashboard.scene.viser_compat import CAMERA_OFFSET_M, LOOK_AT_M
from tsd_twin.dashboard.wire.view import CameraPreset, Layer, TruePoseDisplay, ViewSettings
from tsd_twin.kinematics import JointKind
from tsd_twin.lie import SE2, Array
from tsd_twin.models import Link


class PosePreview:
    """Pose preview in a client's scene: gimbal poses, or arrows for wheels without gimbals."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._links: dict[Link, viser.BatchedGlbHandle] = {}
        self._arrows: viser.ArrowsHandle | None = None

    def draw(self, body: RobotVisual, joints: Array | None) -> None:
        """Preview a joint vector (n,); None ends the preview."""
        if not body.meshes.shape.tilts:
            self._point(body, joints)
        elif joints is not None:
            self._pose(body, joints)
        elif self._links:
            for handle in self._links.values():
                handle.visible = False
            hide_links(self._client, body, None)

    def forget(self, body: RobotVisual) -> None:
        """Discard this client's nodes and show the robot's links again."""
        if self._links:
            hide_links(self._client, body, None)

    def clear(self) -> None:
        """Discard this client's nodes."""
        self._links.clear()
        self._arrows = None

    def _point(self, body: RobotVisual, joints: Array | None) -> None:
        if self._arrows is not None:
            self._arrows.remove()
            self._arrows = None
        if joints is None:
            return
        places, velocities = body.meshes.shape.skeleton.contacts(joints)
        speeds = np.linalg.norm(velocities, axis=-1)
        fast = speeds >= MIN_ARROW_SPEED_MPS
        if fast.any():
            self._arrows = self._client.scene.add_arrows(
                f"{robot_node(body.id)}/pa",
                arrow_points(places[fast], velocities[fast], speeds[fast]),
                appearance.PREVIEW,
                shaft_radius=0.005,
                head_radius=0.013,
                head_length=ARROW_HEAD_M,
            )

    def _pose(self, body: RobotVisual, joints: Array) -> None:
        shape = body.meshes.shape
        wheels = np.array([joint.kind is JointKind.VELOCITY for joint in shape.kinematics.joints])
        angles = np.where(wheels, body.angles, joints)
        poses = shape.skeleton.poses(SE2.identity(), body.ball, angles)
        for kind in shape.moving:
            if kind not in self._links:
                self._links[kind] = self._client.scene.add_batched_glb(
                    f"{robot_node(body.id)}/p{kind}",
                    shape.tinted(kind, appearance.PREVIEW),
                    *poses[kind],
                    lod="off",
                )
            self._links[kind].batched_wxyzs = poses[kind].wxyz.astype(np.float32)
            self._links[kind].visible = True
        hide_links(self._client, body, body.id)


_LOOK_AT_TOLERANCE_M = 0.05
"""A camera that looks at a point this close to the robot still follows it."""


class ClientView:
    """Scene of a client: its nodes override the shared ones."""

    def __init__(self, scene: Scene, client: viser.ClientHandle, *, plain: bool = False) -> None:
        """`plain` is for browsers without a graphics card."""
        self._no_gpu = plain
        if plain:
            disable_shadows_and_reflections(client.scene)
        self._scene = scene
        self._client = client
        self._robot_id = scene.default_robot_id
        self._requested_id: str | None = None
        self._settings = ViewSettings()
        self._fixed_world_xy: tuple[float, float] | None = None
        self._world: viser.FrameHandle | None = None
        self._has_own_world = False
        self._preview_joints: Array | None = None
        self._preview = PosePreview(client)
        self._tilt = ExaggeratedTilt(client)
        self._past: tuple[Snapshot | None, float] = None, 0.0
        self._ghost = HistoryGhost(client)
        self._student = StudentRobot(client)

    # Selection and camera.

    @property
    def lock(self) -> threading.RLock:
        """Lock for a group of related changes."""
        return self._scene.lock

    @property
    def robot_id(self) -> str | None:
        """Selected robot, which the camera follows."""
        return self._robot_id

    @property
    def robot_ids(self) -> tuple[str, ...]:
        """All robots in the scene."""
        return tuple(self._scene.visuals)

    @property
    def visual(self) -> RobotVisual | None:
        """Visual of the selected robot, or None."""
        return self._scene.visuals.get(self._robot_id or "")

    def select_robot(self, robot_id: str) -> None:
        """Select a robot, now or as soon as it appears."""
        with self._scene.lock:
            self._requested_id = robot_id
            self.on_robots_changed()

    def _bring_into_view(self) -> None:
        """Move the selected robot to the place of a followed robot, and look at it.

        The camera keeps its direction and distance.
        """
        if self._fixed_world_xy is not None:
            self._fixed_world_xy = self._followed_world_xy
        camera = self._client.camera
        aside, back = camera.look_at - LOOK_AT_M, camera.position - camera.look_at
        if not (np.isfinite([aside, back]).all() and back.any()):
            return  # Clients may send invalid cameras.
        if np.linalg.norm(aside) > _LOOK_AT_TOLERANCE_M:
            camera.position = LOOK_AT_M + back  # This also moves the point it looks at.

    def _place_camera(self) -> None:
        """Point the camera at the robot according to the preset."""
        body, world, camera = self.visual, self._world_pose, self._settings.camera
        at = SE2.identity() if body is None else world @ SE2(body.pose)
        offset = np.array(CAMERA_OFFSET_M)
        if camera is CameraPreset.TOP:
            offset = np.array([-0.01, 0.0, 1.3])
        elif camera is CameraPreset.CHASE:
            offset = np.array([*at.rotate(np.array([-0.85, 0.0])), 0.42])
        middle = np.append(at.xy_heading[:2], 0.0)
        with self._client.atomic():
            self._client.camera.position = middle + offset
            self._client.camera.look_at = middle + LOOK_AT_M
        self._client.flush()

    def pick_sphere(self, origin: Array, direction: Array) -> tuple[float, float, float] | None:
        """Return the point of the sphere hit by a ray (3,), (3,) of this client."""
        body = self.visual
        radius_m = None if body is None else body.meshes.shape.ball_radius_m
        if body is None or radius_m is None:
            return None
        x, y = self._world_pose.xy_heading[:2]  # The world frame is never rotated for spheres.
        height_m = body.meshes.shape.skeleton.tree.height_m
        centre = np.array([x + body.pose[0], y + body.pose[1], height_m])
        return sphere_point(origin, direction, centre, radius_m, body.ball)

    def pick_floor(self, shares: Array) -> Array:
        """Return floor points (m, 2) in `odom` at screen positions, see `floor_points`."""
        camera = self._client.camera
        met = floor_points(camera.position, camera.wxyz, camera.fov, camera.aspect, shares)
        return self._world_pose.inverse().transform(met)

    # Settings.

    @property
    def settings(self) -> ViewSettings:
        """Active settings."""
        return self._settings

    def apply(self, settings: ViewSettings, *, look: bool = False) -> None:
        """Apply all settings; `look` points the camera at the robot, like changing the preset."""
        with self._scene.lock:
            before = self._settings
            if settings.follow != before.follow:
                self._fixed_world_xy = None if settings.follow else self._followed_world_xy
            self._settings = settings
            self.on_robots_changed()
            turns_otherwise = settings.camera is CameraPreset.CHASE and (
                settings.follow != before.follow
            )
            if look or settings.camera != before.camera or turns_otherwise:
                self._place_camera()

    # Preview.

    def set_preview(self, joints: Array | None) -> None:
        """Preview a joint vector (n,) for this client only; None ends the preview.

        It poses gimbals; for wheels without gimbals, arrows show direction and speed.
        """
        with self._scene.lock:
            self._preview_joints = joints
            self._draw_preview()
            body = self.visual
            if joints is None and body is not None and self._tilt.is_on(body):
                self._tilt.update(body)
                hide_links(self._client, body, body.id)  # Ending the preview has shown them.
        self._client.flush()

    def preview(self, robot_id: str, joints: Array | None) -> None:
        """Preview joints as in `set_preview`, unless another robot is selected."""
        with self._scene.lock:
            if robot_id == self._robot_id:
                self.set_preview(joints)

    def show_student(self, pose: StudentPose | None) -> None:
        """Draw a robot in place of the selected one for this client; None ends that."""
        with self._scene.lock:
            if self._student.set(pose):
                self.on_robots_changed()
                return
            with self._client.atomic():
                self._student.draw(self.visual, self._tilt)
        self._client.flush()

    # History.

    def show_past(self, past: Snapshot | None, ago_s: float) -> None:
        """Draw the past state of the selected robot for this client; None hides it."""
        with self._scene.lock, self._client.atomic():
            self._past = past, ago_s
            self._ghost.draw(self.visual, *self._past)
        self._client.flush()

    def _draw_preview(self) -> None:
        body, joints = self.visual, self._preview_joints
        if body is None:
            return
        if joints is not None and self._tilt.is_on(body):
            joints = self._tilt.applied(joints)
        self._tilt.set_visible(joints is None)
        self._preview.draw(body, joints)

    # Callbacks of the scene.

    def on_robots_moved(self) -> None:
        """Move this client's world frame, unless it follows the default robot."""
        moves_world = self._world is not None and self._fixed_world_xy is None
        body = self.visual
        if body is not None and self._tilt.is_on(body) and self._preview_joints is None:
            with self._client.atomic():
                self._tilt.update(body)
        elif not moves_world:
            return
        if self._world is not None and moves_world:
            self._move_world(self._world)
        self._client.flush()

    def on_robots_changed(self) -> None:
        """Rebuild this client's nodes after a change of robots or settings."""
        own = self._client.scene
        with self._client.atomic():
            for body in self._scene.visuals.values():
                self._preview.forget(body)
                if self._tilt.is_on(body):
                    hide_links(self._client, body, None)
            self._student.clear(self._scene.visuals.values())
            own.reset()
            self._preview.clear()
            self._tilt.clear()
            self._ghost.clear()
            self._tilt.factor = self._settings.tilt
            self._select_available()
            self._world = self._add_world(own)
            if self._no_gpu:
                disable_shadows_and_reflections(own)
            self._hide_layers(own)
            body = self.visual
            if body is not None and self._tilt.is_on(body):
                self._tilt.start(body, rings=Layer.SETPOINT not in self._settings.hidden)
            if self._preview_joints is not None:
                self._draw_preview()
            self._ghost.draw(body, *self._past)
            if self._student.is_shown:
                self._tilt.set_visible(False)
                self._student.draw(body, self._tilt)
        self._client.flush()

    def _add_world(self, own: viser.SceneApi) -> viser.FrameHandle | None:
        """Add this client's world frame; once added, it is always kept.

        viser drops the removal of a node that is immediately added again, and does not send a zero
        pose, so the browser would keep the previous pose. An ancestor that viser adds for this
        client's nodes has the same effect. Therefore this client never removes its frame, and sends
        its pose even if it is zero.
        """
        followed = self._robot_id == self._scene.default_robot_id
        if self._fixed_world_xy is not None or not followed or self._is_chasing:
            self._has_own_world = True
        if not self._has_own_world:
            return None
        x, y, _ = self._world_pose.xy_heading
        upside_down = (0.0, 1.0, 0.0, 0.0)  # Differs from any rotation about z.
        world = own.add_frame(ROOT, show_axes=False, position=(x + 1.0, y, 0.0), wxyz=upside_down)
        self._move_world(world)
        return world

    def _move_world(self, world: viser.FrameHandle) -> None:
        x, y, heading = (float(number) for number in self._world_pose.xy_heading)
        world.position = (x, y, 0.0)
        world.wxyz = (math.cos(0.5 * heading), 0.0, 0.0, math.sin(0.5 * heading))

    def _select_available(self) -> None:
        """Select the chosen robot, or the first available one while it is missing."""
        bodies = self._scene.visuals
        shown = next(
            (each for each in (self._requested_id, self._robot_id) if each in bodies), None
        )
        shown = shown or self._scene.default_robot_id
        if shown != self._robot_id:
            self._robot_id, self._preview_joints = shown, None
            self._past = None, 0.0
            self._bring_into_view()

    def _hide_layers(self, own: viser.SceneApi) -> None:
        hidden = set(self._settings.hidden)
        if self._settings.true_pose is TruePoseDisplay.NEVER:
            hidden.add(Layer.TRUTH)
        for layer in hidden:
            for node in layer_nodes(layer, self._scene.visuals):
                own.add_frame(node, show_axes=False, visible=False)
        if self._settings.true_pose is TruePoseDisplay.ALWAYS:
            for body in self._scene.visuals.values():
                name = body.overlays.truth.wireframe_name
                add_wireframe(own, name, body.meshes.shape, appearance.TRUTH, visible=True)

    @property
    def _is_chasing(self) -> bool:
        """Whether the world turns under the robot; a sphere has no heading."""
        body = self.visual
        return (
            self._settings.camera is CameraPreset.CHASE
            and self._fixed_world_xy is None
            and body is not None
            and body.kinematics.pose_type is SE2
        )

    @property
    def _world_pose(self) -> SE2:
        """Pose of `odom` in this client's scene."""
        body = self.visual
        if body is not None and self._is_chasing:
            return SE2(body.pose).inverse()
        return SE2(np.array([*(self._fixed_world_xy or self._followed_world_xy), 0.0]))

    @property
    def _followed_world_xy(self) -> tuple[float, float]:
        """Origin of `odom` in the scene that keeps the selected robot in place."""
        body = self.visual
        if body is None or body.id == self._scene.default_robot_id:
            return self._scene.world_xy
        return -float(body.pose[0]), -float(body.pose[1])
