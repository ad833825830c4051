"""Picking: points of floor or sphere at a screen position or click ray; robots off the screen."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import viser

from tsd_twin.dashboard.scene.robot_geometry import RobotShape
from tsd_twin.lie import SO3, Array

MAX_DISTANCE_M = 60.0
"""Limit close to the horizon, where a pixel covers metres."""


def floor_points(
    position: Array, wxyz: Array, view_rad: float, aspect: float, shares: Array
) -> Array:
    """Return the floor points (m, 2) of the scene at screen positions of a camera.

    The result ends before the first position without floor or beyond `MAX_DISTANCE_M`.

    Args:
        position: (3,): position of the camera in the scene.
        wxyz: (4,): its orientation; z ahead, x right, y down (OpenCV convention).
        view_rad: Vertical field of view.
        aspect: Width divided by height.
        shares: (n, 2): fractions of width and height from the upper left corner.
    """
    if not np.isfinite([*position, *wxyz, view_rad, aspect]).all():
        return np.empty((0, 2))  # Clients may send invalid cameras.
    half = math.tan(0.5 * view_rad)
    ahead = np.stack(
        [
            (2.0 * shares[:, 0] - 1.0) * half * aspect,
            (2.0 * shares[:, 1] - 1.0) * half,
            np.ones(len(shares)),
        ],
        axis=-1,
    )
    rays = SO3(wxyz).rotate(ahead)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        times = -position[2] / rays[:, 2]
        met = position[:2] + times[:, None] * rays[:, :2]
        away = np.hypot(*(met - position[:2]).T)
    good = (times > 0.0) & (away < MAX_DISTANCE_M)
    count = len(good) if good.all() else int(np.argmin(good))
    return met[:count]


def off_screen_direction(
    position: Array, wxyz: Array, view_rad: float, aspect: float, point: Array
) -> float | None:
    """Return where a point (3,) outside the picture lies, rad from right to up; None if inside.

    The camera is given as in `floor_points`.
    """
    if not np.isfinite([*position, *wxyz, view_rad, aspect]).all():
        return None  # Clients may send invalid cameras.
    right, down, ahead = (float(each) for each in SO3(wxyz).inverse().rotate(point - position))
    half = math.tan(0.5 * view_rad) * ahead
    if ahead > 0.0 and abs(down) <= half and abs(right) <= half * aspect:
        return None
    return math.atan2(-down, right)


OnClick: TypeAlias = Callable[[viser.ClientHandle, str, Array, Array], None]
"""Called on viser's thread with client, robot id, and the ray in the scene: origin, direction (3,).

Clients may send invalid rays.
"""


def add_click_target(
    scene: viser.SceneApi, name: str, shape: RobotShape, robot_id: str, on_click: OnClick
) -> None:
    """Add an invisible click target at the sphere of a robot, if it has one.

    The sphere is a batched node, and clickable batched nodes break the page in viser 1.1.1.
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


def sphere_point(
    origin: Array, direction: Array, centre: Array, radius_m: float, turn: SO3
) -> tuple[float, float, float] | None:
    """Return the unit vector, in sphere axes, to the first intersection with a ray.

    Args:
        origin: (3,): origin of the ray.
        direction: (3,): direction of the ray, any length.
        centre: (3,): centre of the sphere.
        radius_m: Radius of the sphere.
        turn: Orientation of the sphere, p_scene = R p_ball.

    Returns:
        The vector, or None if the ray is invalid or misses the sphere.
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
