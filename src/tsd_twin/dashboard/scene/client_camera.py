"""Camera of a client: framed at first sight and by the presets, otherwise the client's own."""

from __future__ import annotations

import math

import numpy as np
import viser

from tsd_twin.dashboard.scene.framing import (
    CHASE_RAD,
    ELEVATION_RAD,
    TOP_RAD,
    CameraPose,
    Rectangle,
    Stand,
    frame_robot,
)
from tsd_twin.dashboard.scene.robot_geometry import RobotShape
from tsd_twin.dashboard.scene.viser_compat import CAMERA_OFFSET_M, FIELD_OF_VIEW_RAD
from tsd_twin.dashboard.wire.view import CameraPreset
from tsd_twin.lie import SE2

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
        self._frame = frame
        self._placed: CameraPose | None = None
        self._placed_aspect = _USUAL_ASPECT
        self.placed_for: str | None = None
        """Robot in front of which the camera was placed with a known pose."""
        self.heading_rad = 0.0
        """Azimuth of the view in the scene when the camera was placed."""

    @property
    def frame(self) -> Rectangle:
        """Free part of the picture."""
        return self._frame

    @property
    def px_per_m(self) -> float:
        """Height on the screen, CSS pixels, of an object 1 m high at a distance of 1 m.

        Without a page, viser's client reports the pixels that it draws, of which a screen pixel may
        have several or less than one.
        """
        height_px = self._frame.picture_px or float(self._camera.image_height)
        return 0.5 * max(_LEAST_PICTURE_PX, height_px) / math.tan(0.5 * FIELD_OF_VIEW_RAD)

    @property
    def placed(self) -> CameraPose | None:
        """Pose in the scene where the camera was placed, if it was."""
        return self._placed

    def set_frame(self, frame: Rectangle) -> bool:
        """Set the free part of the picture; return whether the camera is where it was placed."""
        changed, self._frame = frame != self._frame, frame
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
        return self._placed is not None and away < _UNTOUCHED_M and not self._is_untouched

    def place(self, shape: RobotShape, at: SE2, preset: CameraPreset, *, planar: bool) -> None:
        """Frame a robot at a pose in the scene; spheres and the view from above do not turn."""
        x, y, heading_rad = (float(number) for number in at.xy_heading)
        turns = planar and preset is not CameraPreset.TOP
        self.heading_rad = heading_rad if turns else 0.0
        self._placed_aspect = aspect = self.aspect
        stand = Stand((x, y), shape.reach_m, shape.height_m + LABELS_ABOVE_M)
        pose = frame_robot(
            stand, self.heading_rad, aspect, FIELD_OF_VIEW_RAD, self._frame, _ELEVATIONS_RAD[preset]
        )
        self._camera.fov = FIELD_OF_VIEW_RAD  # A new client first reports viser's default.
        self._camera.position, self._camera.look_at = pose
        self._placed = pose

    @property
    def aspect(self) -> float:
        """Width of the picture divided by its height; clients may send invalid cameras."""
        aspect = float(self._camera.aspect)
        return aspect if _ASPECTS[0] < aspect < _ASPECTS[1] else _USUAL_ASPECT

    @property
    def _is_untouched(self) -> bool:
        if self._placed is None:
            return False
        return bool(np.linalg.norm(self._camera.position - self._placed.position) < _UNTOUCHED_M)
