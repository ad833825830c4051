"""The scene as one client sees it: what it hides, what it follows, what it tries out."""

from __future__ import annotations

import threading
from enum import StrEnum

import numpy as np
import viser

from tsd_twin.dashboard import palette
from tsd_twin.dashboard.body import Body
from tsd_twin.dashboard.floor import Eye, on_floor
from tsd_twin.dashboard.ghosts import add_cage
from tsd_twin.dashboard.layers import ROOT, Layer, layer_nodes
from tsd_twin.dashboard.lights import make_plain
from tsd_twin.dashboard.pointing import point_on_ball
from tsd_twin.dashboard.scene import Scene
from tsd_twin.dashboard.tried import Tried
from tsd_twin.dashboard.viser_server import CAMERA_M, LOOK_AT_M
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

    def __init__(self, scene: Scene, client: viser.ClientHandle, *, plain: bool = False) -> None:
        """`plain` is for a browser without a graphics card."""
        self._plain = plain
        if plain:
            make_plain(client.scene)
        self._scene = scene
        self._client = client
        self._robot_id = scene.leader
        self._wish: str | None = None
        self._hidden: set[Layer] = set()
        self._truth = Truth.DIFFERS
        self._stopped_xy: tuple[float, float] | None = None
        self._world: viser.FrameHandle | None = None
        self._tried: Array | None = None
        self._preview = Tried(client)

    # What it looks at.

    @property
    def lock(self) -> threading.RLock:
        """For who changes several things that have to go together."""
        return self._scene.lock

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
        """Follow and try out this robot, or as soon as it comes."""
        with self._scene.lock:
            self._wish = robot_id
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

    def point(self, origin: Array, direction: Array) -> tuple[float, float, float] | None:
        """Return the point of the ball that a ray (3,), (3,) in its picture meets."""
        body = self.body
        radius_m = None if body is None else body.meshes.shape.ball_radius_m
        if body is None or radius_m is None:
            return None
        x, y = self._world_xy
        height_m = body.meshes.shape.skeleton.tree.height_m
        centre = np.array([x + body.pose[0], y + body.pose[1], height_m])
        return point_on_ball(origin, direction, centre, radius_m, body.ball)

    def floor(self, shares: Array) -> Array:
        """Return the places (m, 2) in `odom` that its picture shows, as `on_floor`."""
        camera = self._client.camera
        eye = Eye(camera.position, camera.wxyz, camera.fov, camera.aspect)
        return on_floor(eye, shares) - np.array(self._world_xy)

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
        """Show in this picture only what a joint vector (n,) would do; None: what is.

        It poses gimbals; of wheels that only roll, arrows tell which way and how fast.
        """
        with self._scene.lock:
            self._tried = joints
            self._draw_tried()
        self._client.flush()

    def _draw_tried(self) -> None:
        if self.body is not None:
            self._preview.draw(self.body, self._tried)

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
            for body in self._scene.bodies.values():
                self._preview.forget(body)
            own.reset()
            self._preview.clear()
            self._world = None
            self._turn()
            if self._stopped_xy is not None or self._robot_id != self._scene.leader:
                self._world = own.add_frame(ROOT, show_axes=False, position=(*self._world_xy, 0.0))
            if self._plain:
                make_plain(own)
            self._hide_layers(own)
            if self._tried is not None:
                self._draw_tried()
        self._client.flush()

    def _turn(self) -> None:
        """Turn to the robot that was chosen; while it is not there, to one that is."""
        bodies = self._scene.bodies
        shown = next((each for each in (self._wish, self._robot_id) if each in bodies), None)
        shown = shown or self._scene.leader
        if shown != self._robot_id:
            self._robot_id, self._tried = shown, None

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
                add_cage(own, name, body.meshes.shape, palette.TRUTH, visible=True)

    @property
    def _world_xy(self) -> tuple[float, float]:
        """Where the origin of `odom` is in the picture of this client."""
        if self._stopped_xy is not None:
            return self._stopped_xy
        body = self.body
        if body is None or body.id == self._scene.leader:
            return self._scene.world_xy
        return -float(body.pose[0]), -float(body.pose[1])
