"""What a page says to the gateway."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

import msgspec
from msgspec import Meta

from tsd_twin.dashboard.protocol.message import Count, Message
from tsd_twin.errors import MessageError
from tsd_twin.messages.service import Operator, ShortText

Coordinate: TypeAlias = Annotated[float, Meta(ge=-1e4, le=1e4)]
"""A number of which nothing overflows: metres, radians, or shares of a picture."""
Level: TypeAlias = Annotated[int, Meta(ge=1, le=100)]
"""Percent of the limits in force."""
MOST_POINTS = 256
"""Of a line that is drawn."""


class Drive(Message, frozen=True, tag="drive"):
    """Move like this: m/s and rad/s in `frame`; of a ball wx, wy and wz, rad/s, in their place."""

    vx: float
    vy: float
    omega: float
    seen: Count
    frame: Literal["base_link", "odom"] = "base_link"


class Plan(Message, frozen=True, tag="plan"):
    """Plan a way to a place on the floor, or along a line that was drawn on it."""

    kind: Literal["to", "draw"]
    points: Annotated[
        list[tuple[Coordinate, Coordinate]], Meta(min_length=1, max_length=MOST_POINTS)
    ]
    """Of `to` the place, and then one that shall be looked at on arrival; of `draw` all."""
    on: Literal["floor", "picture"]
    """Metres in `odom`, or shares of the picture, right and down from its upper left corner."""
    heading: Coordinate | None = None
    """Where to look on arrival, radians in `odom`; null keeps the heading."""
    level: Level = 100


class Pace(Message, frozen=True, tag="pace"):
    """Go at this speed level from now on."""

    level: Level


class Unplan(Message, frozen=True, tag="unplan"):
    """Forget the way."""


class Go(Message, frozen=True, tag="go"):
    """Move along the planned way, like `drive` for as long as it is said."""

    route: Count
    """Number of the way, which is another one after each planning."""
    seen: Count


class Release(Message, frozen=True, tag="release"):
    """All controls have been let go."""


class PanelReleased(Message, frozen=True, tag="panel_released"):
    """The sliders of the panel have been let go: they shall spring back."""


class Beat(Message, frozen=True, tag="beat"):
    """The page lives; `sent_ms` is on its own clock and comes back."""

    seen: Count
    sent_ms: float
    focus: bool = True


class AskLease(Message, frozen=True, tag="lease"):
    """Take or give up control, ask its holder for it, or answer who asks."""

    op: Literal["acquire", "release", "request", "withdraw", "grant", "keep"]
    take_over: bool = False
    reason: ShortText = ""
    """Why it is taken over."""
    asker: Operator | None = None
    """Who is answered, by grant and keep."""
    max_age_s: Annotated[float, Meta(gt=0.0, le=10.0)] | None = None


class Arm(Message, frozen=True, tag="arm"):
    """Spin up."""


class Disarm(Message, frozen=True, tag="disarm"):
    """Spin down."""


class Reset(Message, frozen=True, tag="reset"):
    """End a latched stop."""


class ChooseSpeed(Message, frozen=True, tag="speed"):
    """Spin wheels that always spin at another speed."""

    cruise_speed_rpm: float


class Stop(Message, frozen=True, tag="stop"):
    """Stop and latch."""


class Choose(Message, frozen=True, tag="robot"):
    """Watch another robot."""

    id: Annotated[str, Meta(max_length=32)]


FromPage: TypeAlias = (
    Drive
    | Plan
    | Pace
    | Unplan
    | Go
    | Release
    | PanelReleased
    | Beat
    | AskLease
    | Arm
    | Disarm
    | Reset
    | ChooseSpeed
    | Stop
    | Choose
)
_DECODER = msgspec.json.Decoder(FromPage)


def decode(text: str | bytes) -> FromPage:
    """Return the message in a text frame.

    Raises:
        MessageError: `shape`, when it is none of the above.
    """
    try:
        return _DECODER.decode(text)
    # Text that is not UTF-8 and thousands of brackets are not among the errors of msgspec.
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise MessageError("shape", str(error)) from error
