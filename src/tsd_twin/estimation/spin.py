"""The speed of wheels that nobody measures."""

from __future__ import annotations

import math

import numpy as np

from tsd_twin.lie import Array
from tsd_twin.robots import SpinUp


class SpinModel:
    """Speeds of velocity joints as their motors are known to follow set-points: first order."""

    def __init__(self, spin_up: SpinUp, joints: int) -> None:
        self._spin_up = spin_up
        self.spin_rad_per_s: Array = np.zeros(joints)
        """(m,)."""

    def advance(self, setpoint_rad_per_s: Array, dt_s: float) -> Array:
        """Return the speeds (m,) after `dt_s` of a set-point (m,)."""
        self.spin_rad_per_s = self.after(setpoint_rad_per_s, dt_s)
        return self.spin_rad_per_s

    def after(self, setpoint_rad_per_s: Array, dt_s: float) -> Array:
        """Return what the speeds (m,) will be after `dt_s` of a set-point (m,)."""
        law = self._spin_up
        up, down = math.exp(-dt_s / law.up_s), math.exp(-dt_s / law.down_s)

        def one(told: float, spin: float) -> float:
            goal = told if abs(told) >= law.start_speed_rad_per_s else 0.0
            return goal + (spin - goal) * (up if abs(goal) > abs(spin) else down)

        # One by one: of a few wheels, numpy would take four times as long.
        told, spins = setpoint_rad_per_s.tolist(), self.spin_rad_per_s.tolist()
        return np.array([one(*pair) for pair in zip(told, spins, strict=True)])
