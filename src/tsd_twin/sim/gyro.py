"""A yaw gyro on a simulated robot, whatever plant moves it."""

from __future__ import annotations

import numpy as np

from tsd_twin.lie import Array
from tsd_twin.robots import Gyro
from tsd_twin.sim.around import Around
from tsd_twin.sim.simulation import Simulation


class YawGyro:
    """Turn rates with white noise, and an offset that stays for the run.

    `scale` times as wrong as its description, and one for each robot of a batch.
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
        """Return the readings, rad/s, (...), at true turn rates `rate` (...)."""
        return rate + self._bias + self._sigma * self._random.standard_normal(self._batch)


class GyroSimulation(Around[Simulation]):
    """Another simulation, and after what that measures the turn rate that a gyro does.

    `noise` scales the standard deviations of the description. The gyro is not on the bus of the
    actuators, so not late.
    """

    def __init__(
        self,
        simulation: Simulation,
        gyro: Gyro,
        batch: tuple[int, ...] = (),
        *,
        seed: int | None = 0,
        noise: float = 0.0,
    ) -> None:
        super().__init__(simulation)
        # Dice of its own: a robot has the same errors with a gyro as without.
        random = np.random.default_rng(None if seed is None else [seed, 2])
        self._gyro = YawGyro(gyro, random, batch, scale=noise)

    def measure(self) -> Array:
        """Return what the other simulation measures, and the turn rate, rad/s, (..., n + 1)."""
        rate = self._gyro.measure(self.twist()[..., 2])
        return np.concatenate([self.simulation.measure(), rate[..., None]], axis=-1)
