"""Messages from the dashboard server to the page, as `docs/teleop.md` specifies them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypeAlias

import msgspec

from tsd_twin.client.connection import Source
from tsd_twin.dashboard.scene.appearance import ViewSettings
from tsd_twin.dashboard.server.messages_from_page import Message, Triple
from tsd_twin.messages.codes import Reason
from tsd_twin.messages.requests import Event, why_of
from tsd_twin.messages.status import Status
from tsd_twin.security import Role
from tsd_twin.shadow import ShadowReport

FloorPoint: TypeAlias = tuple[float, float]
"""Metres on the floor."""


def encode_message(message: Any) -> str:
    """Return the text frame of a message; numbers that are not finite become null."""
    return msgspec.json.encode(message).decode()


class SpeedLimits(msgspec.Struct, frozen=True):
    """Speed limits of the description."""

    speed_mps: float
    turn_rate_rad_per_s: float


class TwistAxisInfo(msgspec.Struct, frozen=True):
    """Component of a twist: name, symbol and unit."""

    name: str
    symbol: str
    unit: str


class WheelSpeedLimits(msgspec.Struct, frozen=True):
    """Range of the speed of wheels that always spin, and the resulting limits."""

    least_rpm: int
    most_rpm: int
    usual_rpm: int
    """That of the description."""
    wheel_radius_m: float
    servo_step_deg: float


class RobotInfo(Message, frozen=True, tag="robot"):
    """Constant data of a robot."""

    id: str
    title: str
    limits: SpeedLimits
    levels: Sequence[int]
    space: Literal["floor", "sphere"]
    """Pose type: a robot on a floor, or a sphere that is turned in place."""
    twist_axes: Sequence[TwistAxisInfo]
    """Of `drive`, `twist` and `commanded`, in this order."""
    twist_scale_m: float
    """Metres a second that one unit of the first two numbers is; limits of speed are in m/s."""
    panel: Literal["gimbals", "wheels", "sphere", "twist"]
    """Kind of the actuator tab."""
    max_tilt_deg: float | None = None
    modules: Sequence[str] = ()
    """Names of the gimbals."""
    wheel_speed_limits: WheelSpeedLimits | None = None
    """Of robots on gimbals."""
    wheels: Sequence[str] = ()
    """Names of the wheels that roll."""
    max_rpm: float | None = None
    """Of those wheels."""
    alternative_estimate: str | None = None
    """Source of the alternative estimate, of robots that have two."""
    not_promised: Sequence[str] = ()
    """What the rules cannot promise for a robot without our node on it, a sentence each."""
    plot_fields: Sequence[str] = ()
    """Names of the values that a page can request for its plots; each ends with its unit."""


class GimbalState(msgspec.Struct, frozen=True):
    """One gimbal; degrees."""

    alpha: float
    beta: float
    tilt: float
    radius_mm: float
    rpm: float
    set_alpha: float
    set_beta: float
    axle: tuple[float, float]
    """Tilt direction of the axle, seen from above in `base_link`; length 1 is the tilt limit."""
    set_axle: tuple[float, float]
    spinning: bool


class WheelState(msgspec.Struct, frozen=True):
    """State of a rolling wheel."""

    rpm: float
    set_rpm: float
    residual_mps: float
    """Speed of its rim that no motion of the robot explains."""


class SphereState(msgspec.Struct, frozen=True):
    """A sphere that turns in place; angular velocities in rad/s."""

    wxyz: tuple[float, float, float, float]
    """Orientation."""
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


class EstimateDifference(msgspec.Struct, frozen=True):
    """Difference between the alternative estimate and the estimate."""

    metres: float
    degrees: float


class RouteState(msgspec.Struct, frozen=True):
    """Planned path of this page, and progress along it."""

    number: int
    phase: Literal["planning", "planned", "going", "arrived", "ended"]
    length_m: float
    time_s: float
    """Duration at the planned speed level."""
    done_m: float = 0.0
    off_mm: float = 0.0
    """Between the robot and where it should be."""
    why: Reason | None = None
    """Why it has ended."""


class MapRobot(msgspec.Struct, frozen=True):
    """Robot on the map."""

    id: str
    pose: Triple
    """Estimate in `odom`."""
    reach_m: float
    """Radius around its base."""
    stale: bool
    """Whether it is silent: the pose is old."""


class MapState(msgspec.Struct, frozen=True):
    """What moves on the map."""

    robots: Sequence[MapRobot]
    """All that drive on the floor."""
    envelope: Sequence[FloorPoint] | None
    """Stop envelope of the robot that the page shows, in the frame of that robot; null at rest."""


class PastState(msgspec.Struct, frozen=True):
    """What the robot was doing some seconds ago, while its past is drawn."""

    ago_s: float
    mode: str
    pose: Triple | None
    twist: Triple | None


class RobotState(Message, frozen=True, tag="state"):
    """State of the robot."""

    seen: int
    robot_s: float
    """Time of the robot's monotonic clock when it sent the status."""
    age_ms: float
    source: Source
    """Only states of a `robot` show that it is stopped."""
    status: Status
    mode_age_s: float
    """For how long the robot has been in its mode, as far as the gateway knows."""
    you: bool
    robot_ms: float | None
    """Round trip from here to the robot, median of the last ones."""
    robot_jitter_ms: float | None
    """95th percentile minus median of them."""
    pose: Triple | None
    twist: Triple | None
    commanded: Triple | None
    truth: Triple | None
    modules: Sequence[GimbalState] = ()
    wheels: Sequence[WheelState] = ()
    sphere: SphereState | None = None
    estimate_difference: EstimateDifference | None = None
    route: RouteState | None = None
    plot: Mapping[str, float | None] = {}
    """Values that this page has requested for its plots."""
    map: MapState | None = None
    """While the page shows its map."""
    past: PastState | None = None
    """While the page draws the past beside it."""
    shadow: ShadowReport | None = None
    """While the page shows it."""


class MapLines(Message, frozen=True, tag="map_lines"):
    """Lines of the map; sent when it is opened, and when another path or no path is planned."""

    routes: Mapping[str, Sequence[FloorPoint]]
    """Planned paths of all pages, in `odom`, by robot."""
    trails: Mapping[str, Sequence[FloorPoint | None]] | None
    """Paths of the estimates by robot, with null where one begins anew; the page continues them.
    Without a value they stay as they are."""


class ViewChanged(Message, frozen=True, tag="view"):
    """View settings that were changed in the panel, for the page to keep."""

    settings: ViewSettings


class RobotName(msgspec.Struct, frozen=True):
    """Entry of the robot menu."""

    id: str
    title: str
    colour: str
    """As `#rrggbb`; that of the robot in the scene."""


class SessionInfo(Message, frozen=True, tag="welcome"):
    """Operator id and role of the page, and the list of robots."""

    operator: str
    role: Role
    user: str | None
    """Logged-in user; None when no login is required."""
    may_stop: bool
    robots: Sequence[RobotName]
    robot: str | None


class PanelSliders(Message, frozen=True, tag="panel_sliders"):
    """Positions of the sliders of the viser panel."""

    vx: float
    vy: float
    omega: float
    mode: Literal["preview", "drive"]
    latch: bool


class SphereClick(Message, frozen=True, tag="sphere_click"):
    """Click on a point of the sphere, which the operator wants on top."""

    robot: str
    at: Triple
    """Unit vector to it, along the axes that are painted on the ball."""


class ControlsReleased(Message, frozen=True, tag="released"):
    """The server has released the controls; they must be centred first."""

    why: Reason


class ActionReply(Message, frozen=True, tag="reply"):
    """Reply to a request of the page."""

    to: str
    ok: bool
    why: Reason | None = None
    """Why it was refused."""


class RobotEvent(Message, frozen=True, tag="event"):
    """Event of the robot."""

    kind: str
    text: str
    why: Reason
    robot_s: float
    past: bool = False
    """It happened before the page selected the robot."""
    age_s: float = 0.0
    """Time since the dashboard received it: pages show all times on their own clock."""

    @classmethod
    def of(cls, event: Event, *, past: bool = False, age_s: float = 0.0) -> RobotEvent:
        """Return the displayed part of an event."""
        return cls(
            kind=event.kind,
            text=event.text,
            why=why_of(event) or Reason(event.kind),
            robot_s=round(event.robot_s, 3),
            past=past,
            age_s=round(age_s, 3),
        )


class StudentKnob(msgspec.Struct, frozen=True):
    """Number of a description that can be changed."""

    key: str
    label: str
    unit: str
    value: float
    usual: float
    """Value in the shipped description."""
    least: float
    most: float
    step: float


class StudentFigure(msgspec.Struct, frozen=True):
    """Number that follows from the description."""

    name: str
    value: float
    unit: str
    note: str = ""


class StudentOutline(msgspec.Struct, frozen=True):
    """Outline of the reachable twists in two of their components."""

    axes: tuple[int, int]
    """Indices of the components."""
    section: Sequence[tuple[float, float]]
    """Boundary of the twists whose third component is zero."""
    shadow: Sequence[tuple[float, float]]
    """Boundary of the projection of all twists."""


class StudentWheel(msgspec.Struct, frozen=True):
    """Wheel of a variant at the requested twist, along the axes of the robot."""

    at: tuple[float, float]
    """Where it touches, metres."""
    push: tuple[float, float]
    """Velocity of that place, m/s."""
    direction_deg: float | None
    """Where a wheel that turns forward drives to; None for wheels on gimbals."""
    rpm: float
    gimbal: Triple | None = None
    """alpha, beta and tilt in degrees."""
    axle: tuple[float, float] | None = None
    """Horizontal part of the unit vector along the axle."""
    effective_radius_mm: float | None = None


class StudentFigures(msgspec.Struct, frozen=True):
    """All that follows from a description and a twist."""

    axes: Sequence[TwistAxisInfo]
    tops: Triple
    """Largest value of each component alone."""
    figures: Sequence[StudentFigure]
    outlines: Sequence[StudentOutline]
    twist: Triple
    """The requested twist, scaled as a whole to what the joints reach."""
    utilization: float
    """Share of the joint limits that the requested twist needs; above 1 it is scaled."""
    wheels: Sequence[StudentWheel]
    radius_m: float
    """Radius of the wheels."""


class ShippedRobot(msgspec.Struct, frozen=True):
    """Entry of the robot menu of the Student tab."""

    id: str
    title: str


class StudentReply(Message, frozen=True, tag="student"):
    """Answer to `StudentRequest`; an impossible description has a problem and mostly no figures."""

    number: int
    base: str
    bases: Sequence[ShippedRobot]
    knobs: Sequence[StudentKnob]
    figures: StudentFigures | None
    problem: str
    toml: str | None


class HeartbeatReply(Message, frozen=True, tag="heartbeat"):
    """Reply to a heartbeat."""

    sent_ms: float


# To a page that shows a recording.


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
