"""What a page is told besides: who it is, what became of its buttons, and what has happened."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import msgspec

from tsd_twin.access import Role
from tsd_twin.dashboard.protocol.message import Message, Triple
from tsd_twin.messages.service import Event


class RobotName(msgspec.Struct, frozen=True):
    """A line of the robot menu."""

    id: str
    title: str


class Welcome(Message, frozen=True, tag="welcome"):
    """Who the page is, and which robots there are."""

    operator: str
    role: Role
    user: str | None
    """Who has logged in; None where nobody has to."""
    may_stop: bool
    robots: Sequence[RobotName]
    robot: str | None


class Panel(Message, frozen=True, tag="panel"):
    """Where the sliders of the viser panel are."""

    vx: float
    vy: float
    omega: float
    mode: Literal["preview", "drive"]
    latch: bool


class Point(Message, frozen=True, tag="point"):
    """A point of a ball was clicked on in the page: it wants to be brought up."""

    robot: str
    at: Triple
    """Unit vector to it, along the axes that are painted on the ball."""


class Released(Message, frozen=True, tag="released"):
    """The gateway has let go on behalf of the page; controls must be centred first."""

    reason: str


class Answer(Message, frozen=True, tag="reply"):
    """What became of a button."""

    to: str
    ok: bool
    reason: str = ""


class Happened(Message, frozen=True, tag="event"):
    """Something happened to the robot."""

    kind: str
    text: str
    robot_s: float
    past: bool = False
    """It happened before the page looked."""

    @classmethod
    def of(cls, event: Event, *, past: bool = False) -> Happened:
        """Return the part of an event that is shown."""
        return cls(kind=event.kind, text=event.text, robot_s=round(event.robot_s, 3), past=past)


class Echo(Message, frozen=True, tag="beat"):
    """Answer to a beat."""

    sent_ms: float
