"""Gyro: its table, and its simulation."""

from __future__ import annotations

import numpy as np

from tsd_twin.kinematics import Joint, JointKind
from tsd_twin.lie import Array
from tsd_twin.tables import NotNegative, Positive, Table


class Gyro(Table, frozen=True):
    """`[gyro]`: noise of a yaw-rate gyro.

    Defaults match a small MEMS gyro (Bosch BMI270 data sheet).
    """

    noise_rad_per_s: Positive = 0.0012
    """Standard deviation of a reading at 100 Hz."""
    bias_rad_per_s: NotNegative = 0.0005
    """Standard deviation of the bias per run, after one second of zeroing at rest."""


GYRO_SENSORS = (Joint("gyro", JointKind.VELOCITY),)
"""Sensors of a robot with a yaw gyro only."""


class YawGyro:
    """Simulated yaw gyro: white noise and a bias that is constant per run.

    `scale` multiplies the described errors; each robot of a batch has a separate gyro.
    """

    def __init__(
        self,
        noise: Gyro,
        random: np.random.Generator,
        batch: tuple[int, ...] = (),
        *,
        scale: float = 1.0,
    ) -> None:
        self.noise = noise
        self._random = random
        self._batch = batch
        self._bias = scale * noise.bias_rad_per_s * random.standard_normal(batch)
        self._sigma = scale * noise.noise_rad_per_s

    def measure(self, rate: Array) -> Array:
        """Return readings (...), rad/s, for true turn rates `rate` (...)."""
        return rate + self._bias + self._sigma * self._random.standard_normal(self._batch)
