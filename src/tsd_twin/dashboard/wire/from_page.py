"""Messages from the page to the dashboard server, specified in `docs/teleop.md`."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

import msgspec
from msgspec import Meta

from tsd_twin.dashboard.wire.view import ViewSettings
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.services import Operator, ShortText
from tsd_twin.recording.events import NOTE_LENGTH
from tsd_twin.recording.player import LEAST_SPEED, MOST_SPEED

Count: TypeAlias = Annotated[int, Meta(ge=0, le=2**53)]
"""An integer that JavaScript represents exactly."""
Triple: TypeAlias = tuple[float, float, float]
Coordinate: TypeAlias = Annotated[float, Meta(ge=-1e4, le=1e4)]
"""Metres, radians or picture fractions, bounded to avoid overflow."""
RobotId: TypeAlias = Annotated[str, Meta(max_length=32)]
Fraction: TypeAlias = Annotated[float, Meta(ge=0.0, le=1.0)]
Level: TypeAlias = Annotated[int, Meta(ge=1, le=100)]
"""Percentage of the active limits."""
BoundedNumber: TypeAlias = Annotated[float, Meta(ge=-1e6, le=1e6)]
"""Twist component or joint value, bounded to avoid overflow."""
MAX_POINTS = 256
"""Maximum number of points of a drawn line."""
MAX_PLOT_FIELDS, MAX_FIELD_NAME = 16, 100
MAX_ACTUATORS = 16
"""Maximum number of modules or wheels with given joint values."""
JointNumbers: TypeAlias = Annotated[list[BoundedNumber], Meta(max_length=3)]


class Message(msgspec.Struct, frozen=True, tag_field="t", kw_only=True):
    """Base class of messages: a JSON object with its type in `t`."""


class MotionMessage(Message, frozen=True, kw_only=True):
    """Base of the messages of held controls, which may arrive over any socket of a page."""

    number: Count = 0
    """Increases with each of them, so that none is obeyed after a newer one.

    0 is allowed on the main socket, which keeps the order.
    """
    selection: Count = 0
    """`RobotInfo.selection` of the robot shown; 0 is allowed on the main socket."""


class DriveCommand(MotionMessage, frozen=True, kw_only=True, tag="drive"):
    """Drive command: twist in m/s and rad/s in `frame`; for spheres wx, wy, wz in rad/s."""

    vx: float
    vy: float
    omega: float
    status_seq: Count
    frame: Literal["base_link", "odom"] = "base_link"


class PlanRequest(Message, frozen=True, tag="plan"):
    """Request to plan a path to a point on the floor, or along a drawn line."""

    kind: Literal["to", "draw"]
    points: Annotated[
        list[tuple[Coordinate, Coordinate]], Meta(min_length=1, max_length=MAX_POINTS)
    ]
    """For `to`, the goal and optionally a point to face on arrival; for `draw`, the whole line."""
    on: Literal["floor", "picture"]
    """Metres in `odom`, or picture fractions to the right and down from the upper left corner."""
    heading: Coordinate | None = None
    """Heading on arrival in `odom`, radians; null keeps the current heading."""
    level: Level = 100


class SetSpeedLevel(Message, frozen=True, tag="speed_level"):
    """Set the speed level."""

    level: Level


class ClearPlan(Message, frozen=True, tag="clear_plan"):
    """Clear the path."""


class FollowPlan(MotionMessage, frozen=True, kw_only=True, tag="follow_plan"):
    """Command to follow the planned path; like `drive`, it must be repeated."""

    route: Count
    """Number of the path, which changes with each planning."""
    status_seq: Count


class ReleaseControls(MotionMessage, frozen=True, tag="release"):
    """All controls have been released."""


class PreviewRequest(Message, frozen=True, tag="preview"):
    """Request to show the joints for a twist, on this page only; it moves no robot."""

    twist: tuple[BoundedNumber, BoundedNumber, BoundedNumber] | None
    """As in `drive`, along the robot's axes; null ends the preview."""


class PageHeartbeat(Message, frozen=True, tag="heartbeat"):
    """Heartbeat of the page; `sent_ms` on the page's clock is returned."""

    status_seq: Count
    sent_ms: float
    focus: bool = True


class LeaseAction(Message, frozen=True, tag="lease"):
    """Lease request: acquire, release, request from the holder, or answer a request."""

    op: Literal["acquire", "release", "request", "withdraw", "grant", "deny"]
    take_over: bool = False
    reason: ShortText = ""
    """Reason for taking over."""
    requester: Operator | None = None
    """Requesting operator, for grant and deny."""
    max_age_s: Annotated[float, Meta(gt=0.0, le=10.0)] | None = None


class ArmRequest(Message, frozen=True, tag="arm"):
    """Request to arm."""


class DisarmRequest(Message, frozen=True, tag="disarm"):
    """Request to disarm."""


class ResetRequest(Message, frozen=True, tag="reset"):
    """Request to reset a latched stop or fault."""


class SetWheelSpeed(Message, frozen=True, tag="wheel_speed"):
    """Request to change the speed of continuously spinning wheels."""

    cruise_speed_rpm: float


class StopCommand(Message, frozen=True, tag="stop"):
    """Latched software stop for the robot in view, a robot by its id, or all robots.

    A replay is never addressed. With one in view, a stop without fields stops all live robots.
    """

    robot: RobotId | None = None
    all: bool = False
    number: Count = 0
    """Number of this press if it is sent over several sockets: copies of it have no effect."""


class SelectRobot(Message, frozen=True, tag="robot"):
    """Request to select another robot."""

    id: RobotId


class ShowFleet(Message, frozen=True, tag="fleet"):
    """Request for the states of all robots while `on`."""

    on: bool


class SetName(Message, frozen=True, tag="name"):
    """Display name of the operator, in any script; ignored with a login."""

    name: ShortText


class SelectPlotFields(Message, frozen=True, tag="plot_fields"):
    """Request for plot values with every state of the selected robot."""

    names: Annotated[
        list[Annotated[str, Meta(max_length=MAX_FIELD_NAME)]], Meta(max_length=MAX_PLOT_FIELDS)
    ]
    """Names from `RobotInfo.plot_fields`; unknown names are ignored."""


class SetView(Message, frozen=True, tag="view"):
    """View settings to apply: stored by the browser, or set by a key or preset of the page."""

    settings: ViewSettings
    look: bool = False
    """Whether the camera turns to the robot even if its preset does not change."""


class SetFrame(Message, frozen=True, tag="frame"):
    """Part of the picture that nothing of the page covers, where the camera frames the robot.

    Fractions of width and height from the upper left corner.
    """

    left: Fraction = 0.0
    top: Fraction = 0.0
    right: Fraction = 1.0
    bottom: Fraction = 1.0
    picture_px: Annotated[float, Meta(ge=0.0, le=2e4)] = 0.0
    """Height of the whole picture in CSS pixels; 0 if unknown."""


class ShowMap(Message, frozen=True, tag="map"):
    """Request for map data with every state while `on`."""

    on: bool


LOOK_BACK_S = 30.0
"""Duration of the stored history of a robot."""


class LookBack(Message, frozen=True, tag="look_back"):
    """Request to draw a past state of the robot next to the live one; null ends it."""

    history_offset_s: Annotated[float, Meta(ge=0.1, le=LOOK_BACK_S)] | None


class ShowShadow(Message, frozen=True, tag="shadow"):
    """Request for the comparison with the shadow twin with every state while `on`."""

    on: bool


class StudentRequest(Message, frozen=True, tag="student"):
    """Request for the figures of a built-in robot with modified parameters."""

    number: Count
    """Returned in the reply."""
    base: Annotated[str, Meta(max_length=32)]
    knobs: Annotated[dict[Annotated[str, Meta(max_length=64)], float], Meta(max_length=64)]
    """Modified numbers of the description by key."""
    twist: Triple = (0.0, 0.0, 0.0)
    """Twist for which the joint values are computed."""
    joints: Annotated[list[JointNumbers], Meta(max_length=MAX_ACTUATORS)] | None = None
    """Joint values for which the twist is computed, instead of the joints for `twist`.

    For each module alpha and beta in degrees and rpm, for each wheel rpm.
    """
    toml: bool = False
    """Whether the reply includes the description as a TOML file."""
    papers: bool = False
    """Whether the reply includes figures of the papers."""
    show: bool = False
    """Whether the scene of this page shows the robot with these joints, in place of its own."""


LaneMessage: TypeAlias = DriveCommand | FollowPlan | ReleaseControls | PageHeartbeat | StopCommand
"""Messages accepted over the lanes of a page."""
TeleopMessage: TypeAlias = (
    DriveCommand | FollowPlan | ReleaseControls | PlanRequest | SetSpeedLevel | ClearPlan
)
"""Messages that move the robot or plan its motion."""
HolderMessage: TypeAlias = ArmRequest | DisarmRequest | ResetRequest | SetWheelSpeed
"""Requests of the lease holder."""
DisplayMessage: TypeAlias = (
    SelectRobot
    | SelectPlotFields
    | SetView
    | SetFrame
    | ShowMap
    | ShowFleet
    | ShowShadow
    | StudentRequest
)
"""Messages that affect only the messages to the page."""
PageMessage: TypeAlias = (
    TeleopMessage
    | PreviewRequest
    | PageHeartbeat
    | LeaseAction
    | HolderMessage
    | StopCommand
    | SetName
    | LookBack
    | DisplayMessage
)

_DECODER = msgspec.json.Decoder(PageMessage)


def decode_page_message(text: str | bytes) -> PageMessage:
    """Decode the message in a text frame.

    Raises:
        MessageError: With code `shape` if it is not a valid message.
    """
    try:
        return _DECODER.decode(text)
    # msgspec does not wrap the errors for invalid UTF-8 and deep nesting.
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise MessageError("shape", str(error)) from error


# Messages from a page that shows a recording.


class Seek(Message, frozen=True, tag="seek"):
    """Request to show a time of the recording."""

    t_s: Annotated[float, Meta(ge=0.0, le=1e6)]


class Play(Message, frozen=True, tag="play"):
    """Request to play."""

    speed: Annotated[float, Meta(ge=LEAST_SPEED, le=MOST_SPEED)]


class Pause(Message, frozen=True, tag="pause"):
    """Request to pause."""


class StepStatus(Message, frozen=True, tag="step"):
    """Request to show the next or previous status of the selected robot."""

    back: bool = False


class AddMark(Message, frozen=True, tag="mark"):
    """Request to annotate the current time."""

    note: Annotated[str, Meta(max_length=NOTE_LENGTH)]


RecordedPageMessage: TypeAlias = (
    Seek | Play | Pause | StepStatus | AddMark | PageHeartbeat | StopCommand | DisplayMessage
)
"""Messages accepted from such a page; none of them moves a robot."""
