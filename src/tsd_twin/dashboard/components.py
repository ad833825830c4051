"""What the three numbers of a robot's twist are called, and how far each may go."""

from __future__ import annotations

from typing import Any, NamedTuple

from tsd_twin.drives import Drive
from tsd_twin.robots.robot import Limits


class Component(NamedTuple):
    """One number of a twist."""

    name: str
    symbol: str
    unit: str
    hint: str

    @property
    def label(self) -> str:
        """What stands beside its slider."""
        return f"{self.name} ({self.unit})"


FLOOR = (
    Component("vx", "vx", "m/s", "Forward is positive"),
    Component("vy", "vy", "m/s", "Left is positive"),
    Component("omega", "ω", "rad/s", "Turning left is positive"),
)
"""Of a robot that drives over a floor."""
_BALL = (
    Component("wx", "ωx", "rad/s", "Positive rolls the top of the sphere to the right"),
    Component("wy", "ωy", "rad/s", "Positive rolls the top of the sphere forward"),
    Component("wz", "ωz", "rad/s", "Positive turns the sphere left"),
)
_COMPONENTS = {(0, 1, 5): FLOOR, (3, 4, 5): _BALL}
"""By where they stand in a spatial twist."""


def components(drive: Drive[Any]) -> tuple[Component, Component, Component]:
    """Return the names of the numbers of a twist, in its order."""
    return _COMPONENTS[drive.components]


def ends(drive: Drive[Any], limits: Limits) -> tuple[float, float, float]:
    """Return the most that each number of a twist may be, in its unit."""
    most = limits.speed_mps / drive.lever_m
    return most, most, limits.turn_rate_rad_per_s
