"""From places in a picture to places on the floor."""

from __future__ import annotations

import math
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tsd_twin.lie import SO3, Array

FARTHEST_M = 60.0
"""Closer to the horizon, a pixel is metres."""


@dataclass(frozen=True, slots=True, eq=False)
class Eye:
    """Where a picture is seen from."""

    position: Array
    """(3,): in the scene."""
    wxyz: Array
    """(4,): how it is turned; z is ahead, x to the right, y down, as OpenCV has it."""
    view_rad: float
    """Angle between its upper and its lower edge."""
    aspect: float
    """Width over height."""


def on_floor(eye: Eye, shares: Array) -> Array:
    """Return the places (m, 2) on the floor of the scene that a picture shows at `shares` (n, 2).

    Shares of width and height, right and down from the upper left corner. They end before the first
    that shows no floor, or one further away than anybody can point at.
    """
    numbers = [*eye.position, *eye.wxyz, eye.view_rad, eye.aspect]
    if not np.isfinite(numbers).all():
        return np.empty((0, 2))  # A client may send any camera.
    half = math.tan(0.5 * eye.view_rad)
    ahead = np.stack(
        [
            (2.0 * shares[:, 0] - 1.0) * half * eye.aspect,
            (2.0 * shares[:, 1] - 1.0) * half,
            np.ones(len(shares)),
        ],
        axis=-1,
    )
    rays = SO3(eye.wxyz).rotate(ahead)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        times = -eye.position[2] / rays[:, 2]
        met = eye.position[:2] + times[:, None] * rays[:, :2]
        away = np.hypot(*(met - eye.position[:2]).T)
    good = (times > 0.0) & (away < FARTHEST_M)
    count = len(good) if good.all() else int(np.argmin(good))
    return met[:count]


class Picture(Protocol):
    """What a page needs of the picture beside its own socket; nothing here waits."""

    def floor(self, page: str, shares: Array) -> Future[Array]:
        """Return the places (m, 2) in `odom` that the picture of a page shows, as `on_floor`."""
        ...

    def show_route(self, robot_id: str, poses: Array | None) -> None:
        """Show everybody where a robot is planned to go, poses (n, 3) in `odom`; None: nowhere."""
        ...


class NoPicture:
    """Shows nothing."""

    def floor(self, page: str, shares: Array) -> Future[Array]:  # noqa: ARG002  The shape.
        """Return no place."""
        nothing: Future[Array] = Future()
        nothing.set_result(np.empty((0, 2)))
        return nothing

    def show_route(self, robot_id: str, poses: Array | None) -> None:
        """Show nothing."""
