"""Dead wheels and a rate gyro: what they measure of a motion."""

from __future__ import annotations

import math

import numpy as np

from tsd_twin.lie import Array
from tsd_twin.robots.omni import DeadWheels


class DeadWheelSensors:
    """Two wheels that are not driven, so do not slip, and a gyro; arrays have a batch in front."""

    def __init__(
        self, sensors: DeadWheels, batch: tuple[int, ...], random: np.random.Generator, noise: float
    ) -> None:
        self._rows = np.array(sensors.rows()) / sensors.radius_m
        self._step_rad = 2.0 * math.pi / sensors.pulses_per_turn
        self._range = math.radians(sensors.gyro_range_deg_per_s)
        drift = noise * math.radians(sensors.gyro_drift_deg_per_h) / 3600.0
        self._drift = drift * random.standard_normal(batch)
        self._angles = np.zeros((*batch, 2))

    def advance(self, twist: Array, dt_s: float) -> None:
        """Let the wheels roll with the body for `dt_s` at a mean `twist` (..., 3)."""
        self._angles = self._angles + dt_s * (twist @ self._rows.T)

    def measure(self, twist: Array) -> Array:
        """Return both angles in whole pulses, radians, and the rate, rad/s, (..., 3)."""
        pulses = np.floor(self._angles / self._step_rad) * self._step_rad
        rate = np.clip(twist[..., 2] + self._drift, -self._range, self._range)
        return np.concatenate([pulses, rate[..., None]], axis=-1)
