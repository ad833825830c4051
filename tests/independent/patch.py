"""Dry friction of a small round contact that slides and spins, as a sum over its points.

The law of Contensou (1963): Coulomb friction opposes the velocity of each point, under Hertzian
pressure. Nothing here is a fitted formula, so it checks those of the project.
"""

from __future__ import annotations

import numpy as np

RINGS, SPOKES = 4, 6
STICK_MPS = 5e-4
"""Speed below which a point sticks, modelled as viscous."""


def _points() -> tuple[np.ndarray, np.ndarray]:
    """Points (m, 2) in radii, and their shares (m,) of the load.

    The pressure is 3/2 sqrt(1 - r^2) of the mean. With r = sin(b) the load is 3 sin b cos^2 b db,
    by which also the friction per slip of a spinning patch, proportional to 1 / r, has a smooth
    integrand for Gauss-Legendre nodes.
    """
    nodes, weights = np.polynomial.legendre.leggauss(RINGS)
    angle = 0.25 * np.pi * (nodes + 1.0)
    radius = np.sin(angle)
    share = weights * radius * np.cos(angle) ** 2
    share /= share.sum()
    angles = (np.arange(SPOKES) + 0.5) * 2.0 * np.pi / SPOKES
    points = radius[:, None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return points.reshape(-1, 2), np.repeat(share / SPOKES, SPOKES)


POINTS, SHARES = _points()


def weights(
    limit_n: np.ndarray, radius_m: np.ndarray | float, slip: np.ndarray, spin: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Friction of contacts, linearized in the slip at the current point speeds.

    Args:
        limit_n: (...) friction coefficient times load.
        radius_m: Radius of the patch.
        slip: (..., 2) velocity of the wheel over the floor at the centre of the patch, m/s.
        spin: (...) angular velocity about the normal, rad/s.

    Returns:
        c (...), h (..., 2) and torque (...): the force is -c slip - h, the torque about the normal
        is the third, in N m.
    """
    arm = POINTS * np.asarray(radius_m)[..., None, None]
    turning = spin[..., None, None] * np.stack([-arm[..., 1], arm[..., 0]], axis=-1)
    speed = slip[..., None, :] + turning
    weight = SHARES / np.sqrt((speed**2).sum(axis=-1) + STICK_MPS**2) * limit_n[..., None]
    offset = (weight[..., None] * turning).sum(axis=-2)
    twist = arm[..., 0] * speed[..., 1] - arm[..., 1] * speed[..., 0]
    return weight.sum(axis=-1), offset, -(weight * twist).sum(axis=-1)
