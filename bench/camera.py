"""CPU time to draw three driving robots at 30 Hz, and to find them, in one thread."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from typing import TypeAlias

import cv2
import numpy as np

from bench.table import Row, Run
from tsd_twin import robots
from tsd_twin.camera.bodies import height_m, robot_solids
from tsd_twin.camera.detect import Window, detect
from tsd_twin.camera.lens import CameraPlace, Lens, View
from tsd_twin.camera.render import Body, SimulatedCamera, exposure_poses
from tsd_twin.camera.setup_file import CameraSetup
from tsd_twin.camera.tags import DEFAULT_FAMILY, Tag
from tsd_twin.camera.tracker import (
    MARGIN_PX,
    MARGIN_SHARE,
    WHOLE_PICTURE_S,
    Observation,
    TagTracker,
)
from tsd_twin.lie import SE2, Array

Scene: TypeAlias = list[tuple[Body, Array]]
"""Robots with their poses during an exposure."""
_WIDTH, _HEIGHT, _ACROSS_DEG, _ABOVE_M = 1280, 720, 60.0, 2.5
_WHOLE = Window(0, 0, _WIDTH, _HEIGHT)
PERIOD_S = 1.0 / 30.0
_DRAWING, _FINDING = 0.2, 0.35
"""Fractions of a core that are allowed."""
_RADIUS_M, _SPEED_MPS = 0.25, 0.5
_CENTRES_M = -0.75, 0.0, 0.75
_ENOUGH = 0.95
"""Fraction of robots that must be found for the time to count."""


def rows(run: Run) -> Iterator[Row]:
    """Measure robots on circles under an ideal lens."""
    cv2.setNumThreads(1)  # As in tsd-camera.
    stamps_s = [PERIOD_S * i for i in range(int(run.pick(60, 15)))]
    camera, setup, scenes = driving_robots(stamps_s)
    tags = setup.tags
    pictures = [camera.draw(scene) for scene in scenes]

    def draw() -> None:
        for scene in scenes:
            camera.draw(scene)

    def find() -> list[Observation]:
        tracker = TagTracker(setup)
        return [tracker.observe(*each) for each in zip(pictures, stamps_s, strict=True)]

    seen = find()
    found = sum(len(each.poses) for each in seen)
    if found < _ENOUGH * len(tags) * len(seen):
        raise AssertionError(f"{found} robots found in {len(seen)} pictures of {len(tags)}")
    whole = round(WHOLE_PICTURE_S / PERIOD_S)
    windows = [
        [_window(each.corners) for each in observation.sightings] if i % whole else [_WHOLE]
        for i, observation in enumerate(seen)
    ]

    def opencv() -> None:
        for picture, places in zip(pictures, windows, strict=True):
            for place in places:
                detect(picture, place, DEFAULT_FAMILY)

    def picture_ms(work: Callable[[], object]) -> list[float]:
        start_s = time.thread_time()
        work()
        return [1e3 * (time.thread_time() - start_s) / len(pictures)]

    period_ms = 1e3 * PERIOD_S
    yield from run.alternate(
        ["camera.draw"], lambda: picture_ms(draw), lambda: [_DRAWING * period_ms]
    )
    yield from run.alternate(
        ["camera.find"], lambda: picture_ms(find), lambda: [_FINDING * period_ms]
    )
    yield from run.alternate(["camera.poses"], lambda: picture_ms(find), lambda: picture_ms(opencv))


def driving_robots(stamps_s: Sequence[float]) -> tuple[SimulatedCamera, CameraSetup, list[Scene]]:
    """Return a camera above three robots, its setup, and the robots in each exposure."""
    solids = robot_solids(robots.load_robot("tsd"))
    tags = [Tag(i, 0.16, f"lab{i}", height_m(solids)) for i in range(len(_CENTRES_M))]
    bodies = [Body(solids, [tag]) for tag in tags]
    view = View(Lens.ideal(_WIDTH, _HEIGHT, _ACROSS_DEG), CameraPlace.looking_down(_ABOVE_M))
    camera = SimulatedCamera(view)
    setup = CameraSetup(
        view.lens, view.place, tags=tuple(tags), exposure_s=camera.sensor.exposure_s
    )
    scenes = [
        [(body, _exposed(i, at_s, setup.exposure_s)) for i, body in enumerate(bodies)]
        for at_s in stamps_s
    ]
    return camera, setup, scenes


def _exposed(number: int, time_s: float, exposure_s: float) -> Array:
    """Return the poses of a robot that turns as it drives, during an exposure."""
    before, after = (_on_circle(number, time_s + at * exposure_s) for at in (-0.5, 0.5))
    return exposure_poses(before, after)


def _on_circle(number: int, time_s: float) -> SE2:
    angle = number + _SPEED_MPS / _RADIUS_M * time_s
    x, y = _RADIUS_M * math.cos(angle), _RADIUS_M * math.sin(angle)
    return SE2(np.array([_CENTRES_M[number] + x, y, angle]))


def _window(corners: Array) -> Window:
    margin_px = MARGIN_PX + MARGIN_SHARE * float(np.ptp(corners, axis=0).max())
    return Window.around(corners, margin_px, (_HEIGHT, _WIDTH))
