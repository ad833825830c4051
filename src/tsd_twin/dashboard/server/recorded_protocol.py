"""Messages between a page that shows a recording and the dashboard server."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, TypeAlias

import msgspec
from msgspec import Meta

from tsd_twin.dashboard.server.messages_from_page import (
    Message,
    PageHeartbeat,
    SelectPlotFields,
    SelectRobot,
    SetView,
    ShowMap,
    ShowShadow,
    StopCommand,
    StudentRequest,
)
from tsd_twin.dashboard.server.messages_to_page import (
    FloorPoint,
    RobotState,
)
from tsd_twin.recording.events import NOTE_LENGTH
from tsd_twin.recording.player import LEAST_SPEED, MOST_SPEED


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


class TimelineEvent(msgspec.Struct, frozen=True):
    """Event or mark on the timeline."""

    t_s: float
    robot: str
    kind: str
    text: str
    count: int


class Timeline(Message, frozen=True, tag="timeline"):
    """The recording that a page shows."""

    name: str
    start_ms: int
    """Wall clock of the recorder at its start."""
    duration_s: float
    events: Sequence[TimelineEvent]


class RecordedPath(msgspec.Struct, frozen=True):
    """Path of a robot, for the small picture of a recording in the list."""

    robot: str
    colour: str
    """As `#rrggbb`."""
    points: Sequence[FloorPoint]
    """Places at equal times, in `odom`; none of a sphere."""


class PastStates(Message, frozen=True, tag="past"):
    """States before the time that is shown, for plots, after a jump."""

    states: Sequence[RobotState]


class Cursor(Message, frozen=True, tag="cursor"):
    """Time that is shown."""

    t_s: float
    playing: bool
    speed: float
