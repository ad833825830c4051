"""From a click on a ball to the point of it that was meant."""

from __future__ import annotations

import math

import numpy as np

from tsd_twin.lie import SO3, Array


def point_on_ball(
    origin: Array, direction: Array, centre: Array, radius_m: float, turn: SO3
) -> tuple[float, float, float] | None:
    """Return the unit vector, along the axes of the ball, to where a ray first meets it.

    Args:
        origin: (3,), of the ray.
        direction: (3,), of any length.
        centre: (3,), of the ball.
        radius_m: of the ball.
        turn: how the ball is turned, p_scene = R p_ball.

    Returns:
        None when the ray misses it, or is none.
    """
    length = float(np.linalg.norm(direction))
    if not (np.isfinite(origin).all() and math.isfinite(length) and length > 0.0):
        return None
    along, out = direction / length, origin - centre
    half = float(along @ out)
    under = half * half - float(out @ out) + radius_m * radius_m
    if not under >= 0.0:
        return None
    met = out + (-half - math.sqrt(under)) * along
    x, y, z = (float(part) for part in turn.inverse().rotate(met / radius_m))
    return x, y, z
