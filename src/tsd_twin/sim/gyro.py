"""A yaw gyro on a simulated robot, whatever plant moves it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from tsd_twin.drives import Drive
from tsd_twin.lie import Array
from tsd_twin.robots import Gyro
from tsd_twin.sim.simulation import Simulation


class GyroSimulation:
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
        self.simulation = simulation
        """The one that moves the robot."""
        # Dice of its own: a robot has the same errors with a gyro as without.
        self._random = np.random.default_rng(None if seed is None else [seed, 2])
        self._bias = noise * gyro.bias_rad_per_s * self._random.standard_normal(batch)
        self._sigma = noise * gyro.noise_rad_per_s
        self._batch = batch

    @property
    def drive(self) -> Drive[Any]:
        """The kinematics that the robot is driven by."""
        return self.simulation.drive

    @property
    def pose(self) -> Any:
        """True pose in the world."""
        return self.simulation.pose

    @property
    def joints(self) -> Array:
        """(..., n): true joint vector."""
        return self.simulation.joints

    def command(self, setpoint: Array) -> None:
        """Give all actuators new set-points, as the other simulation takes them."""
        self.simulation.command(setpoint)

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` seconds pass."""
        self.simulation.advance(dt_s)

    def measure(self) -> Array:
        """Return what the other simulation measures, and the turn rate, rad/s, (..., n + 1)."""
        rate = self.twist()[..., 2] + self._bias
        rate = rate + self._sigma * self._random.standard_normal(self._batch)
        return np.concatenate([self.simulation.measure(), rate[..., None]], axis=-1)

    def twist(self) -> Array:
        """Return the true twist (..., 3) in the base frame."""
        return self.simulation.twist()

    def facts(self) -> Mapping[str, object]:
        """Return what the other simulation says."""
        return self.simulation.facts()
