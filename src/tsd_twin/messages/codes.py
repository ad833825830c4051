"""Codes of refusals, stops, faults, events and dropped commands, with sentences and parameters.

A robot sends a `Reason`: a code and its parameters. `sentences` puts it into words. Codes and
parameters are only added, never renamed or given another meaning; clients show a code that they do
not know as its words.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from enum import StrEnum
from typing import TypeAlias

import msgspec

Value: TypeAlias = str | float
"""Parameter of a reason: a text, or a finite number in the unit of its type."""
_MAX_CAUSES = 8
"""Maximum number of nested causes; robots send up to four."""


class Reason(msgspec.Struct, frozen=True, omit_defaults=True):
    """Code with its parameters, and the reason behind it if there is one."""

    code: str
    """Value of a `Code`; a string, since a newer robot may send another one."""
    params: Mapping[str, Value] = {}
    cause: Reason | None = None

    def __post_init__(self) -> None:
        """Limit the depth, because a client recurses into the causes of what it receives."""
        depth, cause = 0, self.cause
        while cause is not None:
            depth, cause = depth + 1, cause.cause
        if depth > _MAX_CAUSES:
            raise ValueError(f"a reason has at most {_MAX_CAUSES} causes")


class Code(StrEnum):
    """All codes of this version, each with the template of its sentence.

    A template is part of a sentence, without capital and full stop. `{name}` is a parameter,
    `{cause}` the text of the reason behind it. `{name:.1}` has one decimal, `{name:+.1}` always a
    sign, `{name:,}` commas between thousands. A part in brackets is left out if one of its
    parameters is missing; the part after its bar is shown instead.
    """

    _value_: str
    template: str

    def __new__(cls, value: str, template: str = "") -> Code:
        """Create a member from its value and template."""
        code = str.__new__(cls, value)
        code._value_, code.template = value, template
        return code

    # Texts of people and libraries.
    TEXT = "text", "{text}"
    HARDWARE = "hardware", "{text}"
    # Control: refusals and replies of `srv/lease`.
    TAKE_CONTROL_FIRST = "take_control_first", "take control first"
    HELD_BY = "held_by", "{holder} has control"
    DRIVEN_BY = "driven_by", "{holder} drives; ask for control or take over"
    RESERVED_FOR = "reserved_for", "control is kept for {operator}, for a moment"
    LEASE_NOT_IN_FORCE = "lease_not_in_force", "this lease is not in force"
    NO_OPERATOR = "no_operator", "the robot has no operator: acquire control"
    HAS_CONTROL_ALREADY = "has_control_already", "{holder} has control already"
    DENIED_LATELY = "denied_lately", "control was kept: ask again in {s} s"
    OTHER_REQUEST = "other_request", "{asker} asks already"
    NO_REQUEST = "no_request", "no operator has requested control"
    NO_REQUEST_OF = "no_request_of", "{operator} does not ask for control"
    REQUEST_OF = "request_of", "it is {asker} who asks"
    RELEASED = "released", "released"
    WITHDRAWN = "withdrawn", "withdrawn"
    RESERVED = "reserved", "control is kept for {operator}"
    CONTROL_KEPT = "control_kept", "control is kept"
    HOLDER_ASKED = "holder_asked", "{holder} is asked"
    # Refusals of other requests, and of motion.
    ARM_FIRST = "arm_first", "the robot is disarmed: arm it first"
    STILL_ARMING = "still_arming", "the robot is still arming"
    COMING_TO_REST = "coming_to_rest", "the robot is coming to rest"
    RESET_FIRST = "reset_first", "the robot is {mode}: reset first"
    WRONG_MODE = "wrong_mode", "the robot is {mode} already"
    NOT_LATCHED = "not_latched", "the robot is {mode}, not stopped"
    RELEASE_FIRST = "release_first", "let go of the stick first"
    AT_REST_ONLY = "at_rest_only", "the pose can be set at rest only"
    NO_WHEEL_SPEED = (
        "no_wheel_speed",
        "the wheels of this robot stand when it does, so they have no speed to choose",
    )
    WHEEL_SPEED_REFUSED = (
        "wheel_speed_refused",
        "the wheels turn at {least_rpm:,} to {most_rpm:,} rpm",
    )
    NOT_SERVED = "not_served", "the node answers this"
    RECORDING = "recording", "this is a recording of '{robot}': it cannot be driven or stopped"
    MODE_ONLY = "mode_only", "the robot is {mode}"
    # Stops and changes of mode.
    STOP_REQUESTED = (
        "stop_requested",
        "software stop by [{by}|an unnamed client][; before: {cause}]",
    )
    STOP_WITH_TEXT = "stop_with_text", "{text}[; before: {cause}]"
    ARMED_BY_OPERATOR = "armed_by_operator", "armed by the operator"
    DISARMED_BY_OPERATOR = "disarmed_by_operator", "disarmed by the operator"
    RESET_BY_OPERATOR = "reset_by_operator", "reset by the operator"
    CONTROL_LOST = "control_lost", "the operator gave up or lost control"
    NO_COMMAND = "no_command", "no command for {ms} ms (limit {limit_ms} ms)"
    ECHO_UNKNOWN = (
        "echo_unknown",
        "the last command was based on no state of the last {limit_ms} ms",
    )
    ECHO_TOO_OLD = (
        "echo_too_old",
        "the last command was based on a state {ms} ms old (limit {limit_ms} ms)",
    )
    LOOP_LATE = "loop_late", "the robot's computer was too busy for {ms} ms"
    UNATTENDED = "unattended", "no operator has had control for {s} s"
    NOT_NEUTRAL = "not_neutral", "not armed: the gimbals are not at neutral tilt"
    NOT_AT_SPEED = "not_at_speed", "not armed: the wheels did not come to speed"
    # Faults.
    JOINTS_SILENT = "joints_silent", "the joints have not been measured for {ms} ms"
    JOINTS_SILENT_LOOP_LATE = (
        "joints_silent_loop_late",
        "the joints have not been measured, since the robot's computer was too busy for {ms} ms",
    )
    FOLLOWING_ERROR = (
        "following_error",
        "{joint} does not follow: it is {deg:+.1}° from its set-point",
    )
    DUPLICATE_ID = (
        "duplicate_id",
        "another robot with the id '{robot}' is on the bus: end one, or choose another id",
    )
    # Faults of hardware.
    RADIO_CONTROL = "radio_control", "the radio control has the robot"
    DEVICE_DISCONNECTED = "device_disconnected", "{device} is not connected: {text}"
    DEVICE_SILENT = "device_silent", "{device} has not answered for {ms} ms"
    LINE_GARBAGE = "line_garbage", "garbage on {line}: {count} broken packets in {s:.2} s"
    SERVOS_SILENT = "servos_silent", "{servos}: no answer"
    SERVO_BUS_SILENT = (
        "servo_bus_silent",
        "{servos}: no answer: the wire between them, or the bus, its supply or its fuse",
    )
    ALL_SERVOS_SILENT = (
        "all_servos_silent",
        "all servos: no answer: the bus, its supply or its fuse",
    )
    SERVO_ERROR = "servo_error", "{servos}: hardware error"
    SERVO_TOO_HOT = "servo_too_hot", "{servos}: at least {limit_c} °C: let it cool"
    SERVO_FAR = (
        "servo_far",
        "{servos}: more than 9 degrees from its neutral position, so it gets no torque: turn its "
        "gimbal upright by hand, or correct neutral_step in the calibration",
    )
    SERVO_LIMP = (
        "servo_limp",
        "{servos}: no torque: it restarted, or another program switched it off",
    )
    SERVO_UNREAD = "servo_unread", "{servos}: the settings have not been read yet"
    SERVO_MODEL = "servo_model", "{servo}: model {model} is not one of {known}"
    SERVO_REGISTER = "servo_register", "{servo}: register {register} is {value}, which must not be"
    SERVO_SETTING = (
        "servo_setting",
        "{servo}: {setting} (register {register}) is {value}, and must be {wanted}; set it with "
        "Dynamixel Wizard",
    )
    GIMBALS_STUCK = "gimbals_stuck", "{servos}: {cause}"
    BOARD_TRIP = "board_trip", "the board disarmed itself: {trip}"
    BOARD_REFUSES = "board_refuses", "the board does not arm: {what}"
    BOARD_RESTARTED = "board_restarted", "the controller board has restarted[: {reset}]"
    BOARD_LOST = "board_lost", "the controller board was lost"
    NODE_HANGS = "node_hangs", "the robot node hangs"
    ARMING_OBSTACLE = "arming_obstacle", "{what}"
    BATTERY_TOO_LOW = "battery_too_low", "the battery is too low to arm: {volts:.1} V"
    ESCS_NOT_READY = (
        "escs_not_ready",
        "the speed controllers have not had zero throttle for 2 s yet",
    )
    RECEIVER_SILENT = (
        "receiver_silent",
        "the radio control is off, or a wire of its receiver: no pulses of {channels}",
    )
    MANUAL_ON = "manual_on", "the radio control is switched to manual"
    # Faults of robots behind ROS.
    NO_ODOMETRY = "no_odometry", "no odometry has come on {topic} yet"
    ODOMETRY_OLD = "odometry_old", "no odometry newer than {s} s has come on {topic}"
    CMD_VEL_UNSENT = "cmd_vel_unsent", "cmd_vel cannot be published: {text}"
    ROS_NAME_PUBLISHED = (
        "ros_name_published",
        "two robots have the ROS name {topic}, which is also published by {node}: end one, or use "
        "another --domain",
    )
    ROS_NAME_READ = (
        "ros_name_read",
        "two robots have the ROS name {topic}, which is also read by {node}: end one, or use "
        "another --domain",
    )
    # Events.
    MODE_CHANGED = "mode_changed", "from {before} to {after}[: {cause}]"
    REQUEST_REFUSED = "request_refused", "request to {request} refused: {cause}"
    COMMAND_DROPPED = "command_dropped", "a command was dropped: {cause}"
    LEASE_GRANTED = "lease_granted", "{operator} has control"
    LEASE_TAKEN_OVER = "lease_taken_over", "{operator} took control over from {other}[: {text}]"
    LEASE_HANDED_OVER = "lease_handed_over", "{operator} hands control over to {other}"
    LEASE_RELEASED = "lease_released", "{operator} released control"
    LEASE_EXPIRED = "lease_expired", "control of {operator} has run out"
    CONTROL_REQUESTED = "control_requested", "{operator} asks {holder} for control"
    REQUEST_DENIED = "request_denied", "{operator} keeps control, for which {asker} has asked"
    REQUEST_WITHDRAWN = "request_withdrawn", "{operator} asks for control no longer"
    REQUEST_EXPIRED = (
        "request_expired",
        "{holder} has given no answer to {asker}, who asked for control",
    )
    RESERVATION_EXPIRED = (
        "reservation_expired",
        "control was kept for {operator}, who did not take it",
    )
    LIMITED = "limited", "the limits let {percent} % of the command through"
    SLOWED = "slowed", "{cause}. The speed limit is {percent} % of the usual"
    BATTERY_LOW = "battery_low", "the battery is low: below {volts} V"
    BATTERY_CHARGED = "battery_charged", "the battery has {volts:.1} V: the robot drives as usual"
    SERVO_HOT = "servo_hot", "a servo is hot: above {limit_c} °C"
    SERVO_WARM = "servo_warm", "a servo has {celsius} °C: at {limit_c} °C the robot slows down"
    SERVOS_COOLED = "servos_cooled", "the servos have cooled: the robot drives as usual"
    ACTUATOR_SUSPECT = "actuator_suspect", "{actuator} contradicts the others"
    POSE_RESET = (
        "pose_reset",
        "the pose sensor is {metres:.2} m and {deg} degrees off the estimate, at rest: the "
        "estimate is reset to it",
    )
    DUPLICATE_ID_GONE = "duplicate_id_gone", "no other robot has the id '{robot}' any more"
    RECORDING_PAUSED = "recording_paused", "the recording stands still: {text}. Driving goes on"
    RECORDING_CONTINUES = "recording_continues", "the recording goes on: {lost} messages are lost"
    MESSAGES_NOT_RECORDED = (
        "messages_not_recorded",
        "messages that are too long to record, or of too many topics, are left out: {count} so "
        "far in {file}",
    )
    # Ends of control, seen by a client.
    HAS_CONTROL_NOW = "has_control_now", "{holder} has control now"
    OTHER_CLIENT = "other_client", "another client has control now"
    LEASE_ENDED = "lease_ended", "the lease has ended"
    CONTROL_RELEASED = "control_released", "control was released"
    # Messages of the dashboard to its pages.
    CONTROL_IS_LOST = "control_is_lost", "control is lost: {cause}"
    CONTROL_ASKED_FOR = "control_asked_for", "control is asked for"
    CONTROL_HANDED_OVER = "control_handed_over", "control is handed over"
    PAGE_SILENT = "page_silent", "your page was silent for {s} s, so it lost control: take it again"
    PAGE_STALLED = "page_stalled", "your page stalled for {s} s, so the robot stopped"
    PAGE_NOT_IN_FRONT = "page_not_in_front", "the page is not in front"
    STOP_PRESSED = "stop_pressed", "software stop"
    OTHER_ROBOT_SHOWN = "other_robot_shown", "another robot is shown"
    ROBOT_SILENT = "robot_silent", "[the robot was silent for {s} s|the robot is silent]"
    STOPPED_BY_ITSELF = "stopped_by_itself", "the robot has stopped by itself"
    NO_ANSWER = "no_answer", "the robot does not answer"
    REQUEST_UNDER_WAY = "request_under_way", "the last request is still under way"
    NO_ROBOT_SHOWN = "no_robot_shown", "no robot is shown"
    NO_ROBOT_THERE = "no_robot_there", "no robot is there"
    UNKNOWN_ROBOT = "unknown_robot", "there is no robot {robot}"
    NOT_ASKING = "not_asking", "you do not ask for control"
    VIEWER = "viewer", "a viewer only watches"
    RECORDING_SHOWN = "recording_shown", "this is a recording: press L for the live robots"
    MARK_UNDER_WAY = "mark_under_way", "a mark is being written"
    PATH_REPLANNED = "path_replanned", "another path is planned"
    PATH_GIVEN_UP = "path_given_up", "the path is given up"
    PATH_REFUSED = "path_refused", "{text}"
    PATH_NOT_PLANNED = "path_not_planned", "the path could not be planned"
    NO_PATHS = "no_paths", "this robot turns in place and follows no path"
    # Messages that do not count.
    BAD_KEY = "bad_key", "{key} is not the key of one operator"
    BAD_SHAPE = "bad_shape", "{detail}"
    NOT_FINITE = "not_finite", "{quantity}"
    NOT_HOLDER = "not_holder", "{operator} sent a command, {holder} holds the lease"
    NO_LEASE = "no_lease", "{operator} sent a command, no operator holds the lease"
    OUT_OF_ORDER = "out_of_order", "command {number} came after {latest}"
    UNKNOWN_STATUS = "unknown_status", "status {number} was not sent lately"
    SENT_BEFORE_CHANGE = (
        "sent_before_change",
        "command was sent before the robot last stopped or was armed",
    )
    TOO_OLD = "too_old", "command is {s:.2} s old, {limit_s} s are allowed"
    # Paths.
    PATH_NOT_ON_FLOOR = "path_not_on_floor", "that is not on the floor"
    PATH_NOT_FINITE = (
        "path_not_finite",
        "the pose of the robot, or the heading to turn to, is no number",
    )
    PATH_TOO_LONG = "path_too_long", "a path may be {limit_m} long at most"
    ALREADY_THERE = "already_there", "the robot is there already"
    PATH_CANNOT_BE_FOLLOWED = "path_cannot_be_followed", "the route cannot be followed at {at_m}"
    PATH_NO_LONGER_PLANNED = "path_no_longer_planned", "that path is no longer planned"
    POSE_OUT_OF_DATE = "pose_out_of_date", "the robot has not sent its pose for {s}"
    PATH_OUT_OF_DATE = (
        "path_out_of_date",
        "the robot has moved or its limits have changed; a new path is planned",
    )
    PATH_STARTS_AT_REST = "path_starts_at_rest", "the robot is not at rest"
    POSE_NOT_FINITE = "pose_not_finite", "the pose is no number"
    OFF_PATH = "off_path", "the robot is {metres} and {deg} off its path"
    NO_PROGRESS = "no_progress", "the robot makes no progress"
    STAYS_FROM_GOAL = "stays_from_goal", "the robot stays {metres} from its goal"


class Type(StrEnum):
    """Type of a parameter: the unit of a number, or the meaning of a text."""

    MS = "ms"
    S = "s"
    M = "m"
    DEG = "deg"
    RPM = "rpm"
    VOLT = "V"
    CELSIUS = "°C"
    PERCENT = "%"
    COUNT = "count"
    OPERATOR = "operator"
    """Id of an operator; a page may show it as "you"."""
    NAME = "name"
    """Name of a robot, a joint, a topic or a key."""
    SERVOS = "servos"
    """Numbers and joints of servos, such as `3 (module2_alpha)`, separated by commas."""
    TEXT = "text"
    """Text of a person or a library: shown, never read by a program."""
    # One word of a fixed list; `sentences.WORDS` has its text.
    MODE = "mode"
    LATCHED = "latched mode"
    REQUEST = "request"
    QUANTITY = "quantity"
    DEVICE = "device"
    LINE = "line"
    TRIP = "trip"
    OBSTACLE = "obstacle"
    RESET_CAUSE = "reset cause"
    # The reason behind this one, in `Reason.cause`.
    CAUSE = "cause"


DECIMALS: Mapping[Type, int] = {
    Type.MS: 0,
    Type.S: 2,
    Type.M: 2,
    Type.DEG: 1,
    Type.RPM: 0,
    Type.VOLT: 1,
    Type.CELSIUS: 0,
    Type.PERCENT: 0,
    Type.COUNT: 0,
}
"""Decimals to which numbers are rounded by the sender, so that all clients show the same digits."""

_NAMES: Mapping[Type, str] = {
    Type.MS: "ms limit_ms",
    Type.S: "s limit_s",
    Type.M: "metres at_m limit_m",
    Type.DEG: "deg",
    Type.RPM: "least_rpm most_rpm",
    Type.VOLT: "volts",
    Type.CELSIUS: "celsius limit_c",
    Type.PERCENT: "percent",
    Type.COUNT: "count lost number latest model register value",
    Type.OPERATOR: "operator holder asker by other",
    Type.NAME: "robot joint actuator topic node channels file key setting known wanted",
    Type.SERVOS: "servo servos",
    Type.TEXT: "text detail",
    Type.MODE: "mode before after",
    Type.REQUEST: "request",
    Type.QUANTITY: "quantity",
    Type.DEVICE: "device",
    Type.LINE: "line",
    Type.TRIP: "trip",
    Type.OBSTACLE: "what",
    Type.RESET_CAUSE: "reset",
    Type.CAUSE: "cause",
}
"""Names of the parameters of each type; a name has one type in all codes but `reset_first`."""
_TYPES = {name: kind for kind, names in _NAMES.items() for name in names.split()}


def _parameters(template: str) -> Mapping[str, Type]:
    needed = re.findall(r"\{(\w+)", re.sub(r"\[[^]]*]", "", template))
    names = dict.fromkeys(re.findall(r"\{(\w+)", template))
    return {name if name in needed else f"{name}?": _TYPES[name] for name in names}


PARAMETERS: Mapping[Code, Mapping[str, Type]] = {
    **{code: _parameters(code.template) for code in Code},
    Code.RESET_FIRST: {"mode": Type.LATCHED},
    Code.STOP_WITH_TEXT: {"by?": Type.OPERATOR, "text": Type.TEXT, "cause?": Type.CAUSE},
}
"""Parameters of each code, by name; a name that ends with "?" may be missing.

They are those of its template, required unless in brackets.
"""

checks = False
"""Whether `because` checks parameters; tests set it, robots never raise for a reason."""


def because(code: Code, cause: Reason | None = None, /, **params: Value) -> Reason:
    """Return the reason with a code, numbers rounded to the decimals of their types."""
    types = PARAMETERS[code]
    rounded = {
        name: value if isinstance(value, str) else _rounded(value, types, name)
        for name, value in params.items()
    }
    reason = Reason(code.value, rounded, cause)
    if checks and (problem := problem_of(reason)):
        raise AssertionError(problem)
    return reason


def text_reason(text: str) -> Reason | None:
    """Return the reason for a text without a code, None for an empty text."""
    return Reason(Code.TEXT.value, {"text": text}) if text else None


def hardware_reason(fault: Reason | str | None) -> Reason | None:
    """Return the reason for a fault that hardware or an old recording may give as a text."""
    if isinstance(fault, str):
        return because(Code.HARDWARE, text=fault) if fault else None
    return fault


def problem_of(reason: Reason) -> str:
    """Return why a reason has an unknown code or other parameters than its table; "" if neither."""
    if reason.code not in PARAMETERS:
        return f"{reason.code}: unknown code"
    types = PARAMETERS[Code(reason.code)]
    allowed = {name.removesuffix("?") for name in types}
    needed = {name for name in types if not name.endswith("?")}
    given = {*reason.params, *(["cause"] if reason.cause is not None else [])}
    if given - allowed or needed - given:
        return f"{reason.code}: has parameters {sorted(given)}, needs {sorted(types)}"
    for name, value in reason.params.items():
        wants_number = type_of(types, name) in DECIMALS
        is_number = not isinstance(value, str)
        if is_number != wants_number or not (isinstance(value, str) or math.isfinite(value)):
            return f"{reason.code}: {name} is {value!r}"
    return "" if reason.cause is None else problem_of(reason.cause)


def type_of(types: Mapping[str, Type], name: str) -> Type | None:
    """Return the type of a parameter in a row of `PARAMETERS`; None for an unknown name."""
    return types.get(name) or types.get(f"{name}?")


def _rounded(value: float, types: Mapping[str, Type], name: str) -> Value:
    decimals = DECIMALS.get(type_of(types, name) or Type.TEXT, 2)
    if not math.isfinite(value):
        return str(value)  # JSON has no such number.
    return round(value, decimals) if decimals else round(value)
