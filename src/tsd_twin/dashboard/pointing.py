"""From a click on a ball to the point of it that was meant."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import viser

from tsd_twin.dashboard.shape import Shape
from tsd_twin.lie import SO3, Array

OnClick: TypeAlias = Callable[[viser.ClientHandle, str, Array, Array], None]
"""Called on viser's thread with client, robot id, and the ray in the scene: origin, direction (3,).

A client may send any ray."""


def add_target(
    scene: viser.SceneApi, name: str, shape: Shape, robot_id: str, on_click: OnClick
) -> None:
    """Add what is clicked on where a robot has its ball, if it has one: it cannot be seen.

    The ball itself is a batched node, and those break the page of viser 1.1.1 when they can be
    clicked on.
    """
    if shape.ball_radius_m is None:
        return
    target = scene.add_icosphere(
        name,
        1.002 * shape.ball_radius_m,
        opacity=0.0,
        cast_shadow=False,
        receive_shadow=False,
        position=(0.0, 0.0, shape.skeleton.tree.height_m),
    )

    async def clicked(event: viser.SceneNodePointerEvent[Any]) -> None:
        ray = np.array(event.ray_origin), np.array(event.ray_direction)
        on_click(event.client, robot_id, *ray)

    target.on_click(clicked)


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
