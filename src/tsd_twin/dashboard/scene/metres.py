"""Metre labels of the floor: billboards along the left and the far edge of a client's picture."""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
import viser
from PIL import Image, ImageDraw, ImageFont

from tsd_twin.dashboard.scene.appearance import METRES, Rgb
from tsd_twin.dashboard.scene.framing import CameraPose, Rectangle, pictured
from tsd_twin.lie import SE2, SO3, Array

_LABEL_PX = 14
"""Enough for 12 px after the camera has followed the robot by the step of the labels."""
_SHARPNESS = 4
"""Pixels of a label's picture per pixel on the screen."""
_FONT = Path(__file__).parents[1] / "bundle" / "inter.woff2"
"""Font of the page; Pillow's own has no minus sign."""
_RANGE_M = 6
_STEP_M = 0.05
_LEAST_DEPTH_M = 0.1
_INSET = 0.05
_LEAST_APART = 0.09
"""Smallest distance of two labels, fraction of the picture."""


def metre_places(
    xy: tuple[float, float], pose: CameraPose, aspect: float, fov_rad: float, free: Rectangle
) -> dict[str, Array]:
    """Return the labels to show, and their places (2,) in `odom`.

    The lines across the view are labelled near the left edge of the free rectangle, the others near
    its upper edge. Labels that would overlap are left out.

    Args:
        xy: Position of the robot in `odom`.
        pose: Pose of the camera in `odom`.
        aspect: Width of the picture divided by its height.
        fov_rad: Vertical field of view.
        free: Rectangle that nothing covers.
    """
    low = np.array([free.left, free.top]) + _INSET
    high = np.array([free.right, free.bottom]) - _INSET
    ahead = pose.look_at - pose.position
    across = int(abs(ahead[0]) < abs(ahead[1]))  # Axis whose lines cross the view.
    along = np.arange(-_RANGE_M, _RANGE_M + _STEP_M, _STEP_M)
    found: dict[str, Array] = {}
    taken: list[Array] = []
    for axis, letter in enumerate("xy"):
        other = int(not axis)
        metres = np.arange(math.ceil(xy[axis] - _RANGE_M), math.floor(xy[axis] + _RANGE_M) + 1)
        lines = np.zeros((len(metres), len(along), 3))
        lines[..., axis], lines[..., other] = metres[:, None], xy[other] + along
        visible = (lines - pose.position) @ ahead > _LEAST_DEPTH_M * np.linalg.norm(ahead)
        seen = np.full((*visible.shape, 2), np.inf)
        seen[visible] = pictured(pose, lines[visible], aspect, fov_rad)
        inside = ((seen > low) & (seen < high)).all(axis=-1)
        edge = np.where(inside, seen[..., 0 if axis == across else 1], np.inf)
        for row in np.flatnonzero(inside.any(axis=-1)):
            best = row, int(np.argmin(edge[row]))
            if all(np.linalg.norm(seen[best] - each) > _LEAST_APART for each in taken):
                taken.append(seen[best])
                found[f"{letter} {metres[row]} m"] = lines[best][:2]
    return found


class MetreLabels:
    """Labels in a client's scene, moved only when they change."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._shown: dict[str, viser.ImageHandle] = {}

    def clear(self) -> None:
        """Discard this client's nodes."""
        self._shown.clear()

    def update(
        self, places: dict[str, Array], pose: CameraPose, px_per_m: float, colour: Rgb
    ) -> None:
        """Show labels.

        Args:
            places: Texts and places (2,) in `odom`.
            pose: Pose of the camera in `odom`.
            px_per_m: Height of the picture, pixels, at a distance of 1 m, metres.
            colour: Colour of the texts.
        """
        for text in self._shown.keys() - places.keys():
            self._shown.pop(text).remove()
        facing = _facing(pose)
        for text, at in places.items():
            distance_m = float(np.linalg.norm(pose.position - (*at, 0.0)))
            picture = text_picture(text, colour)
            scale = distance_m / px_per_m / _SHARPNESS
            height, width = picture.shape[:2]
            if text in self._shown:
                self._shown[text].position = (float(at[0]), float(at[1]), 0.5 * height * scale)
                self._shown[text].scale = scale
                self._shown[text].wxyz = facing
                continue
            self._shown[text] = self._client.scene.add_image(
                f"{METRES}/{text.replace(' ', '')}",
                picture,
                width,
                height,
                format="png",
                scale=scale,
                cast_shadow=False,
                receive_shadow=False,
                wxyz=facing,
                position=(float(at[0]), float(at[1]), 0.5 * height * scale),
            )


def in_odom(pose: CameraPose, world: SE2) -> CameraPose:
    """Return a pose in the scene as a pose in `odom`, whose pose in the scene is `world`."""
    back = world.inverse()
    return CameraPose(*(np.append(back.rotate(p[:2]) + back.xy_heading[:2], p[2]) for p in pose))


def _facing(pose: CameraPose) -> Array:
    """Return the orientation (4,) of a picture that faces a camera: x right, y down."""
    ahead = pose.look_at - pose.position
    heading_rad = math.atan2(ahead[1], ahead[0])
    elevation_rad = math.atan2(-ahead[2], math.hypot(ahead[0], ahead[1]))
    turn = SO3.exp(np.array([0.0, 0.0, heading_rad - 0.5 * math.pi]))
    tilt = SO3.exp(np.array([-0.5 * math.pi - elevation_rad, 0.0, 0.0]))
    return (turn @ tilt).wxyz


@lru_cache(maxsize=256)
def text_picture(text: str, colour: Rgb) -> npt.NDArray[np.uint8]:
    """Return a text on a transparent ground, (height, width, 4)."""
    font = ImageFont.truetype(_FONT, _LABEL_PX * _SHARPNESS)
    text = text.replace("-", "\N{MINUS SIGN}")
    left, top, right, bottom = font.getbbox(text)
    picture = Image.new("RGBA", (round(right - left) + 8, round(bottom - top) + 8), (*colour, 0))
    ImageDraw.Draw(picture).text((4 - left, 4 - top), text, font=font, fill=(*colour, 255))
    return np.asarray(picture)
