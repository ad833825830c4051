"""A yaw gyro on a simulated robot, whatever plant moves it."""

from __future__ import annotations

import numpy as np

from tsd_twin.lie import Array
from tsd_twin.robots import Gyro
from tsd_twin.sim.around import Around
from tsd_twin.sim.simulation import Simulation


class GyroSimulation(Around[Simulation]):
    """Another simulation, and after what that measures the turn rate that a gyro does.

    `noise` scales the standard deviations of the description. Each reading is noisy; the bias is
    drawn from the seed, once for a run. The gyro is not on the bus of the actuators, so not late.
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
        self._random = np.random.default_rng(None if seed is None else [seed, 2])
        self._bias = noise * gyro.bias_rad_per_s * self._random.standard_normal(batch)
        self._sigma = noise * gyro.noise_rad_per_s
        self._batch = batch

    def measure(self) -> Array:
        """Return what the other simulation measures, and the turn rate, rad/s, (..., n + 1)."""
        rate = self.twist()[..., 2] + self._bias
        rate = rate + self._sigma * self._random.standard_normal(self._batch)
        return np.concatenate([self.simulation.measure(), rate[..., None]], axis=-1)
