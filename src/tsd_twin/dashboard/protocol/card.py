"""What a page is told once about each robot: that which does not change."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import msgspec

from tsd_twin.dashboard.protocol.message import Message


class Limits(msgspec.Struct, frozen=True):
    """What the description allows."""

    speed_mps: float
    turn_rate_rad_per_s: float


class Number(msgspec.Struct, frozen=True):
    """What one of the three numbers of a twist is."""

    name: str
    symbol: str
    unit: str


class Gears(msgspec.Struct, frozen=True):
    """How fast wheels that always spin may do so, and what follows from it."""

    least_rpm: int
    most_rpm: int
    usual_rpm: int
    """That of the description."""
    wheel_radius_m: float
    servo_step_deg: float


class Card(Message, frozen=True, tag="robot"):
    """What does not change about a robot."""

    id: str
    title: str
    limits: Limits
    levels: Sequence[int]
    space: Literal["floor", "ball"]
    """What moves: the robot over a floor, or a ball that it turns in place."""
    numbers: Sequence[Number]
    """Of `drive`, `twist` and `commanded`, in this order."""
    lever_m: float
    """Metres a second that one unit of the first two numbers is; limits of speed are in m/s."""
    panel: Literal["gimbals", "wheels", "sphere"]
    """What there is to see of its actuators."""
    max_tilt_deg: float | None = None
    modules: Sequence[str] = ()
    """Names of the gimbals."""
    gears: Gears | None = None
    """Of robots on gimbals."""
    wheels: Sequence[str] = ()
    """Names of the wheels that roll."""
    max_rpm: float | None = None
    """Of those wheels."""
    other: str | None = None
    """What its other estimate is made by, of robots that have two."""
