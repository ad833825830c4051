"""Guided calibration of a camera: takes pictures, fits, draws residuals, and gives a verdict."""

from __future__ import annotations

import itertools
import math
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from tsd_twin.camera.board import Board
from tsd_twin.camera.calibration import (
    DISTANCE_SIGMA_M,
    Distances,
    FloorFit,
    LensFit,
    fit_floor,
    fit_lens,
)
from tsd_twin.camera.detect import Gray, Sighting, find_tags, side_px
from tsd_twin.camera.lens import LENS_PARAMETERS, PARAMETERS, View
from tsd_twin.camera.planar_fit import Refusal, measure
from tsd_twin.camera.render import SimulatedCamera
from tsd_twin.camera.setup_file import CameraSetup, read_setup, write_setup
from tsd_twin.camera.simulated import board_pictures
from tsd_twin.camera.sources import Source
from tsd_twin.camera.tags import Tag
from tsd_twin.errors import TwinError
from tsd_twin.lie import SE2, Array

VIEWS = 20
FLOOR_PICTURES = 20
_MEASURED_TAGS = 4
_PATIENCE_S = 120.0
_NEW_VIEW_PX = 60.0
"""Least motion of the board between two views, relative to none."""
_STILL_PX = 1.5
"""Most motion of a board that is held still, between two pictures."""
_GOOD_LENS_PX, _GOOD_FLOOR_PX = 0.5, 0.4
_ROBOT_TAG_M, _ROBOT_HEIGHT_M = 0.16, 0.3
"""Tag for which the verdict is given, unless the file has one on a robot."""
_LEAST_TAG_PX = 50.0
_SMEAR_SHARE = 0.1
"""Part of the side of a tag that may smear during an exposure."""
_DRAWN_ERROR = 200.0
"""Residuals are drawn so many times as long."""


def calibrate_lens(source: Source, board: Board, file: str, stop: threading.Event) -> None:
    """Collect views of a board from a camera, and write the lens.

    Raises:
        TwinError: If too few views are seen, or they do not determine a lens.
    """
    _say("Hold the board in front of the camera: near and far, in all corners, at a slant, still.")
    try:
        _finish_lens(list(_still_views(source, board, stop)), file, source_size(source))
    finally:
        source.close()


def calibrate_lens_simulated(camera: SimulatedCamera, board: Board, file: str, seed: int) -> None:
    """Calibrate the lens of a simulated camera from drawn views of a board."""
    pictures = board_pictures(camera, board, 2 * VIEWS, np.random.default_rng(seed))
    found = (board.find(picture) for picture in pictures)
    views = [view for view in found if view is not None][:VIEWS]
    lens = camera.view.lens
    _finish_lens(views, file, (lens.width, lens.height))


def calibrate_floor(
    setup: CameraSetup,
    pictures: Iterable[Gray],
    tags: Mapping[int, Tag],
    origin: SE2,
    distances_m: Distances,
    file: str,
) -> FloorFit:
    """Find the place of a camera from pictures of tags on the floor, write it, and judge it.

    Raises:
        TwinError: If fewer than three of the tags are seen.
    """
    corners: dict[int, list[Array]] = {}
    picture: Gray | None = None
    for picture in pictures:
        for seen in find_tags(picture, {tag.family for tag in tags.values()}, setup.lens):
            if seen.number in tags:
                corners.setdefault(seen.number, []).append(seen.corners)
    means = {number: np.median(seen, axis=0) for number, seen in corners.items()}
    lens = LensFit(
        setup.lens,
        setup.covariance[:LENS_PARAMETERS, :LENS_PARAMETERS],
        0.0,
        np.zeros((0, 4)),
    )
    found = fit_floor(lens, means, tags, origin, distances_m)
    on_robots = tuple(tag for tag in setup.tags if tag.robot is not None)
    made = replace(
        setup,
        lens=found.view.lens,
        place=found.view.place,
        covariance=found.covariance,
        tags=found.tags + on_robots,
    )
    write_setup(file, made)
    drawn = Path(file).with_suffix(".floor.png")
    if picture is not None:
        _save(drawn, draw_residuals(picture, found.residuals, found.view))
    _say(f"{len(found.tags)} tags, {found.rms_px:.2f} px RMS; drawn in {drawn}")
    for line in verdict(made):
        _say(line)
    return found


def measured(tags: Sequence[Tag], seed: int) -> tuple[list[int], SE2, Distances]:
    """Return the numbers of tags, the origin, and distances as measured with a tape.

    The distances are those between any two of the first four tags.
    """
    known = sorted(tags, key=lambda tag: tag.number)
    first, second = known[:2]
    random = np.random.default_rng(seed + 1)
    distances_m = {
        (a.number, b.number): _apart_m(a, b) + DISTANCE_SIGMA_M * random.standard_normal()
        for a, b in itertools.combinations(known[:_MEASURED_TAGS], 2)
    }
    way = math.atan2(second.y_m - first.y_m, second.x_m - first.x_m)
    origin = SE2(np.array([first.x_m, first.y_m, way]))
    return [tag.number for tag in tags], origin, distances_m


def _apart_m(a: Tag, b: Tag) -> float:
    return math.hypot(b.x_m - a.x_m, b.y_m - a.y_m)


def verdict(setup: CameraSetup) -> list[str]:
    """Return sentences: errors in the middle and at the edge, size of the tag, longest exposure."""
    view = setup.view
    tag = next(
        (tag for tag in setup.tags if tag.robot is not None),
        Tag(0, _ROBOT_TAG_M, "robot", _ROBOT_HEIGHT_M),
    )
    middle = np.array([view.lens.width - 1.0, view.lens.height - 1.0]) / 2.0
    lines: list[str] = []
    sides: list[float] = []
    for name, share in (("in the middle", 0.0), ("at the edge", 0.85)):
        spots = middle + share * middle * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [0, 0]])
        places = view.on_plane(spots, tag.height_m)
        judged = [_stated(view, setup, tag, place) for place in places if np.isfinite(place).all()]
        if not judged:
            lines.append(f"{name}: the floor is not in view")
            continue
        errors = np.max([error for error, _ in judged], axis=0)
        sides.append(min(side for _, side in judged))
        lines.append(
            f"{name}: {1e3 * errors[0]:.1f} mm and {math.degrees(errors[1]):.2f} degrees (1 sigma) "
            f"for a tag of {1e3 * tag.size_m:g} mm, {sides[-1]:.0f} px"
        )
    if sides and min(sides) < _LEAST_TAG_PX:
        larger = tag.size_m * _LEAST_TAG_PX / min(sides)
        lines.append(f"the tag is small: {1e3 * larger:.0f} mm would be {_LEAST_TAG_PX:.0f} px")
    longest_ms = 1e3 * _SMEAR_SHARE * tag.size_m
    lines.append(f"expose for at most {longest_ms:.0f} ms at 1 m/s, shorter if it drives faster")
    return lines


def take_pictures(source: Source, count: int) -> list[Gray]:
    """Return the next pictures of a camera.

    Raises:
        TwinError: If no picture arrives within two minutes.
    """
    pictures: list[Gray] = []
    try:
        for _ in range(int(_PATIENCE_S / 0.2)):
            frame = source.read(0.2)
            if frame is not None:
                pictures.append(frame.gray)
            if len(pictures) == count:
                break
    finally:
        source.close()
    if not pictures:
        raise TwinError("the camera sends no pictures")
    return pictures


def source_size(source: Source) -> tuple[int, int]:
    """Return width and height of a camera's pictures.

    Raises:
        TwinError: If it sends none.
    """
    for _ in range(50):
        frame = source.read(0.2)
        if frame is not None:
            return frame.picture.shape[1], frame.picture.shape[0]
    raise TwinError("the camera sends no pictures")


def draw_residuals(picture: Gray, residuals: Array, view: View | None = None) -> np.ndarray:
    """Return a colour picture with an arrow for each error (n, 4), 200 times as long.

    With a `view`, the visible floor is drawn with lines each half metre.
    """
    drawn = cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)
    if view is not None:
        _draw_grid(drawn, view)
    for column, row, right, down in residuals:
        start = round(column), round(row)
        end = round(column + _DRAWN_ERROR * right), round(row + _DRAWN_ERROR * down)
        cv2.arrowedLine(drawn, start, end, (0, 90, 255), 1, cv2.LINE_AA, tipLength=0.2)
    return drawn


def _draw_grid(drawn: np.ndarray, view: View) -> None:
    reach = 6.0
    along = np.linspace(-reach, reach, 97)
    for at in np.arange(-reach, reach + 0.1, 0.5):
        for points in ((along, np.full_like(along, at)), (np.full_like(along, at), along)):
            floor = np.column_stack([*points, np.zeros_like(along)])
            ahead = (floor - view.place.position_m) @ view.place.matrix[2] > 0.3
            if ahead.sum() > 1:
                line = np.rint(np.clip(view.project(floor[ahead]), -1e4, 1e4)).astype(np.int32)
                cv2.polylines(drawn, [line], False, (200, 160, 60), 1, cv2.LINE_AA)


def _still_views(
    source: Source, board: Board, stop: threading.Event
) -> Iterator[tuple[Array, Array]]:
    """Yield views in which the board is held still, each at another place."""
    before: Array | None = None
    taken: list[Array] = []
    while len(taken) < VIEWS and not stop.is_set():
        try:
            frame = source.read(0.2)
        except TwinError:
            return  # The end of a video or a folder: what was found has to suffice.
        if frame is None:
            continue
        view = board.find(frame.gray)
        if view is None:
            before = None
            continue
        place = _outline(view)
        still = before is not None and float(np.abs(place - before).max()) < _STILL_PX
        before = place
        if still and all(float(np.abs(place - each).max()) > _NEW_VIEW_PX for each in taken):
            taken.append(place)
            _say(f"view {len(taken)} of {VIEWS}: move the board")
            yield view


def _outline(view: tuple[Array, Array]) -> Array:
    """Return where the corners of the board are (4, 2), extrapolated from those that are seen."""
    plane, _ = cv2.findHomography(view[0][:, :2], view[1])
    size = view[0][:, :2].max(axis=0)
    square = np.array([[[0, 0], [size[0], 0], size, [0, size[1]]]], float)
    return cv2.perspectiveTransform(square, plane)[0]


def _finish_lens(views: list[tuple[Array, Array]], file: str, size: tuple[int, int]) -> None:
    fit = fit_lens(views, size)
    covariance = np.zeros((PARAMETERS, PARAMETERS))
    covariance[:LENS_PARAMETERS, :LENS_PARAMETERS] = fit.covariance
    known = read_setup(file) if Path(file).exists() else CameraSetup(fit.lens)
    # The place was fitted with the former lens.
    write_setup(file, replace(known, lens=fit.lens, place=None, covariance=covariance))
    drawn = Path(file).with_suffix(".lens.png")
    blank = np.full((size[1], size[0]), 255, np.uint8)
    _save(drawn, draw_residuals(blank, fit.residuals))
    judged = (
        "good" if fit.rms_px <= _GOOD_LENS_PX else "poor: is the board flat and printed at 100 %?"
    )
    _say(f"{len(views)} views, {fit.rms_px:.2f} px RMS, {judged}; written to {file}, {drawn}")


def _stated(view: View, setup: CameraSetup, tag: Tag, place: Array) -> tuple[Array, float]:
    """Return the standard deviations of position and heading (2,), and the side in pixels."""
    points = np.column_stack([place + tag.corners_m, np.full(4, tag.height_m)])
    corners = view.project(points)
    level = replace(tag, x_m=0.0, y_m=0.0, heading_rad=0.0)
    sighting = Sighting(tag.family, tag.number, corners)
    found = measure(view, setup.covariance, level, sighting, 0.1, setup.errors)
    side = side_px(corners)
    if isinstance(found, Refusal):
        return np.array([math.inf, math.inf]), side
    variances = np.diag(found.covariance)
    return np.sqrt([variances[:2].max(), variances[2]]), side


def _say(text: str) -> None:
    print(text, flush=True)  # noqa: T201  Output for the person who calibrates.


def _save(path: Path, picture: np.ndarray) -> None:
    if not cv2.imwrite(str(path), picture):
        raise TwinError(f"{path} cannot be written")
