"""Compliance of joints: by how much those of a healthy robot differ from where they should be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsd_twin.lie import Array


@dataclass(frozen=True, slots=True, eq=False)
class JointCompliance:
    """Deviations of position joints that are measured, and no fault.

    Joints give way to forces at their contacts. A contact that slides has a force in proportion to
    its slip, as long as that is small.
    """

    by_acceleration: Array
    """(n, 3): deviation for an acceleration over the ground, rad for m/s^2 and rad/s^2."""
    by_force: Array
    """(n, m): deviation for the force of the floor along each number of the residual, rad/N."""
    friction_n: float
    """Friction of a sliding contact."""
    spin_to_slip_m: float
    """Slip over the wheel speed at which the force is 71 % of the friction."""
    lag_s: float
    """Time constant with which joints follow their set-points."""
    play_rad: float
    """Total backlash: a joint that reverses is behind by up to this, and by no more than its
    lag."""
    dead_band_rad: float
    """Largest error that a joint at rest may keep."""

    def by_slip(self, spin_rad_per_s: float) -> Array:
        """Return the deviation (n, m) for the slip of each contact, rad for m/s."""
        slip_mps = self.spin_to_slip_m * abs(spin_rad_per_s)
        if slip_mps <= 0.0:
            return np.zeros_like(self.by_force)
        return self.friction_n / slip_mps * self.by_force
