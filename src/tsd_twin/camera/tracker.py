"""Robots in a stream of pictures: where to look for tags, and which to believe."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tsd_twin.camera.detect import Gray, Sighting, Window, detect, find_tags, refined
from tsd_twin.camera.planar_fit import PlanarPose, Refusal, corner_sigma_px, measure
from tsd_twin.camera.setup_file import CameraSetup
from tsd_twin.camera.tags import Tag, side_cells
from tsd_twin.errors import TwinError
from tsd_twin.lie import Array

WHOLE_PICTURE_S = 0.5
"""Period of a search of the whole picture, for tags that are not tracked."""
_TWICE_S = 1.2
"""Time for which a number seen twice is refused: more than two searches of the whole picture."""
_FORGET_S = 0.5
"""A tag not seen for so long is no longer searched in a window."""
MARGIN_SHARE, MARGIN_PX = 0.25, 16.0
"""Margin of a window: relative to the width of the tag, which a turn may enlarge by 0.4, and in
pixels."""
LARGEST_SMEAR_CELLS = 0.8
"""Beyond it the cells of a tag run into each other."""
MOST_UNCERTAIN_M, MOST_UNCERTAIN_RAD = 0.02, math.radians(2.0)
"""Largest standard deviations of a pose that is published."""

_Key = tuple[str, int]


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """What a picture shows: robots with their poses, and tags that are not believed."""

    stamp_s: float
    poses: dict[str, PlanarPose] = field(default_factory=dict[str, PlanarPose])
    """By robot id."""
    refused: list[tuple[Tag, Refusal]] = field(default_factory=list[tuple[Tag, Refusal]])
    sightings: list[Sighting] = field(default_factory=list[Sighting])
    """Tags of this camera's file that were found, believed or not."""


@dataclass(slots=True, eq=False)
class _Track:
    """Latest corners of a tag and their velocity in pixels per second."""

    corners: Array
    seen_s: float
    velocity: Array = field(default_factory=lambda: np.zeros(2))

    def update(self, corners: Array, now_s: float) -> None:
        passed_s = now_s - self.seen_s
        if passed_s > 1e-4:
            self.velocity = (corners.mean(axis=0) - self.corners.mean(axis=0)) / passed_s
        self.corners, self.seen_s = corners, now_s

    def window(self, now_s: float, side: float, shape: tuple[int, ...]) -> Window:
        moved = self.velocity * (now_s - self.seen_s)
        # A robot may reverse: half of the predicted motion is margin.
        margin = MARGIN_PX + MARGIN_SHARE * side + 0.5 * float(np.abs(moved).max())
        return Window.around(self.corners + moved, margin, shape)


class TagTracker:
    """Finds the tags of a camera file in each picture; times are an argument."""

    def __init__(self, setup: CameraSetup) -> None:
        self.setup = setup
        self._view = setup.view
        self._tags: dict[_Key, Tag] = {(tag.family, tag.number): tag for tag in setup.tags}
        self._families = sorted({tag.family for tag in setup.tags})
        self._tracks: dict[_Key, _Track] = {}
        self._twice_until_s: dict[_Key, float] = {}
        self._whole_s = -math.inf

    def observe(self, picture: Gray, now_s: float) -> Observation:
        """Return the robots in a picture; `now_s` is the middle of its exposure.

        Raises:
            TwinError: If the picture has another size than the calibration.
        """
        lens = self.setup.lens
        if picture.shape != (lens.height, lens.width):
            raise TwinError(
                f"pictures of {picture.shape[1]} x {picture.shape[0]} show no poses: the camera "
                f"was calibrated with {lens.width} x {lens.height}"
            )
        seen = self._search(picture, now_s)
        numbers = Counter((each.family, each.number) for each in seen)
        for key, count in numbers.items():
            if count > 1:
                self._twice_until_s[key] = now_s + _TWICE_S
        result = Observation(now_s, sightings=seen)
        for sighting in seen:
            key = sighting.family, sighting.number
            tag = self._tags[key]
            if tag.robot is None:
                continue  # The floor does not move: the whole picture shows it often enough.
            smear_px = self._follow(key, sighting.corners, now_s)
            found = self._believed(picture, tag, sighting, smear_px, now_s)
            if isinstance(found, Refusal):
                result.refused.append((tag, found))
                continue
            best = result.poses.get(tag.robot)
            if best is None or np.trace(found.covariance) < np.trace(best.covariance):
                result.poses[tag.robot] = found
        return result

    def _search(self, picture: Gray, now_s: float) -> list[Sighting]:
        """Find the tags of this camera: in windows, or in the whole picture from time to time."""
        for key in [k for k, t in self._tracks.items() if now_s - t.seen_s > _FORGET_S]:
            del self._tracks[key]
        lens = self.setup.lens
        if not 0.0 <= now_s - self._whole_s < WHOLE_PICTURE_S:
            self._whole_s = now_s
            return [s for s in find_tags(picture, self._families, lens) if self._is_known(s)]
        found: list[Sighting] = []
        for (family, number), track in self._tracks.items():
            side = float(np.ptp(track.corners, axis=0).max())
            window = track.window(now_s, side, picture.shape)
            # Windows overlap where robots meet: each counts its own number only.
            found += [s for s in detect(picture, window, family) if s.number == number]
        return refined(picture, found, lens)

    def _is_known(self, sighting: Sighting) -> bool:
        return (sighting.family, sighting.number) in self._tags

    def _follow(self, key: _Key, corners: Array, now_s: float) -> float:
        """Update the track of a tag; return its motion during an exposure, in pixels."""
        track = self._tracks.get(key)
        if track is None:
            track = self._tracks[key] = _Track(corners, now_s)
            return 0.0
        before, passed_s = track.corners, now_s - track.seen_s
        track.update(corners, now_s)
        if passed_s <= 1e-4:
            return 0.0
        # The fastest corner also counts the turn.
        moved = np.linalg.norm(corners - before, axis=1).max()
        return float(moved) / passed_s * self.setup.exposure_s

    def _believed(
        self, picture: Gray, tag: Tag, sighting: Sighting, smear_px: float, now_s: float
    ) -> PlanarPose | Refusal:
        if now_s < self._twice_until_s.get((tag.family, tag.number), -math.inf):
            return Refusal.TWICE
        if smear_px > LARGEST_SMEAR_CELLS * sighting.side_px / side_cells(tag.family):
            return Refusal.BLURRED
        sigma_px = corner_sigma_px(picture, sighting, smear_px)
        found = measure(
            self._view, self.setup.covariance, tag, sighting, sigma_px, self.setup.errors
        )
        return found if isinstance(found, Refusal) else _certain(found)


def _certain(found: PlanarPose) -> PlanarPose | Refusal:
    """Return the pose, or a refusal if its covariance is too large to be of use."""
    variances = np.diag(found.covariance)
    most = np.array([MOST_UNCERTAIN_M, MOST_UNCERTAIN_M, MOST_UNCERTAIN_RAD])
    return found if (np.sqrt(variances) <= most).all() else Refusal.UNCERTAIN


def refusal_counts(observations: Sequence[Observation]) -> dict[str, int]:
    """Return how often each reason of a refusal occurs."""
    return dict(Counter(reason.value for each in observations for _, reason in each.refused))
