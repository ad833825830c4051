"""What a page is told all the time: how its robot is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import msgspec

from tsd_twin.dashboard.protocol.message import Message, Triple
from tsd_twin.messages.status import Status


class Module(msgspec.Struct, frozen=True):
    """One gimbal; degrees."""

    alpha: float
    beta: float
    tilt: float
    radius_mm: float
    rpm: float
    set_alpha: float
    set_beta: float
    axle: tuple[float, float]
    """Where the axle leans, seen from above in `base_link`; length 1 is the tilt limit."""
    set_axle: tuple[float, float]
    spinning: bool


class Wheel(msgspec.Struct, frozen=True):
    """One wheel that rolls."""

    rpm: float
    set_rpm: float
    residual_mps: float
    """Speed of its rim that no motion of the robot explains."""


class Ball(msgspec.Struct, frozen=True):
    """A sphere that turns in place; angular velocities in rad/s."""

    wxyz: tuple[float, float, float, float]
    """How it is turned."""
    ideal: Triple
    """Its angular velocity if each wheel touched half-way between its rows."""
    dual: Triple | None
    """And by the rows that do touch."""
    angle_deg: float | None
    """Between the two."""
    magnitude_percent: float | None
    """By how much the first is smaller."""
    rows: Sequence[int]
    """The row that each wheel stands on, 1 or 2; 0 when that cannot be told."""


class Apart(msgspec.Struct, frozen=True):
    """How far the other estimate is from the estimate."""

    metres: float
    degrees: float


class Route(msgspec.Struct, frozen=True):
    """The way that this page has planned, and how it goes."""

    number: int
    phase: Literal["planning", "planned", "going", "arrived", "ended"]
    length_m: float
    time_s: float
    """What it takes at the level that it is planned for."""
    done_m: float = 0.0
    off_mm: float = 0.0
    """Between the robot and where it should be."""
    reason: str = ""
    """Why it has ended."""


class State(Message, frozen=True, tag="state"):
    """How the robot is."""

    seen: int
    age_ms: float
    status: Status
    mode_age_s: float
    """For how long the robot has been in its mode, as far as the gateway knows."""
    you: bool
    robot_ms: float | None
    """Round trip from here to the robot, median of the last ones."""
    robot_jitter_ms: float | None
    """How much longer one in twenty of them took."""
    pose: Triple | None
    twist: Triple | None
    commanded: Triple | None
    truth: Triple | None
    modules: Sequence[Module] = ()
    wheels: Sequence[Wheel] = ()
    ball: Ball | None = None
    apart: Apart | None = None
    route: Route | None = None
