"""A camera above the floor that sees a robot, some time later."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from tsd_twin.lie import SE2, Array


@dataclass(frozen=True, slots=True)
class CameraNoise:
    """Of the overhead camera of the thesis: 24 frames a second; the rest is assumed."""

    rate_hz: float = 24.0
    late_s: float = 0.08
    sigma_m: float = 0.005
    sigma_rad: float = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """A pose that a camera saw."""

    taken_s: float
    pose: Array
    """(3,): x, y, heading."""


class Camera:
    """Poses at its frame rate, known some time after they were seen."""

    def __init__(self, noise: CameraNoise, random: np.random.Generator) -> None:
        self.noise = noise
        self._random = random
        self._next_s = 0.0
        self._coming: deque[Frame] = deque()

    def watch(self, now_s: float, pose: SE2) -> list[Frame]:
        """Look at a robot at `pose` (3,), and return the frames that have become known."""
        if now_s >= self._next_s - 1e-9:
            # What was missed while nobody looked is not made up for.
            self._next_s = max(self._next_s + 1.0 / self.noise.rate_hz, now_s)
            sigma = np.array([self.noise.sigma_m, self.noise.sigma_m, self.noise.sigma_rad])
            seen = pose.xy_heading + sigma * self._random.standard_normal(3)
            self._coming.append(Frame(now_s, seen))
        known: list[Frame] = []
        while self._coming and self._coming[0].taken_s + self.noise.late_s <= now_s + 1e-9:
            known.append(self._coming.popleft())
        return known
