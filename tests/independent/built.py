"""Machines as built: deviations of each robot of a batch from its description.

All draws use the standard deviations declared in a description; arguments add deviations that a
description may or may not declare. No code of the project's simulation is used.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass(frozen=True, slots=True)
class Undeclared:
    """Undeclared deviations of fixed size for a batch, with random signs or directions."""

    gyro_scale: float = 0.0
    mount_deg: float = 0.0
    """Standard deviation of the mounting angle of modules or wheels."""
    radius_share: float = 0.0
    """Standard deviation of each wheel's radius."""
    place_m: float = 0.0
    """Standard deviation of each coordinate of each wheel."""
    slope_deg: float = 0.0
    friction: float | None = None
    """Friction of the floor instead of the described one."""
    patch_m: float | None = None
    spin_share: float = 0.0
    """Common relative error of all wheel speeds."""
    edges: bool = False
    """Wheels rest on the edges of their printed layers."""


@dataclass(frozen=True, slots=True, eq=False)
class Gyro:
    """Yaw gyro of each robot (n,), rad/s."""

    scale: np.ndarray
    bias: np.ndarray
    noise: float
    random: np.random.Generator = field(repr=False)

    def read(self, rate: np.ndarray) -> np.ndarray:
        return self.scale * rate + self.bias + self.noise * self.random.standard_normal(len(rate))


def gyro_of(table: Any, robots: int, seed: int, undeclared: Undeclared) -> Gyro | None:
    """Gyro with the errors of a `[gyro]`, from its own generator."""
    if table is None:
        return None
    random = np.random.default_rng([seed, 11])
    bias = table.bias_rad_per_s * random.standard_normal(robots)
    scale = getattr(table, "scale_share", 0.0) * random.standard_normal(robots)
    signs = random.choice([-1.0, 1.0], robots)
    return Gyro(1.0 + scale + signs * undeclared.gyro_scale, bias, table.noise_rad_per_s, random)


def built(table: Any, errors: float, undeclared: Undeclared) -> tuple[float, float, float]:
    """Standard deviations of positions (m) and mounting angles (rad), and the slope (degrees)."""
    return (
        float(np.hypot(errors * table.place_m, undeclared.place_m)),
        float(np.radians(np.hypot(errors * table.mount_deg, undeclared.mount_deg))),
        errors * table.slope_deg + undeclared.slope_deg,
    )


def slope_of(robots: int, seed: int, slope_deg: float) -> np.ndarray:
    """Downhill acceleration (n, 2) on floors that slope in random directions."""
    angles = np.random.default_rng([seed, 12]).uniform(0.0, 2.0 * np.pi, robots)
    along = 9.81 * np.sin(np.radians(slope_deg))
    return along * np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def loads(places_m: np.ndarray, weight_n: float, tipping_nm: np.ndarray) -> np.ndarray:
    """Load (n, k) of wheels at (k, 2) from the balance of forces and of tipping moments (n, 2)."""
    balance = np.vstack([np.ones(len(places_m)), places_m.T])
    moments = np.column_stack([np.full(len(tipping_nm), weight_n), -tipping_nm])
    return np.maximum(moments @ np.linalg.pinv(balance).T, 0.0)
