"""Messages from the dashboard server to the page, specified in `docs/teleop.md`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypeAlias

import msgspec

from tsd_twin.client.connection import Source
from tsd_twin.dashboard.wire.from_page import Message, Triple
from tsd_twin.messages.codes import Reason
from tsd_twin.messages.status import RobotStatus
from tsd_twin.security import Role
from tsd_twin.shadow import ShadowReport

FloorPoint: TypeAlias = tuple[float, float]
"""Metres on the floor."""


def encode_message(message: Any) -> str:
    """Encode a message as a text frame; NaN and infinity become null."""
    return msgspec.json.encode(message).decode()


class TwistAxisInfo(msgspec.Struct, frozen=True):
    """Component of a twist: name, symbol and unit."""

    name: str
    symbol: str
    unit: str


class WheelSpeedLimits(msgspec.Struct, frozen=True):
    """Speed range of continuously spinning wheels, and the resulting limits."""

    least_rpm: int
    most_rpm: int
    default_rpm: int
    """Wheel speed from the description."""
    wheel_radius_m: float
    servo_step_deg: float


class JointInfo(msgspec.Struct, frozen=True):
    """Row of the panel `joints`."""

    name: str
    unit: str


class RobotInfo(Message, frozen=True, tag="robot"):
    """Constant data of a robot."""

    id: str
    title: str
    max_speed_mps: float
    """Speed limit of the description."""
    space: Literal["floor", "sphere"]
    """Pose type: a robot on a floor, or a sphere rotating in place."""
    twist_axes: Sequence[TwistAxisInfo]
    """Components of `drive`, `twist` and `commanded`, in this order."""
    twist_scale_m: float
    """Metres per second per unit of the first two components; speed limits are in m/s."""
    sideways: bool
    """Whether it can move sideways; otherwise the controls request no sideways motion."""
    panel: Literal["gimbals", "wheels", "sphere", "twist", "joints"]
    """Kind of the actuator tab; `joints` is a list for kinds without a separate panel."""
    max_tilt_deg: float | None = None
    modules: Sequence[str] = ()
    """Names of the gimbals."""
    wheel_speed_limits: WheelSpeedLimits | None = None
    """For robots with gimbals."""
    wheels: Sequence[str] = ()
    """Names of the rolling wheels."""
    joints: Sequence[JointInfo] = ()
    """Rows of the panel `joints`."""
    alternative_estimate: str | None = None
    """Source of the alternative estimate, if the robot has one."""
    not_promised: Sequence[str] = ()
    """Safety rules that cannot be guaranteed without our node on the robot, one sentence each."""
    plot_fields: Sequence[str] = ()
    """Names of the values available for plots; each ends with its unit."""
    selection: int = 0
    """Counts the robots selected on this page, with their restarts."""


LimitName: TypeAlias = Literal["speed", "turn_rate", "tilt", "wheel_speed"]
"""Limit that scales a twist down: two of the description or lease, and two of the joints."""


class GimbalPose(msgspec.Struct, frozen=True):
    """Joints of a module and their effect; angles in degrees, vectors along `base_link`."""

    alpha: float
    beta: float
    tilt: float
    direction: float | None
    """Direction towards which the axle tilts, from X towards Y; None if it is upright."""
    axle: tuple[float, float]
    """Tilt direction of the axle, seen from above; length 1 is the tilt limit."""
    push: tuple[float, float]
    """Velocity at which the rolling wheel moves its pivot, m/s."""
    rpm: float


class WheelPose(msgspec.Struct, frozen=True):
    """Speed of a wheel with rollers and its effect."""

    rpm: float
    push: tuple[float, float]
    """Rim velocity along the drive direction from above, along `base_link`, m/s.

    It moves the robot over the floor, or the sphere over the robot.
    """


class GimbalState(GimbalPose, frozen=True):
    """Measured joints of a module and their effect, with the commanded ones."""

    radius_mm: float
    spinning: bool
    setpoint: GimbalPose
    """Commanded joints; the push is for the measured wheel speed."""


class WheelState(WheelPose, frozen=True):
    """Measured speed of a rolling wheel and its effect, with the commanded ones."""

    rpm_setpoint: float
    push_setpoint: tuple[float, float]
    residual_mps: float
    """Rim speed not explained by the robot's motion."""


class JointValue(msgspec.Struct, frozen=True):
    """Measured and commanded value in a row of the panel `joints`."""

    value: float | None
    setpoint: float | None = None


class SphereState(msgspec.Struct, frozen=True):
    """State of a sphere rotating in place; angular velocities in rad/s."""

    wxyz: tuple[float, float, float, float]
    """Orientation."""
    ideal: Triple
    """Angular velocity for ideal wheel contacts, midway between the rows of rollers."""
    dual: Triple | None
    """Angular velocity for the actual row contacts."""
    angle_deg: float | None
    """Angle between the two angular velocities."""
    magnitude_percent: float | None
    """Amount by which `ideal` is smaller than `dual`, in percent of `dual`."""
    rows: Sequence[int]
    """Row of rollers in contact per wheel, 1 or 2; 0 if unknown."""


class EstimateDifference(msgspec.Struct, frozen=True):
    """Difference between the alternative estimate and the estimate."""

    metres: float
    degrees: float


class RouteState(msgspec.Struct, frozen=True):
    """Planned path of this page and its progress."""

    number: int
    phase: Literal["planning", "planned", "going", "arrived", "ended"]
    length_m: float
    time_s: float
    """Duration at the planned speed level."""
    done_m: float = 0.0
    off_mm: float = 0.0
    """Distance between the robot and its planned position."""
    why: Reason | None = None
    """Reason why the run has ended."""


class MapRobot(msgspec.Struct, frozen=True):
    """Robot on the map."""

    id: str
    pose: Triple
    """Estimate in `odom`."""
    reach_m: float
    """Radius around the base."""
    stale: bool
    """Whether the pose is outdated because the robot is silent."""


class MapState(msgspec.Struct, frozen=True):
    """Moving elements of the map."""

    robots: Sequence[MapRobot]
    """All robots that drive on the floor."""
    envelope: Sequence[FloorPoint] | None
    """Stop envelope of the selected robot in its frame; null at rest."""


class PastState(msgspec.Struct, frozen=True):
    """Past state of the robot while it is drawn."""

    history_offset_s: float
    mode: str
    pose: Triple | None
    twist: Triple | None


class CameraState(msgspec.Struct, frozen=True):
    """Camera of a page."""

    off_screen_rad: float | None
    """Direction of the robot outside the picture, from right to up; null inside."""


class RobotState(Message, frozen=True, tag="state"):
    """State of the robot."""

    status_seq: int
    robot_s: float
    """Monotonic time of the robot when it sent the status."""
    age_ms: float
    source: Source
    """Only states from a `robot` confirm that it has stopped."""
    status: RobotStatus
    mode_age_s: float
    """Time in the current mode, as observed by the gateway."""
    has_control: bool
    rtt_ms: float | None
    """Median recent round-trip time between the gateway and the robot."""
    rtt_jitter_ms: float | None
    """95th percentile minus median of the recent round-trip times."""
    pose: Triple | None
    twist: Triple | None
    commanded: Triple | None
    truth: Triple | None
    modules: Sequence[GimbalState] = ()
    wheels: Sequence[WheelState] = ()
    joints: Sequence[JointValue] = ()
    """Values of the rows `joints` of the robot's info."""
    utilization: float | None = None
    """Fraction of the joint limit in use by the measured joints: sine of the tilt, wheel speed."""
    limit: LimitName | None = None
    """Limit that holds the robot back, while it drives slower than requested."""
    sphere: SphereState | None = None
    estimate_difference: EstimateDifference | None = None
    route: RouteState | None = None
    plot: Mapping[str, float | None] = {}
    """Values that this page has requested for its plots."""
    camera: CameraState | None = None
    """Null before the page's camera was placed in front of the robot."""
    map: MapState | None = None
    """Present while the page shows the map."""
    stop_reaches: str | None = None
    """Id of the localized robot that the stop envelope of this localized robot reaches."""
    past: PastState | None = None
    """Present while the page draws the past state."""
    shadow: ShadowReport | None = None
    """Present while the page shows the comparison."""
    selection: int = 0
    """`RobotInfo.selection` of the robot; 0 in recordings."""


class MapLines(Message, frozen=True, tag="map_lines"):
    """Lines of the map, sent when it is opened and when the planned paths change."""

    routes: Mapping[str, Sequence[FloorPoint]]
    """Planned paths of all pages, in `odom`, by robot."""
    trails: Mapping[str, Sequence[FloorPoint | None]] | None
    """Paths of the estimates by robot, with null between discontinuous parts.

    The page extends them; null leaves the current ones unchanged.
    """


class RobotName(msgspec.Struct, frozen=True):
    """Entry of the robot menu."""

    id: str
    title: str
    colour: str
    """Colour of the robot in the scene, as `#rrggbb`."""


class SessionInfo(Message, frozen=True, tag="welcome"):
    """Operator id and role of the page, and the list of robots."""

    operator: str
    """Id on the bus, as in `status.lease.holder`."""
    name: str
    """Display name of the operator, or ""."""
    role: Role
    user: str | None
    """Logged-in user, or None if no login is required."""
    may_stop: bool
    robots: Sequence[RobotName]
    robot: str | None


class JointPreview(Message, frozen=True, tag="preview"):
    """Joints for a requested twist at the current wheel speed, without moving the robot."""

    robot: str
    twist: Triple
    """Requested twist, scaled down to the limits if necessary."""
    utilization: float
    """Fraction of the joint limits needed by the requested twist; above 1 it is scaled."""
    limit: LimitName | None
    """Limit that scales the twist, if any."""
    modules: Sequence[GimbalPose] = ()
    wheels: Sequence[WheelPose] = ()
    joints: Sequence[JointValue] = ()
    """Values of the rows `joints` of the robot's info."""


class SphereClick(Message, frozen=True, tag="sphere_click"):
    """Click on the point of the sphere that should turn to the top."""

    robot: str
    at: Triple
    """Unit vector to the point, along the axes painted on the ball."""


class ControlsReleased(Message, frozen=True, tag="released"):
    """The server has released the controls; the page must centre them before they act again."""

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
    why: Reason
    past: bool = False
    """Whether it happened before the page selected the robot."""
    age_s: float = 0.0
    """Time since the dashboard received it; pages convert all times to their own clock."""


class HeartbeatReply(Message, frozen=True, tag="heartbeat"):
    """Reply to a heartbeat."""

    sent_ms: float


class RecordingsChanged(Message, frozen=True, tag="recordings_changed"):
    """Recordings, titles, marks or the trash have changed; fetch the list again if it is shown."""


# Messages to a page that shows a recording.


class TimelineEvent(msgspec.Struct, frozen=True):
    """Event or annotation on the timeline."""

    t_s: float
    robot: str
    kind: str
    text: str
    count: int
    why: Reason | None = None
    """Null for notes and old recordings."""


class Timeline(Message, frozen=True, tag="timeline"):
    """Timeline of the recording."""

    name: str
    start_ms: int
    """Wall-clock time of the recorder at the start."""
    duration_s: float
    events: Sequence[TimelineEvent]


class RecordedPath(msgspec.Struct, frozen=True):
    """Path of a robot for the preview in the list of recordings."""

    robot: str
    colour: str
    """As `#rrggbb`."""
    points: Sequence[FloorPoint]
    """Positions at equal time intervals in `odom`; empty for a sphere."""


class PastStates(Message, frozen=True, tag="past"):
    """States before the current time of the recording, sent after a jump for the plots."""

    states: Sequence[RobotState]


class Cursor(Message, frozen=True, tag="cursor"):
    """Current time of the recording."""

    t_s: float
    playing: bool
    speed: float
