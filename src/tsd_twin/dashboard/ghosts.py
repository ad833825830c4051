"""What is not the estimate: where gimbals shall be, where else the robot is, where it will be."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import viser
from manifold3d import CrossSection

from tsd_twin.dashboard import palette
from tsd_twin.dashboard.poses import Poses
from tsd_twin.dashboard.shape import Shape, Surface
from tsd_twin.lie import SE2, SO3, Array, wrap
from tsd_twin.messages.ros import Odometry

VISIBLE_M = 0.005
VISIBLE_RAD = math.radians(0.5)
"""Another pose is shown when it is farther from the estimate than this, or turned by more."""


class SetpointGhost:
    """A ring about each wheel, and the end of its axle: where they are told to be.

    Drawn around the wheel, not over it, so that small differences show and nothing flickers.
    """

    def __init__(self, scene: viser.SceneApi, name: str, shape: Shape) -> None:
        self._skeleton = shape.skeleton
        (self._wheels,) = self._skeleton.wheels
        self._shown = shape.drive.inverse(np.zeros(3))
        wxyz, position = self._poses(self._shown)
        assert self._wheels.hull is not None  # noqa: S101  Or they would not be among the wheels.
        self._handle = scene.add_batched_meshes_simple(
            name,
            *_hoop(self._wheels.hull.radius_m),
            wxyz,
            position,
            batched_colors=palette.SETPOINT,
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
        )

    def update(self, setpoint: Array) -> None:
        """Show a joint vector (n,)."""
        if np.array_equal(setpoint, self._shown):
            return
        self._shown = setpoint
        self._handle.batched_wxyzs = self._poses(setpoint).wxyz.astype(np.float32)

    def _poses(self, joints: Array) -> Poses:
        # A hoop is round: by how much its wheel has turned does not show.
        every = self._skeleton.poses(SE2.identity(), SO3.identity(), joints)
        return every[self._wheels.kind]


class PoseGhost:
    """A cage of lines where somebody else has the robot: a simulator, or a second estimate.

    Of a ball, great circles that are turned as that one has it.
    """

    def __init__(self, scene: viser.SceneApi, name: str, shape: Shape, colour: palette.Rgb) -> None:
        self._frame = scene.add_frame(name, show_axes=False)
        self._height_m = shape.skeleton.tree.height_m
        self.cage_name = f"{name}/c"
        self._cage = add_cage(scene, self.cage_name, shape, colour, visible=False)

    def update(self, said: Odometry, estimate: Odometry) -> None:
        """Show what is said of the pose, unless that is as good as the estimate."""
        self._cage.visible = _differ(said, estimate)
        # Also out of sight: a client may show the cage all the same.
        if said.wxyz is None:
            place(self._frame, said.xy_heading)
        else:
            self._frame.position = (0.0, 0.0, self._height_m)
            self._frame.wxyz = said.wxyz

    def remove(self) -> None:
        """Show it no more."""
        self._frame.remove()


def _differ(said: Odometry, estimate: Odometry) -> bool:
    """Tell whether two poses are so far apart that it shows."""
    if said.wxyz is not None and estimate.wxyz is not None:
        between = SO3(estimate.wxyz).inverse() @ SO3(said.wxyz)
        return bool(np.linalg.norm(between.log()) > VISIBLE_RAD)
    off = said.xy_heading - estimate.xy_heading
    return bool(math.hypot(off[0], off[1]) > VISIBLE_M or abs(wrap(off[2])) > VISIBLE_RAD)


class PredictedGhost:
    """A cage of lines where the robot will be when a command that is sent now arrives.

    It hangs on the robot, so a delay that stays the same at a speed that stays the same is silent.
    """

    def __init__(self, scene: viser.SceneApi, name: str, shape: Shape) -> None:
        self._frame = scene.add_frame(name, show_axes=False)
        self._cage = add_cage(scene, f"{name}/c", shape, palette.PREDICTED, visible=False)

    def update(self, ahead: Array | None) -> None:
        """Show a pose (3,) in the frame of the robot; None: there is nothing to predict."""
        self._cage.visible = ahead is not None
        if ahead is not None:
            place(self._frame, np.round(ahead, 3))


def place(frame: viser.FrameHandle, pose: Array) -> None:
    """Move a node to a planar pose (3,)."""
    half = 0.5 * float(pose[2])
    frame.position = (float(pose[0]), float(pose[1]), 0.0)
    frame.wxyz = (math.cos(half), 0.0, 0.0, math.sin(half))


def add_cage(
    scene: viser.SceneApi, name: str, shape: Shape, colour: palette.Rgb, *, visible: bool
) -> viser.LineSegmentsHandle:
    """Add the edges of what a robot stands in: lines hide nothing, as a translucent body would."""
    return scene.add_line_segments(
        name,
        _box(shape) if shape.ball_radius_m is None else _circles(shape.ball_radius_m),
        colour,
        thickness=2.0,
        thickness_units="screen",
        visible=visible,
    )


def _box(shape: Shape) -> Array:
    """Return the edges (n, 2, 3) around a robot that stands on the floor."""
    foot = shape.footprint
    low, high = (np.insert(foot, 2, z, axis=1) for z in (0.003, shape.height_m))
    rims = [np.stack([rim, np.roll(rim, -1, axis=0)], axis=1) for rim in (low, high)]
    posts = np.stack([low, high], axis=1)[:: max(1, len(foot) // 6)]
    return np.concatenate([*rims, posts])


def _circles(radius_m: float) -> Array:
    """Return great circles (n, 2, 3) just outside a ball, and pointers along its X and Z."""
    angles = np.linspace(0.0, 2.0 * np.pi, 73)
    flat = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=-1)
    lines = [np.stack([ring[:-1], ring[1:]], axis=1) for ring in (flat, flat[:, [0, 2, 1]])]
    pointers = [np.array([[axis, 1.25 * axis]]) for axis in np.eye(3)[[0, 2]]]
    return 1.01 * radius_m * np.concatenate([*lines, *pointers])


def _hoop(wheel_radius_m: float) -> Surface:
    """Return a ring about the wheel and a pointer along its axle, in the frame of the wheel."""
    thin = 0.025 * wheel_radius_m
    ring = CrossSection.circle(thin, 6).translate((1.62 * wheel_radius_m, 0.0))
    length = 2.0 * wheel_radius_m
    pointer = CrossSection.square((thin, length)).translate((0.0, 0.8 * wheel_radius_m))
    tip = CrossSection.circle(3.0 * thin, 12).translate((0.0, 2.8 * wheel_radius_m))
    profile: Any = ring + pointer + tip
    return Surface.of(profile.revolve(48))
