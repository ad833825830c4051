"""Messages of the fleet view: states of all robots, and stops; specified in `docs/teleop.md`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import msgspec

from tsd_twin.client.connection import Source
from tsd_twin.dashboard.wire.from_page import Message, Triple
from tsd_twin.messages.codes import Reason


class FleetBattery(msgspec.Struct, frozen=True):
    """Battery of a robot that measures it."""

    volts: float
    low: bool
    """Whether it is below the warning level of the description."""


class FleetEvent(msgspec.Struct, frozen=True):
    """Latest event of a robot."""

    why: Reason
    age_s: float
    """Time since the dashboard received it, when this message was sent."""


class FleetRobot(msgspec.Struct, frozen=True):
    """State of a robot; null stands for a value that it has not reported."""

    id: str
    title: str
    colour: str
    """As `#rrggbb`."""
    panel: Literal["gimbals", "wheels", "sphere", "twist", "joints"]
    """Kind of the robot, for its picture, as in `RobotInfo`."""
    wheel_count: int
    """Number of modules or wheels; 0 if unknown."""
    space: Literal["floor", "sphere"]
    """A robot on the floor has a pose; a sphere has none."""
    source: Source
    """Only a `robot` can be stopped or driven; `several` robots share one id."""
    silent: bool
    """Whether no state has arrived for a second; all other fields are then the last known."""
    age_s: float | None
    """Time since the last state, when this message was sent."""
    mode: str | None
    latched: bool
    """Whether it needs a reset."""
    why: Reason | None
    """Why it stopped, is stopping or is no longer armed."""
    driver: str | None
    """Operator id of the lease holder; this page's own is in `SessionInfo`."""
    requested_by: str | None
    """Operator id of the one who asks the driver for control."""
    operators: Mapping[str, str]
    """Display names by operator id; operators without an entry have none."""
    battery: FleetBattery | None
    event: FleetEvent | None


class Fleet(Message, frozen=True, tag="fleet"):
    """States of all robots, first whole, then at most four times a second as they change."""

    whole: bool
    """Whether the page replaces its list; otherwise it replaces the robots and poses named."""
    robots: Sequence[FleetRobot]
    poses: Mapping[str, Triple]
    """Estimates in `odom` by robot id: x and y in metres, heading in radians."""


class StopResult(Message, frozen=True, tag="stop_result"):
    """Progress of a stop that names a robot or all: `sent` at once, then one of the others."""

    robot: str
    outcome: Literal["sent", "acknowledged", "not_reached"]
    """`acknowledged` means that the status of the robot shows it latched."""
    why: Reason | None = None
    """Why it was not reached."""
