"""Messages from the page to the dashboard server, as `docs/teleop.md` specifies them."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

import msgspec
from msgspec import Meta

from tsd_twin.dashboard.scene.appearance import ViewSettings
from tsd_twin.errors import MessageError
from tsd_twin.messages.requests import Operator, ShortText
from tsd_twin.recording.events import NOTE_LENGTH
from tsd_twin.recording.player import LEAST_SPEED, MOST_SPEED

Count: TypeAlias = Annotated[int, Meta(ge=0, le=2**53)]
"""A number that a browser can hold exactly."""
Triple: TypeAlias = tuple[float, float, float]
Coordinate: TypeAlias = Annotated[float, Meta(ge=-1e4, le=1e4)]
"""A number of which nothing overflows: metres, radians, or shares of a picture."""
Level: TypeAlias = Annotated[int, Meta(ge=1, le=100)]
"""Percent of the limits in force."""
MAX_POINTS = 256
"""Of a line that is drawn."""
MAX_PLOT_FIELDS, MAX_FIELD_NAME = 16, 100


class Message(msgspec.Struct, frozen=True, tag_field="t", kw_only=True):
    """Base class of messages: a JSON object with its type in `t`."""


class DriveCommand(Message, frozen=True, tag="drive"):
    """Drive command: twist in m/s and rad/s in `frame`; of a sphere wx, wy and wz, rad/s."""

    vx: float
    vy: float
    omega: float
    seen: Count
    frame: Literal["base_link", "odom"] = "base_link"


class PlanRequest(Message, frozen=True, tag="plan"):
    """Request to plan a path to a point on the floor, or along a drawn line."""

    kind: Literal["to", "draw"]
    points: Annotated[
        list[tuple[Coordinate, Coordinate]], Meta(min_length=1, max_length=MAX_POINTS)
    ]
    """Of `to` the place, and then one that shall be looked at on arrival; of `draw` all."""
    on: Literal["floor", "picture"]
    """Metres in `odom`, or shares of the picture, right and down from its upper left corner."""
    heading: Coordinate | None = None
    """Heading on arrival, radians in `odom`; null keeps the present one."""
    level: Level = 100


class SetSpeedLevel(Message, frozen=True, tag="speed_level"):
    """Set the speed level."""

    level: Level


class ClearPlan(Message, frozen=True, tag="clear_plan"):
    """Clear the path."""


class FollowPlan(Message, frozen=True, tag="follow_plan"):
    """Command to follow the planned path; like `drive`, it must be repeated."""

    route: Count
    """Number of the way, which is another one after each planning."""
    seen: Count


class ReleaseControls(Message, frozen=True, tag="release"):
    """All controls have been released."""


class PanelSlidersReleased(Message, frozen=True, tag="panel_released"):
    """The sliders of the panel have been released: reset them."""


class PageHeartbeat(Message, frozen=True, tag="heartbeat"):
    """Heartbeat of the page; `sent_ms` on the page's clock is returned."""

    seen: Count
    sent_ms: float
    focus: bool = True


class LeaseAction(Message, frozen=True, tag="lease"):
    """Lease request: acquire, release, request from the holder, or answer a request."""

    op: Literal["acquire", "release", "request", "withdraw", "grant", "deny"]
    take_over: bool = False
    reason: ShortText = ""
    """Why it is taken over."""
    asker: Operator | None = None
    """Requesting operator, for grant and deny."""
    max_age_s: Annotated[float, Meta(gt=0.0, le=10.0)] | None = None


class ArmRequest(Message, frozen=True, tag="arm"):
    """Request to arm."""


class DisarmRequest(Message, frozen=True, tag="disarm"):
    """Request to disarm."""


class ResetRequest(Message, frozen=True, tag="reset"):
    """Request to reset a latched stop or fault."""


class SetWheelSpeed(Message, frozen=True, tag="wheel_speed"):
    """Request of another speed for wheels that always spin."""

    cruise_speed_rpm: float


class StopCommand(Message, frozen=True, tag="stop"):
    """Software stop, latched."""


class SelectRobot(Message, frozen=True, tag="robot"):
    """Request to select another robot."""

    id: Annotated[str, Meta(max_length=32)]


class SelectPlotFields(Message, frozen=True, tag="plot_fields"):
    """Request of values for the plots of this page, with every state of the selected robot."""

    names: Annotated[
        list[Annotated[str, Meta(max_length=MAX_FIELD_NAME)]], Meta(max_length=MAX_PLOT_FIELDS)
    ]
    """Of `RobotInfo.plot_fields`; unknown names are ignored."""


class SetView(Message, frozen=True, tag="view"):
    """Apply view settings: those that the browser has kept, or a key or a preset of the page."""

    settings: ViewSettings
    look: bool = False
    """Whether the camera turns to the robot even if its preset stays."""


class ShowMap(Message, frozen=True, tag="map"):
    """Request of what the map shows, with every state while it is `on`."""

    on: bool


LOOK_BACK_S = 30.0
"""Time for which the past of a robot is kept."""


class LookBack(Message, frozen=True, tag="look_back"):
    """Request to draw the robot as it was some seconds ago beside the live one; null ends it."""

    ago_s: Annotated[float, Meta(ge=0.1, le=LOOK_BACK_S)] | None


class ShowShadow(Message, frozen=True, tag="shadow"):
    """Request of the comparison with the shadow twin, with every state while it is `on`."""

    on: bool


class StudentRequest(Message, frozen=True, tag="student"):
    """Request of the figures of a shipped robot with some knobs turned; it concerns no robot."""

    number: Count
    """Returned with the answer."""
    base: Annotated[str, Meta(max_length=32)]
    knobs: Annotated[dict[Annotated[str, Meta(max_length=64)], float], Meta(max_length=64)]
    """Changed numbers of the description, by their keys."""
    twist: Triple = (0.0, 0.0, 0.0)
    """Twist that the joints are computed for."""
    toml: bool = False
    """Whether the answer shall have the description as a file."""


PageMessage: TypeAlias = (
    DriveCommand
    | PlanRequest
    | SetSpeedLevel
    | ClearPlan
    | FollowPlan
    | ReleaseControls
    | PanelSlidersReleased
    | PageHeartbeat
    | LeaseAction
    | ArmRequest
    | DisarmRequest
    | ResetRequest
    | SetWheelSpeed
    | StopCommand
    | SelectRobot
    | SelectPlotFields
    | SetView
    | ShowMap
    | LookBack
    | ShowShadow
    | StudentRequest
)
_DECODER = msgspec.json.Decoder(PageMessage)


def decode_page_message(text: str | bytes) -> PageMessage:
    """Return the message in a text frame.

    Raises:
        MessageError: `shape`, when it is none of the above.
    """
    try:
        return _DECODER.decode(text)
    # Text that is not UTF-8 and thousands of brackets are not among the errors of msgspec.
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise MessageError("shape", str(error)) from error


# From a page that shows a recording.


class Seek(Message, frozen=True, tag="seek"):
    """Request to show a time."""

    t_s: Annotated[float, Meta(ge=0.0, le=1e6)]


class Play(Message, frozen=True, tag="play"):
    """Request to play."""

    speed: Annotated[float, Meta(ge=LEAST_SPEED, le=MOST_SPEED)]


class Pause(Message, frozen=True, tag="pause"):
    """Request to stand still."""


class StepStatus(Message, frozen=True, tag="step"):
    """Request to show the next status of the selected robot, or the one before."""

    back: bool = False


class AddMark(Message, frozen=True, tag="mark"):
    """Request to mark the time that is shown."""

    note: Annotated[str, Meta(max_length=NOTE_LENGTH)]


RecordedPageMessage: TypeAlias = (
    Seek
    | Play
    | Pause
    | StepStatus
    | AddMark
    | PageHeartbeat
    | StopCommand
    | SelectRobot
    | SelectPlotFields
    | SetView
    | ShowMap
    | ShowShadow
    | StudentRequest
)
"""What such a page may send: nothing that moves a robot."""
