"""Reachable twists of a drive: the largest twist in a direction, and outlines of the whole set.

The set of twists within the joint limits is convex and symmetric about zero, and
`joint_utilization` is its gauge: 1 on its boundary, and twice as much at twice the twist. For
wheels with a speed limit it is a polytope, for gimbals an intersection of elliptic cylinders.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tsd_twin.kinematics.base import Kinematics
from tsd_twin.lie import Array

_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_STEPS = 64
"""Steps of the golden-section search: the last interval is 1e-13 of the first."""


def largest_twist(kinematics: Kinematics[Any], direction: Array) -> Array:
    """Largest twist (..., 3) along `direction` (..., 3), not zero, within the joint limits."""
    return direction / kinematics.joint_utilization(direction)[..., None]


def section(kinematics: Kinematics[Any], axes: tuple[int, int], points: int) -> Array:
    """Boundary (points, 2) of the reachable twists whose third component is zero."""
    return largest_twist(kinematics, _directions(kinematics, axes, points))[:, axes]


def shadow(kinematics: Kinematics[Any], axes: tuple[int, int], points: int) -> Array:
    """Boundary (points, 2) of the projection of all reachable twists onto two components.

    The third component is free: where it helps, the projection is wider than the section.
    """
    towards = _directions(kinematics, axes, points)
    return largest_projection(kinematics, towards, 3 - sum(axes))[:, axes]


def largest_projection(kinematics: Kinematics[Any], towards: Array, free: int) -> Array:
    """Largest twists (n, 3) along `towards` (n, 3), whose component `free` is zero and may change.

    The least demand over that component, which is convex in it, by a golden-section search.
    """
    axis = np.eye(3)[free]

    def demand(s: Array) -> Array:
        return kinematics.joint_utilization(towards + s[:, None] * axis)

    # u(d + s e) >= |s| u(e) - u(d), so the least one is where |s| <= 2 u(d) / u(e).
    alone = kinematics.joint_utilization(towards)
    high = 2.0 * alone / kinematics.joint_utilization(axis)
    low = -high
    for _ in range(_STEPS):
        left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        is_left = demand(left) < demand(right)
        low, high = np.where(is_left, low, left), np.where(is_left, right, high)
    return towards / np.minimum(demand(0.5 * (low + high)), alone)[:, None]


def _directions(kinematics: Kinematics[Any], axes: tuple[int, int], points: int) -> Array:
    """Directions (points, 3) in a plane, evenly around once both axes are scaled to their tops."""
    angles = np.linspace(0.0, 2.0 * np.pi, points, endpoint=False)
    directions = np.zeros((points, 3))
    directions[:, axes[0]], directions[:, axes[1]] = np.cos(angles), np.sin(angles)
    return directions / kinematics.joint_utilization(np.eye(3))
