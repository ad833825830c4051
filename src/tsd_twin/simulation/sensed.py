"""Simulation with sensors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsd_twin.lie import Array
from tsd_twin.sensors import MountedSensor
from tsd_twin.sensors.base import BodyMotion
from tsd_twin.simulation.base import Simulation, SimulationWrapper


class SensedSimulation(SimulationWrapper[Simulation]):
    """Simulation wrapper that appends the readings of sensors to the measurements.

    `noise` scales the described standard deviations. The sensors are not on the actuator bus, so
    they have no delay.
    """

    def __init__(
        self,
        simulation: Simulation,
        sensors: Sequence[MountedSensor],
        batch: tuple[int, ...] = (),
        *,
        seed: int | None = 0,
        noise: float = 0.0,
    ) -> None:
        super().__init__(simulation)
        # Separate random generators keep the errors of a robot the same with and without a sensor.
        seeds = [None if seed is None else [seed, 2 + i] for i in range(len(sensors))]
        self._sensors = [
            sensor.simulate(table, batch, np.random.default_rng(own), noise)
            for (sensor, table), own in zip(sensors, seeds, strict=True)
        ]

    def advance(self, dt_s: float) -> None:
        """Advance the robots and their sensors by `dt_s` seconds."""
        self.simulation.advance(dt_s)
        motion = BodyMotion(self.simulation.pose, self.simulation.twist())
        for sensor in self._sensors:
            sensor.advance(motion, dt_s)

    def measure(self) -> Array:
        """Return the wrapped simulation's measurements and the readings, (..., n + s)."""
        readings = [sensor.read() for sensor in self._sensors]
        return np.concatenate([self.simulation.measure(), *readings], axis=-1)
