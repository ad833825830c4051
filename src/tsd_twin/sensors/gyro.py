"""Yaw gyro."""

from __future__ import annotations

import numpy as np

from tsd_twin.kinematics import Joint, JointKind
from tsd_twin.lie import Array
from tsd_twin.sensors.base import Bias, BodyMotion, Sensor
from tsd_twin.tables import NotNegative, Positive, Table


class Gyro(Table, frozen=True):
    """`[gyro]`: noise of a yaw-rate gyro.

    Defaults match a small MEMS gyro (Bosch BMI270 data sheet).
    """

    noise_rad_per_s: Positive = 0.0012
    """Standard deviation of a reading at 100 Hz."""
    bias_rad_per_s: NotNegative = 0.0005
    """Standard deviation of the bias per run, after one second of zeroing at rest."""
    scale_share: NotNegative = 0.004
    """Standard deviation of the relative error of the turn rate, per sensor."""


class YawGyro:
    """Simulated yaw gyro: white noise, and a bias and a scale that are constant per run.

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
        # A separate generator keeps bias and noise the same with any scale.
        own = random.spawn(1)[0].standard_normal(batch)
        self._scale = 1.0 + scale * noise.scale_share * own
        self._bias = scale * noise.bias_rad_per_s * random.standard_normal(batch)
        self._sigma = scale * noise.noise_rad_per_s
        self._rate: Array = np.zeros(batch)

    def advance(self, motion: BodyMotion, dt_s: float) -> None:  # noqa: ARG002  Common signature.
        """Follow the turn rate."""
        self._rate = motion.twist[..., 2]

    def read(self) -> Array:
        """Return the turn rate (..., 1), rad/s."""
        return self.measure(self._rate)[..., None]

    def measure(self, rate: Array) -> Array:
        """Return readings (...), rad/s, for true turn rates `rate` (...)."""
        return (
            self._scale * rate
            + self._bias
            + self._sigma * self._random.standard_normal(self._batch)
        )


class _GyroSensor:
    """The yaw gyro; `GyroOdometry` fuses it with the wheels."""

    def channels(self, table: Gyro) -> tuple[Joint, ...]:  # noqa: ARG002  Common signature.
        """Return the turn rate."""
        return (Joint("gyro", JointKind.VELOCITY),)

    def biases(self, table: Gyro) -> tuple[Bias, ...]:
        """Return the bias and the scale of the turn rate."""
        return (
            Bias("gyro_bias_rad_per_s", table.bias_rad_per_s),
            Bias("gyro_scale_share", table.scale_share),
        )

    def simulate(
        self, table: Gyro, batch: tuple[int, ...], random: np.random.Generator, scale: float
    ) -> YawGyro:
        """Return the gyro of simulated robots."""
        return YawGyro(table, random, batch, scale=scale)

    def model(self, table: Gyro) -> None:
        """Return None: an odometry uses the sensor."""


GYRO: Sensor[Gyro] = _GyroSensor()
