"""What is not the estimate: where gimbals shall be, where the robot is, where it will be."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import viser
from manifold3d import CrossSection

from tsd_twin.dashboard import palette
from tsd_twin.dashboard.poses import Poses, link_poses
from tsd_twin.dashboard.shape import Shape, Surface
from tsd_twin.drives import SingularityDrive
from tsd_twin.lie import SE2, Array, wrap

VISIBLE_M = 0.005
VISIBLE_RAD = math.radians(0.5)
"""The true pose is shown when it is farther from the estimate than this, or turned by more."""


class SetpointGhost:
    """A ring about each wheel, and the end of its axle: where they are told to be.

    Drawn around the wheel, not over it, so that small differences show and nothing flickers.
    """

    def __init__(self, scene: viser.SceneApi, name: str, drive: SingularityDrive) -> None:
        self._drive = drive
        self._shown = drive.inverse(np.zeros(3))
        wxyz, position = self._poses(self._shown)
        self._handle = scene.add_batched_meshes_simple(
            name,
            *_hoop(drive.wheel_radius_m),
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
        still = np.zeros(self._drive.modules)
        return link_poses(self._drive, SE2.identity(), joints, still)["wheel"]


class TruthGhost:
    """A cage of lines around the robot, where a simulator says that it is."""

    def __init__(self, scene: viser.SceneApi, name: str, shape: Shape) -> None:
        self._frame = scene.add_frame(name, show_axes=False)
        self.cage_name = f"{name}/c"
        self._cage = add_cage(scene, self.cage_name, shape, visible=False)

    def update(self, truth: Array, estimate: Array) -> None:
        """Show the true pose (3,), unless that is as good as the estimated one (3,)."""
        off = truth - estimate
        differs = math.hypot(off[0], off[1]) > VISIBLE_M or abs(wrap(off[2])) > VISIBLE_RAD
        self._cage.visible = bool(differs)
        place(self._frame, truth)  # Also out of sight: a client may show the cage all the same.

    def remove(self) -> None:
        """Show it no more."""
        self._frame.remove()


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
    scene: viser.SceneApi,
    name: str,
    shape: Shape,
    colour: palette.Rgb = palette.TRUTH,
    *,
    visible: bool,
) -> viser.LineSegmentsHandle:
    """Add the edges of what a robot stands in: lines hide nothing, as a translucent body would."""
    foot = shape.footprint
    low, high = (np.insert(foot, 2, z, axis=1) for z in (0.003, shape.height_m))
    rims = [np.stack([rim, np.roll(rim, -1, axis=0)], axis=1) for rim in (low, high)]
    posts = np.stack([low, high], axis=1)[:: max(1, len(foot) // 6)]
    return scene.add_line_segments(
        name,
        np.concatenate([*rims, posts]),
        colour,
        thickness=2.0,
        thickness_units="screen",
        visible=visible,
    )


def _hoop(wheel_radius_m: float) -> Surface:
    """Return a ring about the wheel and a pointer along its axle, in the frame of the wheel."""
    thin = 0.025 * wheel_radius_m
    ring = CrossSection.circle(thin, 6).translate((1.62 * wheel_radius_m, 0.0))
    length = 2.0 * wheel_radius_m
    pointer = CrossSection.square((thin, length)).translate((0.0, 0.8 * wheel_radius_m))
    tip = CrossSection.circle(3.0 * thin, 12).translate((0.0, 2.8 * wheel_radius_m))
    profile: Any = ring + pointer + tip
    return Surface.of(profile.revolve(48))
