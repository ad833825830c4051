"""Pictures that are hard to read: glare, covers, other tags, small tags and tilted robots."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

import cv2
import numpy as np

from tsd_twin.camera.detect import Gray, side_px
from tsd_twin.camera.planar_fit import corner_points
from tsd_twin.camera.render import Body, SimulatedCamera, cylinder
from tsd_twin.camera.setup_file import CameraSetup
from tsd_twin.camera.simulated import random_view
from tsd_twin.camera.tags import Tag
from tsd_twin.camera.tracker import TagTracker
from tsd_twin.lie import Array, wrap

SIZE, ACROSS_DEG = (1280, 720), 60.0
TAG = Tag(3, 0.16, "tsd", 0.3)
SMALLEST_PX, LARGEST_PX = 25.0, 80.0
"""Sides of the tag in pixels."""
WHOLE_PX = 40.0
MOST_TILT_RAD = math.radians(3.0)
MOST_WRONG_M = 0.05
_SPOILT, _OTHERS = 0.4, 3
"""Probability of glare, and of a cover; largest number of other robots with tags."""
_VIEWED = 100
"""Frames of each camera."""


@dataclass
class Tally:
    """Counts over frames."""

    frames: int = 0
    whole: int = 0
    """Frames with the whole tag in view, neither covered nor in glare, of 40 px or more."""
    whole_used: int = 0
    used: int = 0
    wrong: list[tuple[int, float]] = field(default_factory=list)
    """Frames with a pose that is off by more than 5 cm, and the distance."""
    errors: list[Array] = field(default_factory=list)
    """Error (3,) of each used pose: x, y in metres, heading in radians."""
    refused: Counter[str] = field(default_factory=Counter)


def tally(count: int, seed: int) -> Tally:
    """Search `count` frames for a robot; return the counts."""
    random = np.random.default_rng(seed)
    result = Tally()
    while result.frames < count:
        # The side of the tag follows from the height of the camera.
        side = random.uniform(SMALLEST_PX, LARGEST_PX)
        focal_px = 0.5 * SIZE[0] / math.tan(math.radians(0.5 * ACROSS_DEG))
        height_m = TAG.height_m + focal_px * TAG.size_m / side
        camera = SimulatedCamera(
            random_view(SIZE, ACROSS_DEG, height_m, random), seed=int(random.integers(2**31))
        )
        for picture, true, side, is_whole in hard_frames(camera, random):
            if result.frames == count:
                break
            _judge(result, camera, picture, true)
            used = bool(result.errors) and len(result.errors) > result.used
            result.used += used
            if is_whole and side >= WHOLE_PX:
                result.whole += 1
                result.whole_used += used
            result.frames += 1
    return result


def _judge(result: Tally, camera: SimulatedCamera, picture: Gray, true: Array) -> None:
    """Look for the robot in a picture, as in the first one of a camera."""
    view = camera.view
    seen = TagTracker(CameraSetup(view.lens, view.place, tags=(TAG,))).observe(picture, 0.0)
    result.refused.update(reason.value for _, reason in seen.refused)
    for found in seen.poses.values():
        error = found.pose.xy_heading - true
        error[2] = wrap(error[2])
        result.errors.append(error)
        if not math.hypot(error[0], error[1]) <= MOST_WRONG_M:
            result.wrong.append((result.frames, math.hypot(error[0], error[1])))


def hard_frames(
    camera: SimulatedCamera, random: np.random.Generator
) -> Iterator[tuple[Gray, Array, float, bool]]:
    """Yield pictures, the true pose (3,), the side of the tag, and whether all of it is seen."""
    view = camera.view
    for _ in range(_VIEWED):
        spot = np.array(SIZE) * random.uniform(0.02, 0.98, 2)
        place = view.on_plane(spot[None], TAG.height_m)[0]
        true = np.array([*place, random.uniform(-np.pi, np.pi)])
        tilt, way = MOST_TILT_RAD * math.sqrt(random.uniform()), random.uniform(0.0, 2.0 * np.pi)
        leaning = np.array([*true, tilt * math.cos(way), tilt * math.sin(way)])
        shown = [(Body([cylinder(0.2, 0.29)], [TAG]), [leaning])]
        for number in range(random.integers(0, _OTHERS + 1)):
            other = Tag(10 + int(random.integers(0, 400)), TAG.size_m, f"other{number}", 0.3)
            away = random.uniform(0.8, 1.6) * np.array(
                [math.cos(number * 2.1), math.sin(number * 2.1)]
            )
            pose = np.array([*(place + away), random.uniform(-np.pi, np.pi)])
            shown.append((Body([cylinder(0.2, 0.29)], [other]), [pose]))
        corners = view.project(corner_points(TAG, true))
        side = side_px(corners)
        inside = bool(((corners > 0.2 * side) & (corners < np.array(SIZE) - 0.2 * side)).all())
        picture, spoilt = _spoil(camera.draw(shown), corners, random)
        yield picture, true, side, inside and not spoilt


def _spoil(picture: Gray, corners: Array, random: np.random.Generator) -> tuple[Gray, bool]:
    """Return a picture with glare and covers near the tag, and whether they touch it."""
    side, middle = side_px(corners), corners.mean(axis=0)
    outline = cv2.fillConvexPoly(
        np.zeros(picture.shape, np.uint8), np.rint(_grown(corners, 1.3)).astype(np.int32), 1
    )
    spoilt = False
    if random.uniform() < _SPOILT:
        at = middle + side * random.normal(0.0, 0.8, 2)
        axes = side * random.uniform(0.1, 0.8, 2)
        shape = np.zeros(picture.shape, np.uint8)
        ellipse = (
            (float(at[0]), float(at[1])),
            (float(axes[0]), float(axes[1])),
            float(random.uniform(0.0, 180.0)),
        )
        cv2.ellipse(shape, ellipse, 255, -1)
        light = cv2.GaussianBlur(shape, (0, 0), max(1.0, 0.1 * side))
        picture = np.asarray(cv2.add(picture, light), np.uint8)
        spoilt |= bool(light[outline > 0].max() > 20)
    if random.uniform() < _SPOILT:
        at = middle + side * random.normal(0.0, 0.6, 2)
        size = side * random.uniform(0.1, 1.5, 2)
        rectangle = (
            (float(at[0]), float(at[1])),
            (float(size[0]), float(size[1])),
            float(random.uniform(0.0, 180.0)),
        )
        cover = np.rint(cv2.boxPoints(rectangle)).astype(np.int32)
        picture = picture.copy()
        cv2.fillConvexPoly(picture, cover, int(random.integers(10, 246)), cv2.LINE_AA)
        mask = cv2.fillConvexPoly(np.zeros(picture.shape, np.uint8), cover, 1)
        spoilt |= bool((mask & outline).any())
    return picture, spoilt


def _grown(corners: Array, factor: float) -> Array:
    """Return a quadrilateral with its quiet zone."""
    middle = corners.mean(axis=0)
    return middle + factor * (corners - middle)
