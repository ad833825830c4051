"""What else a robot could have: a yaw gyro; a camera above the floor is one of the simulator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsd_twin.sim import Camera, CameraNoise, Frame

__all__ = ["Camera", "CameraNoise", "Frame", "Gyro", "GyroNoise"]


@dataclass(frozen=True, slots=True)
class GyroNoise:
    """Of a small MEMS gyro, as in the data sheet of the Bosch BMI270 (0.007 deg/s/sqrt(Hz))."""

    sigma_rad_per_s: float = 0.0012
    """Of one sample at 100 Hz."""
    bias_rad_per_s: float = 0.0005
    """Standard deviation of what is left of the offset after a second at rest."""


class Gyro:
    """Turn rates with white noise, and an offset that stays for the run."""

    def __init__(self, noise: GyroNoise, random: np.random.Generator) -> None:
        self.noise = noise
        self._random = random
        self._bias = noise.bias_rad_per_s * random.standard_normal()

    def measure(self, turn_rate: float) -> float:
        """Return the reading, rad/s, at a true `turn_rate`."""
        return turn_rate + self._bias + self.noise.sigma_rad_per_s * self._random.standard_normal()


VOLT_STEP = 0.1
"""In which an MX-64 reports the voltage of its supply (Robotis e-Manual, present voltage)."""
