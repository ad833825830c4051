"""Pose sensor, such as an overhead camera: its table, and the simulation of its frames."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from tsd_twin.lie import SE2, Array
from tsd_twin.tables import NotNegative, Positive, Table


class PoseSensor(Table, frozen=True):
    """`[pose_sensor]`: noise of an external pose sensor, such as an overhead camera.

    Defaults match the camera simulated by `tsd-lab` and `tsd-mock --camera`.
    """

    sigma_m: Positive = 0.005
    """Standard deviation of x and y."""
    sigma_deg: Positive = 1.15
    """Standard deviation of the heading."""
    mounting_m: NotNegative = 0.01
    """Standard deviation of the bias in x and y, from the mounting position."""
    mounting_deg: NotNegative = 0.5
    """Standard deviation of the bias in the heading."""

    def camera_noise(self) -> CameraNoise:
        """Return the noise of a camera with this accuracy, without bias."""
        return CameraNoise(sigma_m=self.sigma_m, sigma_rad=math.radians(self.sigma_deg))


@dataclass(frozen=True, slots=True)
class CameraNoise:
    """Noise, delay and frame rate of an overhead camera (24 fps in the thesis, rest assumed)."""

    rate_hz: float = 24.0
    latency_s: float = 0.08
    sigma_m: float = 0.005
    sigma_rad: float = 0.02
    mounting_m: float = 0.0
    """Standard deviation of a constant error of x and y."""
    mounting_rad: float = 0.0
    """Standard deviation of a constant error of the heading."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """Camera frame: a measured pose with its time."""

    taken_s: float
    pose: Array
    """(3,): x, y, heading."""


class Camera:
    """Simulated overhead camera: noisy poses at a frame rate, with processing delay."""

    def __init__(self, noise: CameraNoise, random: np.random.Generator) -> None:
        self.noise = noise
        self._random = random
        self._mounting = np.zeros(3)
        if noise.mounting_m > 0.0 or noise.mounting_rad > 0.0:
            mounting = np.array([noise.mounting_m, noise.mounting_m, noise.mounting_rad])
            self._mounting = mounting * random.standard_normal(3)
        self._next_s = 0.0
        self._in_transit: deque[Frame] = deque()

    def capture(self, now_s: float, pose: SE2) -> list[Frame]:
        """Measure a robot at `pose` (3,), and return the frames whose processing has finished."""
        if now_s >= self._next_s - 1e-9:
            # Frames missed between two calls are dropped.
            self._next_s = max(self._next_s + 1.0 / self.noise.rate_hz, now_s)
            sigma = np.array([self.noise.sigma_m, self.noise.sigma_m, self.noise.sigma_rad])
            seen = pose.xy_heading + self._mounting + sigma * self._random.standard_normal(3)
            self._in_transit.append(Frame(now_s, seen))
        known: list[Frame] = []
        while (
            self._in_transit and self._in_transit[0].taken_s + self.noise.latency_s <= now_s + 1e-9
        ):
            known.append(self._in_transit.popleft())
        return known
