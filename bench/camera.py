"""CPU time to draw three driving robots at 30 Hz, and to find them, in one thread."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

import cv2
import numpy as np

from bench.table import Row, Run
from tsd_twin import robots
from tsd_twin.camera.bodies import height_m, robot_solids
from tsd_twin.camera.detect import Window, detect
from tsd_twin.camera.lens import CameraPlace, Lens, View
from tsd_twin.camera.render import Body, SimulatedCamera
from tsd_twin.camera.setup_file import CameraSetup
from tsd_twin.camera.tags import Tag
from tsd_twin.camera.tracker import MARGIN_PX, MARGIN_SHARE, WHOLE_PICTURE_S, TagTracker
from tsd_twin.lie import SE2, Array

_WIDTH, _HEIGHT, _ACROSS_DEG, _ABOVE_M = 1280, 720, 60.0, 2.5
_RATE_HZ = 30.0
_PERIOD_MS = 1e3 / _RATE_HZ
_DRAWING, _FINDING = 0.2, 0.35
"""Fractions of a core that are allowed."""
_RADIUS_M, _SPEED_MPS = 0.25, 0.5
_CENTRES_M = -0.75, 0.0, 0.75
_WHOLE = round(WHOLE_PICTURE_S * _RATE_HZ)
"""Pictures from one search of the whole picture to the next."""


def rows(run: Run) -> Iterator[Row]:
    """Measure robots on circles under an ideal lens."""
    cv2.setNumThreads(1)  # As in tsd-camera.
    robot = robots.load_robot("tsd")
    solids = robot_solids(robot)
    tags = [Tag(i, 0.16, f"lab{i}", height_m(solids)) for i in range(len(_CENTRES_M))]
    view = View(Lens.ideal(_WIDTH, _HEIGHT, _ACROSS_DEG), CameraPlace.looking_down(_ABOVE_M))
    camera = SimulatedCamera(view)
    half_s = 0.5 * camera.sensor.exposure_s
    stamps_s = np.arange(int(run.pick(90, 20))) / _RATE_HZ
    scenes = [
        [
            (
                Body(solids, [tag]),
                camera.exposure_poses(*(_on_circle(i, s + d) for d in (-half_s, half_s))),
            )
            for i, tag in enumerate(tags)
        ]
        for s in stamps_s
    ]
    pictures = [camera.draw(scene) for scene in scenes]
    setup = CameraSetup(
        view.lens, view.place, tags=tuple(tags), exposure_s=camera.sensor.exposure_s
    )

    def draw() -> list[float]:
        start_s = time.thread_time()
        for scene in scenes:
            camera.draw(scene)
        return [1e3 * (time.thread_time() - start_s) / len(scenes)]

    def find() -> list[float]:
        tracker, found = TagTracker(setup), 0
        start_s = time.thread_time()
        for stamp_s, picture in zip(stamps_s.tolist(), pictures, strict=True):
            found += len(tracker.observe(picture, stamp_s).poses)
        spent_s = time.thread_time() - start_s
        if found < 0.95 * len(tags) * len(pictures):
            raise AssertionError(f"{found} robots found in {len(pictures)} pictures of {len(tags)}")
        return [1e3 * spent_s / len(pictures)]

    tracker = TagTracker(setup)
    observed = [tracker.observe(p, s) for p, s in zip(pictures, stamps_s.tolist(), strict=True)]
    windows = [
        [_window(sighting.corners) for sighting in each.sightings]
        if i % _WHOLE
        else [Window(0, 0, _WIDTH, _HEIGHT)]
        for i, each in enumerate(observed)
    ]

    def opencv() -> list[float]:
        start_s = time.thread_time()
        for picture, places in zip(pictures, windows, strict=True):
            for place in places:
                detect(picture, place, tags[0].family)
        return [1e3 * (time.thread_time() - start_s) / len(pictures)]

    yield from run.alternate(["camera.draw"], draw, lambda: [_DRAWING * _PERIOD_MS])
    yield from run.alternate(["camera.find"], find, lambda: [_FINDING * _PERIOD_MS])
    yield from run.alternate(["camera.poses"], find, opencv)


def _on_circle(number: int, time_s: float) -> SE2:
    """Return the pose of a robot that turns as it drives."""
    angle = number + _SPEED_MPS / _RADIUS_M * time_s
    x, y = _RADIUS_M * math.cos(angle), _RADIUS_M * math.sin(angle)
    return SE2(np.array([_CENTRES_M[number] + x, y, angle]))


def _window(corners: Array) -> Window:
    margin_px = MARGIN_PX + MARGIN_SHARE * float(np.ptp(corners, axis=0).max())
    return Window.around(corners, margin_px, (_HEIGHT, _WIDTH))
