"""Overlays around a robot: region of the pose, stop envelope and fault ring."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import viser
from manifold3d import CrossSection

from tsd_twin.dashboard.scene.robot_geometry import RobotShape, Surface
from tsd_twin.dashboard.scene.themed import (
    RateLimiter,
    add_area,
    add_lines,
    closed,
    dashes,
    hatching,
    raised,
    set_all,
    themed,
)
from tsd_twin.dashboard.scene.unlit import mixed
from tsd_twin.estimation import heading_region_rad, position_region
from tsd_twin.lie import Array
from tsd_twin.messages.status import RobotStatus

_LEAST_SIGMA_M = 0.001
"""Makes the outline of an exact position visible."""
_REGION_HEIGHT_M = 0.0018
"""Below trail and envelope, which an area above would hide."""
_REGION_OPACITY, _WEDGE_OPACITY = 0.25, 0.25
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
    """Confidence regions of the estimated pose: an area for position, a wedge for heading.

    Each contains the true value with 86 % probability. The outline is aligned with `odom`, where it
    hardly changes while the robot turns; the wedge points ahead.
    """

    def __init__(self, scene: viser.SceneApi, name: str, reach_m: float) -> None:
        self._rate = RateLimiter(5.0)
        self.shown = self._outline_of(np.zeros((3, 3)))
        """(n, 2): outline relative to the estimated position, axes of `odom`."""
        self._turned_rad = 0.0
        self._wedge_m = reach_m + _WEDGE_BEYOND_M
        self.half_rad = 0.0
        """Displayed half-width of the wedge; 0 if hidden."""
        self._areas: list[viser.MeshHandle] = []
        self._wedges: list[viser.MeshHandle] = []
        for node, palette in themed(scene, name):
            area = raised(self.shown, _REGION_HEIGHT_M), palette.estimate, _REGION_OPACITY
            self._areas.append(add_area(scene, f"{node}/p", *area))
            wedge = self._wedge_of(0.0), palette.estimate, _WEDGE_OPACITY
            self._wedges.append(add_area(scene, f"{node}/w", *wedge, visible=False))

    def update(self, covariance: Array, heading_rad: float, now_s: float) -> None:
        """Show a pose covariance (3, 3) around a robot with this heading."""
        if self._rate.is_due(now_s):
            self._reshape(covariance)
        turn_rad = math.remainder(heading_rad - self._turned_rad, math.tau)
        if abs(turn_rad) * float(np.abs(self.shown).max()) > _VISIBLE_M:
            self._turned_rad = heading_rad
            half = -0.5 * heading_rad
            set_all(self._areas, wxyz=(math.cos(half), 0.0, 0.0, math.sin(half)))

    def _reshape(self, covariance: Array) -> None:
        outline = self._outline_of(covariance)
        change_m = float(np.abs(outline - self.shown).max())
        if change_m > _REGION_CHANGE * float(np.abs(self.shown).max()):
            self.shown = outline
            set_all(self._areas, vertices=raised(outline, _REGION_HEIGHT_M))
        half_rad = heading_region_rad(covariance)
        if half_rad < _LEAST_WEDGE_RAD:
            self.half_rad = 0.0
        elif abs(half_rad - self.half_rad) > max(_LEAST_WEDGE_RAD, _REGION_CHANGE * half_rad):
            self.half_rad = half_rad
            set_all(self._wedges, vertices=self._wedge_of(half_rad))
        set_all(self._wedges, visible=self.half_rad > 0.0)

    @staticmethod
    def _outline_of(covariance: Array) -> Array:
        return position_region(covariance + _LEAST_SIGMA_M**2 * np.diag([1.0, 1.0, 0.0]))

    def _wedge_of(self, half_rad: float) -> npt.NDArray[np.float32]:
        angles = np.linspace(-half_rad, half_rad, _WEDGE_SIDES + 1)
        arc = self._wedge_m * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        return raised(np.concatenate([np.zeros((1, 2)), arc]), _REGION_HEIGHT_M)


ENVELOPE_SIDES = 40
ENVELOPE_HEIGHT_M = 0.0021
_ENVELOPE_OPACITY = 0.16
_RIM_HEIGHT_M, _RIM_WIDTH_M = 0.003, 0.0045
_RIM_DASH_M, _RIM_GAP_M = 0.04, 0.03
_HATCH_SPACING_M, _HATCH_WIDTH_M, _HATCH_STRENGTH = 0.07, 0.002, 0.45
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
    """Stop envelope: hatched area of the braking path with a dashed rim; empty at rest.

    It moves with the robot's node. While the robot moves steadily, the area is constant in its
    frame and nothing is sent.
    """

    def __init__(self, scene: viser.SceneApi, name: str, reach_m: float) -> None:
        self._reach_m = reach_m
        self._shown = swept_outline(np.zeros((1, 2)), reach_m)
        self.outline: Array | None = None
        """Displayed polygon (SIDES, 2) in the robot's frame, or None if hidden. Arrays are
        replaced, never modified.
        """
        self._frames: list[viser.FrameHandle] = []
        self._areas: list[viser.MeshHandle] = []
        self._rims: list[viser.LineSegmentsHandle] = []
        self._hatches: list[viser.LineSegmentsHandle] = []
        for node, palette in themed(scene, name):
            self._frames.append(scene.add_frame(f"{node}/v", show_axes=False, visible=False))
            area = raised(self._shown, ENVELOPE_HEIGHT_M), palette.caution, _ENVELOPE_OPACITY
            self._areas.append(add_area(scene, f"{node}/v/a", *area))
            rim = self._dashes(), palette.caution, _RIM_WIDTH_M
            self._rims.append(add_lines(scene, f"{node}/v/r", *rim))
            dim = mixed(palette.caution, palette.floor, _HATCH_STRENGTH)
            hatch = self._hatching(), dim, _HATCH_WIDTH_M
            self._hatches.append(add_lines(scene, f"{node}/v/h", *hatch))

    def update(self, path: Array | None) -> None:
        """Draw the area of `path` (n, 3) in the robot's frame; None hides it."""
        set_all(self._frames, visible=path is not None)
        if path is None:
            self.outline = None
            return
        shape = swept_outline(path, self._reach_m)
        if np.abs(shape - self._shown).max() < _MIN_CHANGE_M:
            self.outline = self._shown
            return
        self._shown = self.outline = shape
        set_all(self._areas, vertices=raised(shape, ENVELOPE_HEIGHT_M))
        set_all(self._rims, points=self._dashes())
        set_all(self._hatches, points=self._hatching())

    def _hatching(self) -> npt.NDArray[np.float32]:
        return raised(hatching(self._shown, _HATCH_SPACING_M), _RIM_HEIGHT_M)

    def _dashes(self) -> npt.NDArray[np.float32]:
        rim = dashes(closed(self._shown), _RIM_DASH_M, _RIM_GAP_M)
        return raised(rim, _RIM_HEIGHT_M)


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
        self._handles = [
            scene.add_mesh_simple(
                f"{node}/j",
                *Surface.of(profile.revolve(48)),
                color=palette.danger,
                cast_shadow=False,
                receive_shadow=False,
                visible=False,
            )
            for node, palette in themed(scene, name)
        ]

    def update(self, status: RobotStatus) -> None:
        """Show the suspected actuator, if any."""
        suspect = status.consistency.suspect
        if suspect == self._shown:
            return
        self._shown = suspect
        set_all(self._handles, visible=suspect in self._actuators)
        if suspect in self._actuators:
            x, y, z = self._places[self._actuators.index(suspect)]
            set_all(self._handles, position=(float(x), float(y), float(z) + _FAULT_RING_HEIGHT_M))
