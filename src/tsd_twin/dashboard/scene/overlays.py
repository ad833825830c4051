"""Overlays of the scene: thrust arrows, pose region, stop envelope, trail, planned path, fault
ring.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import viser
from manifold3d import CrossSection

from tsd_twin.dashboard.scene import appearance
from tsd_twin.dashboard.scene.robot_geometry import RobotShape, Skeleton, Surface
from tsd_twin.estimation import heading_region_rad, position_region
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.status import RobotStatus


class RateLimiter:
    """Rate limiter with time as an argument."""

    def __init__(self, hz: float) -> None:
        self._period_s = 1.0 / hz
        self._last_s = -math.inf

    def is_due(self, now_s: float) -> bool:
        """Return whether a period has passed since it last returned True, or time went back."""
        # Tolerate early calls, because the callers are periodic too.
        if 0.0 <= now_s - self._last_s < self._period_s - 1e-3:
            return False
        self._last_s = now_s
        return True


ARROW_LENGTH_PER_SPEED_S = 0.25
"""Arrow length in metres per m/s."""
MIN_ARROW_SPEED_MPS = 0.02
ARROW_HEAD_M = 0.028
ARROW_HEIGHT_M = 0.006


class ThrustArrows:
    """Arrows for the velocity contributed by each wheel, from the joint vector."""

    def __init__(self, scene: viser.SceneApi, name: str, skeleton: Skeleton) -> None:
        self._skeleton = skeleton
        wheels = sum(group.count for group in skeleton.wheels)
        self._rate = RateLimiter(12.0)
        self._drawn = np.zeros((wheels, 3))
        self._handle = scene.add_arrows(
            name,
            np.zeros((wheels, 2, 3)),
            appearance.THRUST,
            shaft_radius=0.004,
            head_radius=0.011,
            head_length=ARROW_HEAD_M,
            visible=False,
        )

    def update(self, joints: Array, now_s: float) -> None:
        """Draw the arrows for a joint vector (n,)."""
        if not len(self._drawn) or not self._rate.is_due(now_s):
            return
        places, velocities = self._skeleton.contacts(joints)
        speeds = np.linalg.norm(velocities, axis=-1)
        velocities[speeds < MIN_ARROW_SPEED_MPS] = 0.0
        if np.abs(velocities - self._drawn).max() < 0.5 * MIN_ARROW_SPEED_MPS:
            return
        self._drawn = velocities
        fast = speeds >= MIN_ARROW_SPEED_MPS
        self._handle.visible = bool(fast.any())
        if fast.any():
            self._handle.points = arrow_points(places[fast], velocities[fast], speeds[fast])


def arrow_points(starts: Array, velocities: Array, speeds: Array) -> npt.NDArray[np.float32]:
    """Return arrows (n, 2, 3) from `starts` (n, 3), slightly raised above the surface."""
    lifted = starts + np.array([0.0, 0.0, ARROW_HEIGHT_M])
    # Add the head to the length, so that even the slowest arrow is at least as long as its head.
    ends = lifted + velocities * (ARROW_LENGTH_PER_SPEED_S + ARROW_HEAD_M / speeds)[:, None]
    return np.stack([lifted, ends], axis=1).astype(np.float32)


_LEAST_SIGMA_M = 0.001
"""Makes the outline of an exact position visible."""
_REGION_HEIGHT_M = 0.003
_REGION_CHANGE = 0.02
"""Relative change of the outline below which it is not sent."""
_VISIBLE_M = 0.002
"""Maximum displacement by a rotation of the outline that is not sent."""
_WEDGE_SIDES = 12
_WEDGE_BEYOND_M = 0.12
"""Distance from the rim of the robot to the end of the wedge."""
_LEAST_WEDGE_RAD = math.radians(0.5)
"""Narrower wedges are not drawn, and smaller changes not sent."""


class PoseRegion:
    """Confidence regions of the estimated pose: an outline for position, a wedge for heading.

    Each contains the true value with 86 % probability. The outline is aligned with `odom`, where it
    hardly changes while the robot turns; the wedge points ahead.
    """

    def __init__(self, scene: viser.SceneApi, name: str, reach_m: float) -> None:
        self._rate = RateLimiter(5.0)
        self._frame = scene.add_frame(name, show_axes=False)
        self.shown = self._outline_of(np.zeros((3, 3)))
        """(n, 2): outline relative to the estimated position, axes of `odom`."""
        self._turned_rad = 0.0
        self._outline = add_lines(scene, f"{name}/p", _closed(self.shown), appearance.ESTIMATE, 1.5)
        self._wedge_m = reach_m + _WEDGE_BEYOND_M
        self.half_rad = 0.0
        """Displayed half-width of the wedge; 0 if hidden."""
        self._wedge = add_lines(
            scene, f"{name}/w", self._wedge_of(0.0), appearance.ESTIMATE, 1.5, visible=False
        )

    def update(self, covariance: Array, heading_rad: float, now_s: float) -> None:
        """Show a pose covariance (3, 3) around a robot with this heading."""
        if self._rate.is_due(now_s):
            self._reshape(covariance)
        turn_rad = math.remainder(heading_rad - self._turned_rad, math.tau)
        if abs(turn_rad) * float(np.abs(self.shown).max()) > _VISIBLE_M:
            self._turned_rad = heading_rad
            half = -0.5 * heading_rad
            self._outline.wxyz = (math.cos(half), 0.0, 0.0, math.sin(half))

    def _reshape(self, covariance: Array) -> None:
        outline = self._outline_of(covariance)
        change_m = float(np.abs(outline - self.shown).max())
        if change_m > _REGION_CHANGE * float(np.abs(self.shown).max()):
            self.shown = outline
            self._outline.points = _closed(outline)
        half_rad = heading_region_rad(covariance)
        if half_rad < _LEAST_WEDGE_RAD:
            self.half_rad = 0.0
        elif abs(half_rad - self.half_rad) > max(_LEAST_WEDGE_RAD, _REGION_CHANGE * half_rad):
            self.half_rad = half_rad
            self._wedge.points = self._wedge_of(half_rad)
        self._wedge.visible = self.half_rad > 0.0

    @staticmethod
    def _outline_of(covariance: Array) -> Array:
        return position_region(covariance + _LEAST_SIGMA_M**2 * np.diag([1.0, 1.0, 0.0]))

    def _wedge_of(self, half_rad: float) -> npt.NDArray[np.float32]:
        angles = np.linspace(-half_rad, half_rad, _WEDGE_SIDES + 1)
        arc = self._wedge_m * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        return _closed(np.concatenate([np.zeros((1, 2)), arc]))


def add_lines(
    scene: viser.SceneApi,
    name: str,
    points: Array | npt.NDArray[np.float32],
    colour: appearance.Rgb,
    pixels: float,
    *,
    visible: bool = True,
) -> viser.LineSegmentsHandle:
    """Add line segments (n, 2, 3) that are `pixels` thick at any distance."""
    return scene.add_line_segments(
        name, points, colour, thickness=pixels, thickness_units="screen", visible=visible
    )


def _closed(outline: Array, height_m: float = _REGION_HEIGHT_M) -> npt.NDArray[np.float32]:
    """Return the sides (n, 2, 3) of a polygon (n, 2) above the floor."""
    corners = np.insert(outline, 2, height_m, axis=1).astype(np.float32)
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


ENVELOPE_SIDES = 40
ENVELOPE_HEIGHT_M = 0.0025
_ENVELOPE_OPACITY = 0.2
_MIN_CHANGE_M = 0.001
"""Changes below this are not sent."""


def swept_outline(path: Array, reach_m: float) -> Array:
    """Return a convex polygon (SIDES, 2) that contains a disc moved along `path` (n, 2+).

    It approximates the convex hull of the discs by tangents in SIDES directions and their
    intersections. Braking paths are short arcs, so the hull adds little area.
    """
    angles = np.arange(ENVELOPE_SIDES) * 2.0 * np.pi / ENVELOPE_SIDES
    x, y = np.cos(angles), np.sin(angles)
    far = (path[:, :2] @ np.stack([x, y])).max(axis=0) + reach_m
    next_x, next_y, next_far = (np.roll(values, -1) for values in (x, y, far))
    corners = np.stack([far * next_y - next_far * y, next_far * x - far * next_x], axis=-1)
    return corners / np.sin(2.0 * np.pi / ENVELOPE_SIDES)


class StopEnvelope:
    """Stop envelope: translucent area of the braking path on the robot's node; empty at rest.

    While the robot moves steadily, the area is constant in its frame and nothing is sent.
    """

    def __init__(self, scene: viser.SceneApi, name: str, reach_m: float) -> None:
        self._reach_m = reach_m
        self._shown = swept_outline(np.zeros((1, 2)), reach_m)
        self.outline: Array | None = None
        """Displayed polygon (SIDES, 2) in the robot's frame, or None if hidden. Arrays are
        replaced, never modified.
        """
        self._frame = scene.add_frame(name, show_axes=False)
        fan = np.arange(1, ENVELOPE_SIDES - 1, dtype=np.uint32)
        self._area = scene.add_mesh_simple(
            f"{name}/a",
            self._raised(),
            np.stack([0 * fan, fan, fan + 1], axis=-1),
            color=appearance.ENVELOPE,
            opacity=_ENVELOPE_OPACITY,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )
        self._rim = add_lines(
            scene, f"{name}/r", self._edges(), appearance.ENVELOPE, 2.0, visible=False
        )

    def update(self, path: Array | None) -> None:
        """Draw the area of `path` (n, 3) in the robot's frame; None hides it."""
        self._area.visible = self._rim.visible = path is not None
        if path is None:
            self.outline = None
            return
        shape = swept_outline(path, self._reach_m)
        if np.abs(shape - self._shown).max() < _MIN_CHANGE_M:
            self.outline = self._shown
            return
        self._shown = self.outline = shape
        self._area.vertices = self._raised()
        self._rim.points = self._edges()

    def _raised(self) -> npt.NDArray[np.float32]:
        return np.insert(self._shown, 2, ENVELOPE_HEIGHT_M, axis=1).astype(np.float32)

    def _edges(self) -> npt.NDArray[np.float32]:
        return _closed(self._shown, ENVELOPE_HEIGHT_M)


TRAIL_SPACING_M = 0.02
TRAIL_CHUNK = 64
TRAIL_CHUNKS = 32
"""Number of chunks kept, each with TRAIL_CHUNK segments: the last 40 m."""
TRAIL_JUMP_M = 0.5
"""A longer step is not motion but a change of the pose."""
TRAIL_HEIGHT_M = 0.002


class Trail:
    """Path of the estimate, in chunks; only the latest chunk is resent as it grows."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        self._scene = scene
        self._name = name
        self._nodes: dict[int, viser.LineSegmentsHandle] = {}
        self._chunk = 0
        self._segments: list[tuple[Array, Array]] = []
        self._last: Array | None = None
        self._sent = 0
        self._rate = RateLimiter(5.0)

    def update(self, xy: Array, now_s: float) -> None:
        """Append a position (2,)."""
        here = np.array([xy[0], xy[1], TRAIL_HEIGHT_M])
        step_m = np.inf if self._last is None else float(np.linalg.norm(here - self._last))
        if step_m >= TRAIL_SPACING_M:
            if self._last is not None and step_m < TRAIL_JUMP_M:
                self._segments.append((self._last, here))
            self._last = here
        full = len(self._segments) >= TRAIL_CHUNK
        if len(self._segments) > self._sent and (self._rate.is_due(now_s) or full):
            self._send()
        if full:
            self._chunk = (self._chunk + 1) % TRAIL_CHUNKS
            self._segments, self._sent = [], 0

    def clear(self) -> None:
        """Clear the path."""
        for node in self._nodes.values():
            node.remove()
        self._nodes.clear()
        self._segments, self._sent, self._chunk = [], 0, 0

    def _send(self) -> None:
        points = np.array(self._segments, np.float32)
        self._sent = len(points)
        if self._chunk in self._nodes:
            self._nodes[self._chunk].points = points
        else:
            self._nodes[self._chunk] = add_lines(
                self._scene, f"{self._name}/{self._chunk}", points, appearance.ESTIMATE, 2.5
            )


ROUTE_HEIGHT_M = 0.003
ROUTE_POINTS = 120
"""Number of points of the line, enough for the strongest curvature of a robot."""
_GOAL_RING_SIDES = 32
_GOAL_TIP_M = 0.06


def route_segments(poses: Array, reach_m: float) -> Array:
    """Return line segments (k, 2, 3) of a path through `poses` (n, 3), n > 1.

    At the end is a ring of the robot's size, with a tip in the direction of its final heading.
    """
    way = np.stack([poses[:-1, :2], poses[1:, :2]], axis=1)
    around = np.arange(_GOAL_RING_SIDES) * 2.0 * np.pi / _GOAL_RING_SIDES
    ring = reach_m * np.stack([np.cos(around), np.sin(around)], axis=-1)
    tip = np.array(
        [[reach_m, 0.5 * _GOAL_TIP_M], [reach_m + _GOAL_TIP_M, 0.0], [reach_m, -0.5 * _GOAL_TIP_M]]
    )
    end = SE2(poses[-1])
    marks = np.concatenate(
        [np.stack([ring, np.roll(ring, -1, axis=0)], axis=1), np.stack([tip[:-1], tip[1:]], axis=1)]
    )
    placed = end.rotate(marks) + poses[-1, :2]
    flat = np.concatenate([way, placed])
    return np.concatenate([flat, np.full((*flat.shape[:-1], 1), ROUTE_HEIGHT_M)], axis=-1)


class RouteLine:
    """Line of the planned path: a single node while a path exists."""

    def __init__(self, scene: viser.SceneApi, name: str, reach_m: float) -> None:
        self._scene = scene
        self._name = name
        self._reach_m = reach_m
        self._node: viser.LineSegmentsHandle | None = None

    def update(self, poses: Array | None) -> None:
        """Draw a path through `poses` (n, 3); None removes it."""
        if self._node is not None:
            self._node.remove()
            self._node = None
        if poses is not None:
            points = route_segments(poses, self._reach_m).astype(np.float32)
            self._node = add_lines(self._scene, self._name, points, appearance.ROUTE, 4.0)


FAULT_RING_RADIUS_M = 0.075
_FAULT_RING_THICKNESS_M = 0.006
_FAULT_RING_HEIGHT_M = 0.008


class FaultRing:
    """Ring at the actuator that the robot reports as faulty; cannot be hidden."""

    def __init__(self, scene: viser.SceneApi, name: str, shape: RobotShape) -> None:
        self._actuators = shape.kinematics.actuators
        # The contacts hardly depend on the joints, so this is accurate enough.
        at_rest = shape.kinematics.inverse(np.zeros(3))
        self._places: Array = shape.skeleton.contacts(at_rest)[0]
        profile: Any = CrossSection.circle(_FAULT_RING_THICKNESS_M, 8).translate(
            (FAULT_RING_RADIUS_M, 0.0)
        )
        self._shown: str | None = None
        self._handle = scene.add_mesh_simple(
            name,
            *Surface.of(profile.revolve(48)),
            color=appearance.SUSPECT,
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )

    def update(self, status: RobotStatus) -> None:
        """Show the suspected actuator, if any."""
        suspect = status.consistency.suspect
        if suspect == self._shown:
            return
        self._shown = suspect
        self._handle.visible = suspect in self._actuators
        if suspect in self._actuators:
            x, y, z = self._places[self._actuators.index(suspect)]
            self._handle.position = (float(x), float(y), float(z) + _FAULT_RING_HEIGHT_M)
