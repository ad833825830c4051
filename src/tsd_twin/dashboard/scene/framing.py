"""Camera of a client, and camera poses that frame a robot in the free part of the picture."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import viser

from tsd_twin.dashboard.scene.robot_geometry import RobotShape
from tsd_twin.dashboard.scene.viser_compat import CAMERA_OFFSET_M, FIELD_OF_VIEW_RAD
from tsd_twin.dashboard.wire.view import CameraPreset
from tsd_twin.lie import SE2, Array

ELEVATION_RAD = math.radians(33.0)
"""Elevation of the camera behind the robot, seen from the robot."""
TOP_RAD = math.radians(89.5)
"""Elevation of the camera above the robot; it looks almost straight down."""
CHASE_RAD = math.radians(20.0)
"""Elevation of the camera that turns with the robot."""
SHARE_OF_HEIGHT = 0.54
"""Height of the robot in the picture, relative to the free rectangle."""
SHARE_OF_WIDTH = 0.86
"""Maximum width of the robot; it bounds the robot's size in narrow windows."""
_LEAST_SIDE = 0.05
_RIM_POINTS = 24
_AIMING_STEPS = 4
_BISECTIONS = 24
_NEAREST, _FARTHEST = 1.05, 400.0
"""Bounds of the camera's distance, relative to the robot's size."""


class Rectangle(NamedTuple):
    """Part of the picture, in fractions of its width and height from the upper left corner."""

    left: float = 0.0
    top: float = 0.0
    right: float = 1.0
    bottom: float = 1.0
    picture_px: float = 0.0
    """Height of the whole picture on the screen, CSS pixels; 0 if unknown."""

    @property
    def is_usable(self) -> bool:
        """Whether a robot in it could be seen."""
        wide, high = self.right - self.left, self.bottom - self.top
        return wide >= _LEAST_SIDE and high >= _LEAST_SIDE


WHOLE_PICTURE = Rectangle()


class Stand(NamedTuple):
    """Space that a robot takes: an upright cylinder on the floor."""

    xy: tuple[float, float]
    reach_m: float
    height_m: float


class CameraPose(NamedTuple):
    """Position of a camera, and a point in the middle of its picture; up is +Z."""

    position: Array
    look_at: Array


def rim_points(stand: Stand, start_rad: float = 0.0) -> Array:
    """Return points (n, 3) of both rims of a stand, from a direction on."""
    angles = start_rad + np.arange(_RIM_POINTS) * 2.0 * np.pi / _RIM_POINTS
    ring = stand.reach_m * np.stack([np.cos(angles), np.sin(angles)], axis=-1) + stand.xy
    return np.concatenate([np.insert(ring, 2, z, axis=1) for z in (0.0, stand.height_m)])


def pictured(pose: CameraPose, points: Array, aspect: float, fov_rad: float) -> Array:
    """Return the picture positions (n, 2) of points (n, 3), fractions to the right and down.

    Args:
        pose: Pose of the camera.
        points: (n, 3): points in front of the camera, metres.
        aspect: Width of the picture divided by its height.
        fov_rad: Vertical field of view.
    """
    ahead = pose.look_at - pose.position
    ahead = ahead / np.linalg.norm(ahead)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right = right / np.linalg.norm(right)
    axes = np.stack([right, np.cross(ahead, right), ahead])
    across, down, depth = axes @ (points - pose.position).T
    half = math.tan(0.5 * fov_rad)
    return 0.5 + 0.5 * np.stack([across / (half * aspect), down / half], axis=-1) / depth[:, None]


def frame_robot(
    stand: Stand,
    heading_rad: float,
    aspect: float,
    fov_rad: float,
    free: Rectangle = WHOLE_PICTURE,
    elevation_rad: float = ELEVATION_RAD,
) -> CameraPose:
    """Return the camera pose behind a robot that fits it into the free rectangle.

    The robot fills `SHARE_OF_HEIGHT` of the rectangle's height, or `SHARE_OF_WIDTH` of its width if
    that is less, and is in its middle. The camera looks along the heading, so that the robot's way
    ahead is up in the picture.

    Args:
        stand: Space of the robot in the scene.
        heading_rad: Direction away from the camera.
        aspect: Width of the picture divided by its height.
        fov_rad: Vertical field of view.
        free: Rectangle that nothing covers; the whole picture unless it `is_usable`.
        elevation_rad: Angle by which the camera looks down, below 90 degrees.
    """
    free = free if free.is_usable else WHOLE_PICTURE
    camera = _Camera(stand, heading_rad, elevation_rad, aspect, fov_rad)
    size = math.hypot(stand.reach_m, 0.5 * stand.height_m)
    near, far = _NEAREST * size, _FARTHEST * size
    for _ in range(_BISECTIONS):
        middle = math.sqrt(near * far)
        wide, high = camera.extent(camera.aimed(middle, free))
        large = high > SHARE_OF_HEIGHT * (free.bottom - free.top)
        large |= wide > SHARE_OF_WIDTH * (free.right - free.left)
        near, far = (middle, far) if large else (near, middle)
    return camera.aimed(far, free)


class _Camera:
    """Camera of a fixed orientation that is moved to see a robot."""

    def __init__(
        self,
        stand: Stand,
        heading_rad: float,
        elevation_rad: float,
        aspect: float,
        fov_rad: float,
    ) -> None:
        self._points = rim_points(stand, heading_rad)
        self._middle = np.array([*stand.xy, 0.5 * stand.height_m])
        cos, sin = math.cos(heading_rad), math.sin(heading_rad)
        level, steep = math.cos(elevation_rad), math.sin(elevation_rad)
        self._ahead = np.array([level * cos, level * sin, -steep])
        self._right = np.array([sin, -cos, 0.0])
        self._down = np.array([-steep * cos, -steep * sin, -level])
        self._aspect, self._fov_rad = aspect, fov_rad

    def aimed(self, distance_m: float, free: Rectangle) -> CameraPose:
        """Return the pose with the robot in the middle of a rectangle."""
        wanted = 0.5 * np.array([free.left + free.right, free.top + free.bottom])
        pose = self._pose(distance_m, wanted)
        goal = wanted
        for _ in range(_AIMING_STEPS):  # Perspective moves the robot's outline off its middle.
            seen = pictured(pose, self._points, self._aspect, self._fov_rad)
            goal = goal + wanted - 0.5 * (seen.min(axis=0) + seen.max(axis=0))
            pose = self._pose(distance_m, goal)
        return pose

    def _pose(self, distance_m: float, goal: Array) -> CameraPose:
        """Return the pose with the robot's middle at a place (2,) of the picture."""
        half = math.tan(0.5 * self._fov_rad) * np.array([self._aspect, 1.0])
        x, y = (2.0 * goal - 1.0) * half
        away = self._ahead + x * self._right + y * self._down
        position = self._middle - distance_m * away
        return CameraPose(position, position + distance_m * self._ahead)

    def extent(self, pose: CameraPose) -> tuple[float, float]:
        """Return width and height of the robot in the picture, fractions."""
        wide, high = np.ptp(pictured(pose, self._points, self._aspect, self._fov_rad), axis=0)
        return float(wide), float(high)


_ELEVATIONS_RAD = {
    CameraPreset.ISO: ELEVATION_RAD,
    CameraPreset.TOP: TOP_RAD,
    CameraPreset.CHASE: CHASE_RAD,
}
_UNTOUCHED_M = 0.01
"""Largest difference to the pose where the camera was placed."""
_ASPECTS = (0.1, 10.0)
_USUAL_ASPECT, _ASPECT_CHANGE = 1.5, 0.01
_LEAST_PICTURE_PX = 100
LABELS_ABOVE_M = 0.05
"""Space above a robot for its overlays."""


class ClientCamera:
    """Places the camera of a client."""

    def __init__(self, client: viser.ClientHandle, frame: Rectangle) -> None:
        self._camera = client.camera
        self.frame = frame
        """Free part of the picture."""
        self.placed: CameraPose | None = None
        """Pose in the scene where the camera was placed, if it was."""
        self._placed_aspect = _USUAL_ASPECT
        self._placed_s = math.inf
        self.placed_for: str | None = None
        """Robot in front of which the camera was placed with a known pose."""
        self.heading_rad = 0.0
        """Azimuth of the view in the scene when the camera was placed."""

    @property
    def px_per_m(self) -> float:
        """Height on the screen of an object 1 m high at a distance of 1 m, in CSS pixels.

        Without a page, viser's client reports the pixels that it draws, of which a screen pixel may
        have several or less than one.
        """
        height_px = self.frame.picture_px or float(self._camera.image_height)
        return 0.5 * max(_LEAST_PICTURE_PX, height_px) / math.tan(0.5 * FIELD_OF_VIEW_RAD)

    def set_frame(self, frame: Rectangle) -> bool:
        """Set the free part of the picture; return whether the camera is where it was placed."""
        changed, self.frame = frame != self.frame, frame
        return changed and self._is_untouched

    @property
    def is_out_of_shape(self) -> bool:
        """Whether an untouched camera was placed for a picture of another shape."""
        changed = abs(self.aspect - self._placed_aspect) > _ASPECT_CHANGE * self._placed_aspect
        return changed and self._is_untouched

    @property
    def is_reset(self) -> bool:
        """Whether the client has put a placed camera back to where all clients begin.

        viser's client does that when it learns that pose later than the placed one.
        """
        away = float(np.linalg.norm(self._camera.position - np.array(CAMERA_OFFSET_M)))
        return self.placed is not None and away < _UNTOUCHED_M and not self._is_untouched

    def place(self, shape: RobotShape, at: SE2, preset: CameraPreset, *, planar: bool) -> None:
        """Frame a robot at a pose in the scene; spheres and the view from above do not turn."""
        x, y, heading_rad = (float(number) for number in at.xy_heading)
        turns = planar and preset is not CameraPreset.TOP
        self.heading_rad = heading_rad if turns else 0.0
        self._placed_aspect = aspect = self.aspect
        stand = Stand((x, y), shape.reach_m, shape.height_m + LABELS_ABOVE_M)
        pose = frame_robot(
            stand, self.heading_rad, aspect, FIELD_OF_VIEW_RAD, self.frame, _ELEVATIONS_RAD[preset]
        )
        self._camera.fov = FIELD_OF_VIEW_RAD  # A new client first reports viser's default.
        self._camera.position, self._camera.look_at = pose
        self.placed = pose
        self._placed_s = self._camera.update_timestamp

    @property
    def is_reported(self) -> bool:
        """Whether the client has reported its camera since it was placed."""
        return self._camera.update_timestamp > self._placed_s

    @property
    def aspect(self) -> float:
        """Width of the picture divided by its height; clients may send invalid cameras."""
        aspect = float(self._camera.aspect)
        return aspect if _ASPECTS[0] < aspect < _ASPECTS[1] else _USUAL_ASPECT

    @property
    def _is_untouched(self) -> bool:
        if self.placed is None:
            return False
        return bool(np.linalg.norm(self._camera.position - self.placed.position) < _UNTOUCHED_M)
