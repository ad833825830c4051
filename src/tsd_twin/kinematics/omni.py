"""Kinematics of platforms on wheels with rollers: omni wheels, Killough's three, Mecanum.

Source: Savnani et al. 2019, Eq. 4 for one wheel and Eq. 8 to 11 for four of them. One class does
any number of wheels with any roller angle; `docs/kinematics.md` has symbols and a drawing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from tsd_twin.kinematics.base import PlanarMotion, WheelKinematics
from tsd_twin.lie import Array

_SINGULAR = 1e-3
"""Smallest ratio of singular values of a layout; below this a motion counts as impossible."""


@dataclass(frozen=True, slots=True, eq=False)
class OmniKinematics(PlanarMotion, WheelKinematics):
    """Kinematics of three or more driven wheels with rollers.

    A wheel turns forward towards its `direction`. The axle of the roller on the floor lies in that
    direction, turned by the `roller` angle about Z: 0 for an omni wheel, 45 degrees for Mecanum.
    Along its axle a roller holds the floor, across it rolls freely. In the symbols of the paper the
    direction is `lambda + alpha - 90 degrees` and the roller angle `psi`. The joint vector holds
    the speeds of the wheels.
    """

    positions_m: Array
    """(k, 2): positions of the wheels in the robot frame, X forward and Y left."""
    directions_rad: Array
    """(k,): driving direction of each wheel, from X towards Y."""
    rollers_rad: Array
    """(k,): axle of the roller on the floor, relative to the direction of the wheel."""
    grip_from_twist: Array = field(init=False)
    """(k, 3): velocity of each wheel over the ground along the axle of its roller."""

    def __post_init__(self) -> None:
        """Build the matrices.

        Raises:
            ValueError: the wheels cannot move the robot in every way, or one has no grip forward.
        """
        problem = layout_problem(self.positions_m, self.directions_rad, self.rollers_rad)
        if problem:
            raise ValueError(problem)
        grip = _grip(self.positions_m, self.directions_rad, self.rollers_rad)
        # Eq. 4 divided by r cos psi.
        rows = grip / (self.wheel_radius_m * np.cos(self.rollers_rad))[:, None]
        self._set_wheel_matrices(rows, grip_from_twist=grip)


def layout_problem(positions_m: Array, directions_rad: Array, rollers_rad: Array) -> str:
    """Text that names the missing motion or the faulty wheel of a layout; "" if valid.

    An omnidirectional platform needs a matrix of full rank: a twist that turns no wheel can neither
    be driven nor held.
    """
    weak = np.flatnonzero(np.abs(np.cos(rollers_rad)) < 0.1)
    if len(weak):
        return f"the rollers of wheel {weak[0] + 1} roll where it drives to: it has no grip forward"
    if len(directions_rad) < 3:
        return f"{len(directions_rad)} wheels cannot move a robot in all three ways"
    rows = _grip(positions_m, directions_rad, rollers_rad)
    reach_m = max(float(np.hypot(*positions_m.T).max()), 1e-9)
    _, strengths, motions = np.linalg.svd(rows / [1.0, 1.0, reach_m])
    if strengths[-1] > _SINGULAR * strengths[0]:
        return ""
    vx, vy, omega = motions[-1] / [1.0, 1.0, reach_m]
    if abs(omega) * reach_m < 1e-3:
        return f"no wheel can push the robot towards {math.degrees(math.atan2(vy, vx)):.0f} degrees"
    x, y = (round(float(v), 6) + 0.0 for v in (-vy / omega, vx / omega))
    return f"no wheel can turn the robot about the point x = {x:.3g} m, y = {y:.3g} m"


def _grip(positions_m: Array, directions_rad: Array, rollers_rad: Array) -> Array:
    """Velocities (k, 3) over the ground along the rollers' axles, from the twist.

    Eq. 4, left side: the axle of the roller is at lambda + alpha + psi - 90 degrees, and
    -l cos(alpha + psi) is what turning moves the wheel along it.
    """
    c, s = np.cos(directions_rad + rollers_rad), np.sin(directions_rad + rollers_rad)
    x, y = positions_m[:, 0], positions_m[:, 1]
    return np.stack([c, s, s * x - c * y], axis=-1)
