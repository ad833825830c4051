"""Simulation with a gyro."""

from __future__ import annotations

import numpy as np

from tsd_twin.lie import Array
from tsd_twin.sensors.gyro import Gyro, YawGyro
from tsd_twin.simulation.base import Simulation, SimulationWrapper


class GyroSimulation(SimulationWrapper[Simulation]):
    """Simulation wrapper that appends a gyro's turn rate to the measurements.

    `noise` scales the described standard deviations. The gyro is not on the actuator bus, so it has
    no delay.
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
        # A separate random generator keeps a robot's errors the same with and without a gyro.
        random = np.random.default_rng(None if seed is None else [seed, 2])
        self._gyro = YawGyro(gyro, random, batch, scale=noise)

    def measure(self) -> Array:
        """Return the wrapped simulation's measurements and the turn rate, rad/s, (..., n + 1)."""
        rate = self._gyro.measure(self.twist()[..., 2])
        return np.concatenate([self.simulation.measure(), rate[..., None]], axis=-1)
