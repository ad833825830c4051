"""Lie groups as matrices, computed from their definitions."""

from __future__ import annotations

import numpy as np

from tsd_twin.lie import SE2, SO3, Array


def expm1(matrix: Array) -> Array:
    """Return exp(matrix) − 1 by scaling, Taylor series and squaring."""
    small = matrix / 2.0**10
    term, total = small, small.copy()
    for n in range(2, 12):
        term = term @ small / n
        total = total + term
    for _ in range(10):
        total = 2.0 * total + total @ total
    return total


def se2_hat(t: Array) -> Array:
    return np.array([[0.0, -t[2], t[0]], [t[2], 0.0, t[1]], [0.0, 0.0, 0.0]])


def so3_hat(t: Array) -> Array:
    return np.array([[0.0, -t[2], t[1]], [t[2], 0.0, -t[0]], [-t[1], t[0], 0.0]])


def se2_matrix(pose: SE2) -> Array:
    x, y, heading = pose.xy_heading
    c, s = np.cos(heading), np.sin(heading)
    return np.array([[c, -s, x], [s, c, y], [0.0, 0.0, 1.0]])


def so3_matrix(rotation: SO3) -> Array:
    """Return the rotation matrix (3, 3) of a unit quaternion, entry by entry."""
    w, x, y, z = rotation.wxyz
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
