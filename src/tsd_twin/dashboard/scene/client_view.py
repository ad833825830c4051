"""Client-specific scene: hidden layers, followed robot, camera, and the pose preview."""

from __future__ import annotations

import numpy as np
import viser
from numpy.typing import NDArray

from tsd_twin.client.monitor import Snapshot
from tsd_twin.dashboard.scene.appearance import (
    PALETTES,
    ROOT,
    TRUE_POSES,
    Palette,
    Theme,
    layer_nodes,
)
from tsd_twin.dashboard.scene.client_filter import shared_filter
from tsd_twin.dashboard.scene.client_nodes import (
    ExaggeratedTilt,
    HistoryGhost,
    PosePreview,
    StudentPose,
    StudentRobot,
)
from tsd_twin.dashboard.scene.framing import ClientCamera, Rectangle
from tsd_twin.dashboard.scene.metres import MetreLabels, in_odom, metre_places
from tsd_twin.dashboard.scene.picking import floor_points, off_screen_direction, sphere_point
from tsd_twin.dashboard.scene.robot_overlays import add_wireframe, set_planar_pose
from tsd_twin.dashboard.scene.robot_visual import RobotVisual
from tsd_twin.dashboard.scene.scene import Scene
from tsd_twin.dashboard.scene.stage import GroundPictures, add_ground, add_lights
from tsd_twin.dashboard.scene.viser_compat import FIELD_OF_VIEW_RAD, change_filter, set_theme
from tsd_twin.dashboard.wire.to_page import CameraState
from tsd_twin.dashboard.wire.view import CameraPreset, Layer, TruePoseDisplay, ViewSettings
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.pictures import GroundGrid

_LABEL_STEP_M, _LABEL_TURN_RAD = 0.25, 0.35
"""Motions of the robot after which the metre labels are placed again."""


class ClientView:
    """Scene of a client: its nodes override the shared ones."""

    def __init__(
        self,
        scene: Scene,
        client: viser.ClientHandle,
        page: str | None,
        *,
        dark: bool,
        plain: bool,
        frame: Rectangle,
        visible: frozenset[str] | None,
    ) -> None:
        """`page` has the id of the client's page, if known, and `frame` is free of its parts.

        `plain` is for browsers without a graphics card; `visible` are the robots that the client
        may show, None for all.
        """
        self._visible = visible
        self._no_gpu = plain
        self._prefers_dark = dark
        self._scene = scene
        self.client = client
        """Its viser client."""
        self.page = page
        self._robot_id: str | None = None
        self._requested_id: str | None = None
        self._settings = ViewSettings()
        self._fixed_world_xy: tuple[float, float] | None = None
        self._world: viser.FrameHandle | None = None
        self._sent_world = np.full(3, np.nan)
        # The shared world shows where the first robot is, so it is not sent to limited clients.
        self._has_own_world = visible is not None
        self._preview_joints: Array | None = None
        self._preview = PosePreview(client, self._palette)
        self._tilt = ExaggeratedTilt(client)
        self._past: tuple[Snapshot | None, float] = None, 0.0
        self._ghost = HistoryGhost(client, self._palette)
        self._student = StudentRobot(client, self._palette)
        self._ground_pictures = GroundPictures(client)
        self._camera = ClientCamera(client, frame)
        self._metres = MetreLabels(client)
        self._labelled: tuple[int, ...] | None = None
        self._has_reported_placed = False
        self.on_robots_changed()
        client.camera.on_update(self._on_camera)

    # Selection and camera.

    @property
    def robot_id(self) -> str | None:
        """Selected robot, which the camera follows."""
        return self._robot_id

    @property
    def visual(self) -> RobotVisual | None:
        """Visual of the selected robot, or None."""
        return self._scene.visuals.get(self._robot_id or "")

    def select_robot(self, robot_id: str) -> None:
        """Select a robot, now or as soon as it appears."""
        with self._scene.lock:
            self._requested_id = robot_id
            self.on_robots_changed()

    def set_frame(self, frame: Rectangle) -> None:
        """Set the part of the picture that nothing covers; an untouched camera is placed again."""
        with self._scene.lock:
            if self._camera.set_frame(frame):
                self._place_camera()

    async def _on_camera(self, _: viser.CameraHandle) -> None:
        """Frame the robot again after a change of the window, unless the user moved the camera."""
        with self._scene.lock:
            if self._camera.is_out_of_shape or self._camera.is_reset:
                self._place_camera()
            elif self._camera.is_reported:
                self._has_reported_placed = True

    def _place_camera(self) -> None:
        """Frame the robot according to the preset."""
        body = self.visual
        if body is None:
            return
        at = self._world_pose @ SE2(body.pose)
        with self.client.atomic():
            planar = body.kinematics.pose_type is SE2
            self._camera.place(body.meshes.shape, at, self._settings.camera, planar=planar)
            if body.drawn.odom is not None:
                self._camera.placed_for = body.id
            add_lights(self.client.scene, self._theme, self._camera.heading_rad, plain=self._no_gpu)
            self._labelled = None
            self._label_metres(body)
        self.client.flush()

    def _place_at_first_sight(self, body: RobotVisual) -> None:
        """Frame a robot as soon as its pose is known."""
        if self._camera.placed_for != body.id and body.drawn.odom is not None:
            self._place_camera()

    def _label_metres(self, body: RobotVisual) -> None:
        """Label the lines around the robot, if it or the view has moved far enough."""
        placed, world = self._camera.placed, self._world_pose
        if placed is None:
            return
        x, y = float(body.pose[0]), float(body.pose[1])
        turned = round(float(world.xy_heading[2]) / _LABEL_TURN_RAD)
        key = (round(x / _LABEL_STEP_M), round(y / _LABEL_STEP_M), turned)
        if key == self._labelled:
            return
        self._labelled = key
        pose = in_odom(placed, world)
        places = metre_places(
            (x, y), pose, self._camera.aspect, FIELD_OF_VIEW_RAD, self._camera.frame
        )
        self._metres.update(places, pose, self._camera.px_per_m, self._palette.label)

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
        camera = self.client.camera
        met = floor_points(camera.position, camera.wxyz, camera.fov, camera.aspect, shares)
        return self._world_pose.inverse().transform(met)

    @property
    def camera_state(self) -> CameraState | None:
        """State of the camera; None until the client reports it in front of a robot.

        A slow client has then received the scene, which was sent before.
        """
        body, camera = self.visual, self.client.camera
        if body is None or not self._has_reported_placed:
            return None
        x, y = (self._world_pose @ SE2(body.pose)).xy_heading[:2]
        at = np.array([x, y, 0.5 * body.meshes.shape.height_m])
        placed = camera.position, camera.wxyz, camera.fov, camera.aspect
        return CameraState(off_screen_direction(*placed, at))

    # Settings.

    @property
    def _theme(self) -> Theme:
        dark = self._settings.dark
        return Theme.DARK if (self._prefers_dark if dark is None else dark) else Theme.LIGHT

    @property
    def _palette(self) -> Palette:
        return PALETTES[self._theme]

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
            if settings.dark != before.dark:
                set_theme(self.client.gui, dark=self._theme is Theme.DARK)
                change_filter(self.client, shared_filter(self._visible, self._theme))
            self.on_robots_changed()
            turns_otherwise = settings.camera is CameraPreset.CHASE and (
                settings.follow != before.follow
            )
            if look or settings.camera != before.camera or turns_otherwise:
                self._place_camera()

    # Preview.

    def show_preview(self, robot_id: str, joints: Array | None) -> None:
        """Preview a joint vector (n,) for this client only; None ends the preview.

        It poses gimbals; for wheels without gimbals, arrows show direction and speed. Without
        effect if another robot is selected.
        """
        with self._scene.lock:
            if robot_id != self._robot_id:
                return
            self._preview_joints = joints
            self._draw_preview()
            body = self.visual
            if joints is None and body is not None and self._tilt.is_on(body):
                self._tilt.update(body)
                self._tilt.hide_links(body, body.id)  # Ending the preview has shown them.
        self.client.flush()

    def show_student(self, pose: StudentPose | None) -> None:
        """Draw a robot in place of the selected one for this client; None ends that."""
        with self._scene.lock:
            if self._student.set(pose):
                self.on_robots_changed()
                return
            with self.client.atomic():
                self._student.draw(self.visual, self._settings.tilt)
        self.client.flush()

    # Cameras above the floor.

    @property
    def shows_ground(self) -> bool:
        """Whether it shows pictures of cameras above the floor, on which are all robots."""
        return self._visible is None and self._settings.floor_camera

    def draw_ground(
        self, key: str, picture: NDArray[np.uint8] | None, grid: GroundGrid | None
    ) -> None:
        """Draw the picture (h, w, 3) of a camera on the floor; None removes it."""
        shown = picture if self.shows_ground else None
        with self.client.atomic():
            self._ground_pictures.draw(key, shown, grid)
        self.client.flush()

    # History.

    def show_past(self, past: Snapshot | None, ago_s: float) -> None:
        """Draw the past state of the selected robot for this client; None hides it."""
        with self._scene.lock, self.client.atomic():
            self._past = past, ago_s
            self._ghost.draw(self.visual, *self._past)
        self.client.flush()

    def _draw_preview(self) -> None:
        body, joints = self.visual, self._preview_joints
        if body is None:
            return
        if joints is not None:
            joints = body.tilted(joints, self._settings.tilt)
        self._tilt.set_visible(joints is None)
        self._preview.draw(body, joints)

    # Callbacks of the scene.

    def on_robots_moved(self) -> None:
        """Move this client's world frame, unless it follows the default robot."""
        body = self.visual
        if body is not None:
            self._place_at_first_sight(body)
            self._label_metres(body)
        tilts = body is not None and self._tilt.is_on(body) and self._preview_joints is None
        if body is not None and tilts:
            with self.client.atomic():
                self._tilt.update(body)
        moves_world = False
        if self._world is not None and self._fixed_world_xy is None:
            world = self._world_pose.xy_heading
            moves_world = not np.array_equal(world, self._sent_world)
            if moves_world:
                set_planar_pose(self._world, world)
                self._sent_world = world
        if tilts or moves_world:
            self.client.flush()

    def on_robots_changed(self) -> None:
        """Rebuild this client's nodes after a change of robots or settings."""
        own = self.client.scene
        with self.client.atomic():
            for body in self._scene.visuals.values():
                self._preview.forget(body)
                if self._tilt.is_on(body):
                    self._tilt.hide_links(body, None)
            self._student.clear(self._scene.visuals.values())
            own.reset()
            self._ground_pictures.clear()
            self._preview.palette = self._ghost.palette = self._student.palette = self._palette
            self._preview.clear()
            self._tilt.clear()
            self._ghost.clear()
            self._tilt.factor = self._settings.tilt
            self._select_available()
            self._world = self._add_world(own)
            body = self.visual
            add_lights(own, self._theme, self._camera.heading_rad, plain=self._no_gpu)
            add_ground(own, self._theme, plain=self._no_gpu)
            self._labelled = None
            self._metres.clear()
            self._hide_layers(own)
            if body is not None:
                self._label_metres(body)
            if body is not None and self._tilt.is_on(body):
                # Another robot in its place hides its axles as well.
                hidden = Layer if self._student.is_shown else self._settings.hidden
                self._tilt.start(body, self._palette, hidden)
            if self._preview_joints is not None:
                self._draw_preview()
            self._ghost.draw(body, *self._past)
            if self._student.is_shown:
                self._tilt.set_visible(False)
                self._student.draw(body, self._settings.tilt)
            if body is not None:
                self._place_at_first_sight(body)
        self.client.flush()

    def _add_world(self, own: viser.SceneApi) -> viser.FrameHandle | None:
        """Add this client's world frame; once added, it is always kept.

        viser drops the removal of a node that is immediately added again, and does not send a zero
        pose, so the browser would keep the previous pose. An ancestor that viser adds for this
        client's nodes has the same effect. Therefore this client never removes its frame, and sends
        its pose even if it is zero.
        """
        followed = self._robot_id == self._scene.default_robot_id
        if (
            self._fixed_world_xy is not None
            or not followed
            or self._is_chasing
            or self.shows_ground  # Its node would get an ancestor of this client.
        ):
            self._has_own_world = True
        if not self._has_own_world:
            return None
        x, y, _ = self._world_pose.xy_heading
        upside_down = (0.0, 1.0, 0.0, 0.0)  # Differs from any rotation about z.
        world = own.add_frame(ROOT, show_axes=False, position=(x + 1.0, y, 0.0), wxyz=upside_down)
        self._sent_world = self._world_pose.xy_heading
        set_planar_pose(world, self._sent_world)
        return world

    def _select_available(self) -> None:
        """Select the chosen robot, or the first available one while it is missing."""
        bodies = self._permitted_ids
        shown = next(
            (each for each in (self._requested_id, self._robot_id) if each in bodies), None
        )
        shown = shown or next(iter(bodies), None)
        if shown != self._robot_id:
            self._robot_id, self._preview_joints = shown, None
            self._past = None, 0.0
            self._camera.placed_for = None
            if self._fixed_world_xy is not None:
                self._fixed_world_xy = self._followed_world_xy

    @property
    def _permitted_ids(self) -> list[str]:
        """Robots that this client may show, in the order of their addition."""
        ids = list(self._scene.visuals)
        return ids if self._visible is None else [each for each in ids if each in self._visible]

    def _hide_layers(self, own: viser.SceneApi) -> None:
        hidden = set(self._settings.hidden)
        if self._settings.true_pose is TruePoseDisplay.NEVER:
            hidden.add(Layer.TRUTH)
        for layer in hidden:
            for node in layer_nodes(layer, self._scene.visuals):
                own.add_frame(node, show_axes=False, visible=False)
        if self._settings.true_pose is TruePoseDisplay.ALWAYS:
            for body in self._scene.visuals.values():
                name = f"{TRUE_POSES}/{body.id}/{self._theme}/c"
                add_wireframe(own, name, body.meshes.shape, self._palette.ink, visible=True)

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
        if body is None:
            return 0.0, 0.0
        if body.id == self._scene.default_robot_id:
            return self._scene.world_xy
        return -float(body.pose[0]), -float(body.pose[1])
