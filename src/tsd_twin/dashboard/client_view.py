"""The scene as one client sees it: what it hides, what it follows, what it tries out."""

from __future__ import annotations

from enum import StrEnum

import numpy as np
import viser

from tsd_twin.dashboard import palette
from tsd_twin.dashboard.body import Body
from tsd_twin.dashboard.ghosts import add_cage
from tsd_twin.dashboard.layers import ROOT, Layer, layer_nodes, robot_node
from tsd_twin.dashboard.poses import link_poses
from tsd_twin.dashboard.scene import Scene
from tsd_twin.dashboard.viser_private import scale_instances
from tsd_twin.dashboard.viser_server import CAMERA_M, LOOK_AT_M
from tsd_twin.description import Link
from tsd_twin.lie import SE2, Array


class Truth(StrEnum):
    """When the true pose is shown; the values are the words of the panel."""

    DIFFERS = "when it differs"
    ALWAYS = "always"
    NEVER = "never"


class Camera(StrEnum):
    """Where to look from; the values are the words of the panel."""

    ISO = "iso"
    BEHIND = "behind"
    TOP = "top"


class ClientView:
    """Nodes that belong to one client alone; where it has one, it stands for the shared one."""

    def __init__(self, scene: Scene, client: viser.ClientHandle) -> None:
        self._scene = scene
        self._client = client
        self._robot_id = scene.leader
        self._hidden: set[Layer] = set()
        self._truth = Truth.DIFFERS
        self._stopped_xy: tuple[float, float] | None = None
        self._world: viser.FrameHandle | None = None
        self._tried: Array | None = None
        self._gimbals: dict[Link, viser.BatchedGlbHandle] = {}

    # What it looks at.

    @property
    def robot_id(self) -> str | None:
        """The robot that it follows and tries out."""
        return self._robot_id

    @property
    def robot_ids(self) -> tuple[str, ...]:
        """All robots that it could look at."""
        return tuple(self._scene.bodies)

    @property
    def body(self) -> Body | None:
        """The robot that it looks at; None as long as there is none."""
        return self._scene.bodies.get(self._robot_id or "")

    def choose(self, robot_id: str) -> None:
        """Follow and try out this robot."""
        with self._scene.lock:
            self._robot_id, self._tried = robot_id, None
            self.rebuild()

    def follow(self, on: bool) -> None:
        """Let the robot keep its place in the picture, or let it drive away."""
        with self._scene.lock:
            self._stopped_xy = None if on else self._world_xy
            self.rebuild()

    def look(self, camera: Camera) -> None:
        """Turn the camera to the robot."""
        body = self.body
        x, y, heading = body.pose if body else np.zeros(3)
        seen_x, seen_y = self._world_xy
        offset = np.array(CAMERA_M)
        if camera is Camera.TOP:
            offset = np.array([-0.01, 0.0, 1.3])
        elif camera is Camera.BEHIND:
            back = SE2(np.array([0.0, 0.0, heading])).rotate(np.array([-0.85, 0.0]))
            offset = np.array([*back, 0.42])
        middle = np.array([x + seen_x, y + seen_y, 0.0])
        with self._client.atomic():
            self._client.camera.position = middle + offset
            self._client.camera.look_at = middle + LOOK_AT_M
        self._client.flush()

    # What it shows.

    def show(self, layer: Layer, on: bool) -> None:
        """Show or hide a layer."""
        with self._scene.lock:
            (self._hidden.discard if on else self._hidden.add)(layer)
            self.rebuild()

    def show_truth(self, truth: Truth) -> None:
        """Show the true pose always, never, or when it differs from the estimate."""
        with self._scene.lock:
            self._truth = truth
            self.rebuild()

    # What it tries out.

    def try_out(self, joints: Array | None) -> None:
        """Pose the gimbals by a joint vector (n,) in this picture only; None: as they are."""
        with self._scene.lock:
            self._tried = joints
            self._draw_tried()
        self._client.flush()

    def _draw_tried(self) -> None:
        body = self.body
        if body is None or (self._tried is None and not self._gimbals):
            return
        if self._tried is None:
            for handle in self._gimbals.values():
                handle.visible = False
            self._hide_gimbals(body, None)
            return
        drive, shape = body.link.drive, body.meshes.shape
        poses = link_poses(drive, SE2.identity(), self._tried, body.angles)
        for kind in shape.moving:
            if kind not in self._gimbals:
                self._gimbals[kind] = self._client.scene.add_batched_glb(
                    f"{robot_node(body.id)}/p{kind}",
                    shape.tinted(kind, palette.PREVIEW),
                    *poses[kind],
                    lod="off",
                )
            self._gimbals[kind].batched_wxyzs = poses[kind].wxyz.astype(np.float32)
            self._gimbals[kind].visible = True
        self._hide_gimbals(body, body.id)

    def _hide_gimbals(self, body: Body, robot_id: str | None) -> None:
        """Let this client not see the moving links of one robot, or see those of all."""
        for kind in body.meshes.shape.moving:
            scales = body.meshes.scales_without(robot_id, kind)
            scale_instances(self._client, body.meshes.node(kind), scales)

    # What the scene asks for.

    def moved(self) -> None:
        """Move the world of this client, if it follows another robot than the rest."""
        if self._world is not None and self._stopped_xy is None:
            self._world.position = (*self._world_xy, 0.0)
            self._client.flush()

    def rebuild(self) -> None:
        """Make the nodes of this client anew, after robots came or went, or a wish has changed."""
        own = self._client.scene
        with self._client.atomic():
            if self._gimbals:
                for body in self._scene.bodies.values():
                    self._hide_gimbals(body, None)
            own.reset()
            self._gimbals.clear()
            self._world = None
            if self._robot_id not in self._scene.bodies:
                self._robot_id, self._tried = self._scene.leader, None
            if self._stopped_xy is not None or self._robot_id != self._scene.leader:
                self._world = own.add_frame(ROOT, show_axes=False, position=(*self._world_xy, 0.0))
            self._hide_layers(own)
            if self._tried is not None:
                self._draw_tried()
        self._client.flush()

    def _hide_layers(self, own: viser.SceneApi) -> None:
        hidden = set(self._hidden)
        if self._truth is Truth.NEVER:
            hidden.add(Layer.TRUTH)
        for layer in hidden:
            for node in layer_nodes(layer, self._scene.bodies):
                own.add_frame(node, show_axes=False, visible=False)
        if self._truth is Truth.ALWAYS:
            for body in self._scene.bodies.values():
                name = body.marks.truth.cage_name
                add_cage(own, name, body.meshes.shape, visible=True)

    @property
    def _world_xy(self) -> tuple[float, float]:
        """Where the origin of `odom` is in the picture of this client."""
        if self._stopped_xy is not None:
            return self._stopped_xy
        body = self.body
        if body is None or body.id == self._scene.leader:
            return self._scene.world_xy
        return -float(body.pose[0]), -float(body.pose[1])
