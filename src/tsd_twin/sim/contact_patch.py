"""Friction of wheels that spin on the spot they roll on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsd_twin.lie import Array

_SPIN_IN_SLIP = 8.0 / (3.0 * np.pi)
"""How much the speed of the rim counts beside the slip, for the force."""
_SLIP_IN_SPIN = 15.0 * np.pi / 16.0
"""How much the slip counts beside the speed of the rim, for the torque."""
_MEAN_LEVER = 3.0 * np.pi / 16.0
"""Lever of the friction of a patch that only spins, in radii, under the pressure of Hertz."""
_STANDSTILL_MPS = 0.01
"""Below this a patch sticks, which it does here by sliding ever more slowly."""


@dataclass(frozen=True, slots=True)
class ContactPatch:
    """Coulomb friction of a small round patch that slides and spins at once.

    A wheel with an upright axle turns its contact patch on the floor like a drill. Friction opposes
    the speed of each point of the patch, so most of it is spent on the spin and the rest obeys the
    sliding like oil: the force is proportional to a small slip. Source: Contensou (1963) for the
    effect, Zhuravlev, "The model of dry friction in the problem of the rolling of rigid bodies"
    (1998) for the coefficients, under the pressure of Hertz. His two speeds are added as squares
    here, which comes closer to the sum over the patch than adding them.
    """

    friction: float = 0.8
    """Coefficient: rubber, or a printed wheel, on a dry hard floor."""
    radius_m: float = 0.0005
    """By Hertz: 10 N on a sphere of 40 mm of hard plastic (2 GPa). Rubber makes it several mm."""

    def force(self, load: Array, slip: Array, spin: Array) -> tuple[Array, Array]:
        """Return force (k, 2), newtons, and torque about the normal (k,), newton metres.

        `load` (k,) are normal forces, `slip` (k, 2) velocities of the wheels' material over the
        floor, metres a second, and `spin` (k,) their turning about the normal, rad/s.
        """
        rim = self.radius_m * spin
        slip2 = slip[:, 0] ** 2 + slip[:, 1] ** 2 + _STANDSTILL_MPS**2
        most = self.friction * load
        force = -(most / np.sqrt(slip2 + (_SPIN_IN_SLIP * rim) ** 2))[:, None] * slip
        lever_m = _MEAN_LEVER * self.radius_m
        return force, -most * lever_m * rim / np.sqrt(rim**2 + _SLIP_IN_SPIN**2 * slip2)
