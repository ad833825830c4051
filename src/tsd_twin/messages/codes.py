"""Codes of refusals, stops, faults, events and dropped commands, with their typed parameters.

A robot sends a `Reason`: a code and its parameters. `sentences` has the English text of each code.
Codes and parameters are only added, never renamed or given another meaning; clients show a code
that they do not know as its words.
"""

from __future__ import annotations

import math
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
    """All codes of this version."""

    # Texts of people and libraries.
    TEXT = "text"
    HARDWARE = "hardware"
    # Control: refusals and replies of `srv/lease`.
    TAKE_CONTROL_FIRST = "take_control_first"
    HELD_BY = "held_by"
    DRIVEN_BY = "driven_by"
    RESERVED_FOR = "reserved_for"
    LEASE_NOT_IN_FORCE = "lease_not_in_force"
    NO_OPERATOR = "no_operator"
    HAS_CONTROL_ALREADY = "has_control_already"
    DENIED_LATELY = "denied_lately"
    OTHER_REQUEST = "other_request"
    NO_REQUEST = "no_request"
    NO_REQUEST_OF = "no_request_of"
    REQUEST_OF = "request_of"
    RELEASED = "released"
    WITHDRAWN = "withdrawn"
    RESERVED = "reserved"
    CONTROL_KEPT = "control_kept"
    HOLDER_ASKED = "holder_asked"
    # Refusals of other requests, and of motion.
    ARM_FIRST = "arm_first"
    STILL_ARMING = "still_arming"
    COMING_TO_REST = "coming_to_rest"
    RESET_FIRST = "reset_first"
    WRONG_MODE = "wrong_mode"
    NOT_LATCHED = "not_latched"
    RELEASE_FIRST = "release_first"
    AT_REST_ONLY = "at_rest_only"
    NO_WHEEL_SPEED = "no_wheel_speed"
    WHEEL_SPEED_REFUSED = "wheel_speed_refused"
    NOT_SERVED = "not_served"
    RECORDING = "recording"
    MODE_ONLY = "mode_only"
    # Stops and changes of mode.
    STOP_REQUESTED = "stop_requested"
    STOP_WITH_TEXT = "stop_with_text"
    ARMED_BY_OPERATOR = "armed_by_operator"
    DISARMED_BY_OPERATOR = "disarmed_by_operator"
    RESET_BY_OPERATOR = "reset_by_operator"
    CONTROL_LOST = "control_lost"
    NO_COMMAND = "no_command"
    ECHO_UNKNOWN = "echo_unknown"
    ECHO_TOO_OLD = "echo_too_old"
    LOOP_LATE = "loop_late"
    UNATTENDED = "unattended"
    NOT_NEUTRAL = "not_neutral"
    NOT_AT_SPEED = "not_at_speed"
    # Faults.
    JOINTS_SILENT = "joints_silent"
    JOINTS_SILENT_LOOP_LATE = "joints_silent_loop_late"
    FOLLOWING_ERROR = "following_error"
    DUPLICATE_ID = "duplicate_id"
    # Faults of hardware.
    RADIO_CONTROL = "radio_control"
    DEVICE_DISCONNECTED = "device_disconnected"
    DEVICE_SILENT = "device_silent"
    LINE_GARBAGE = "line_garbage"
    SERVOS_SILENT = "servos_silent"
    SERVO_BUS_SILENT = "servo_bus_silent"
    ALL_SERVOS_SILENT = "all_servos_silent"
    SERVO_ERROR = "servo_error"
    SERVO_TOO_HOT = "servo_too_hot"
    SERVO_FAR = "servo_far"
    SERVO_LIMP = "servo_limp"
    SERVO_UNREAD = "servo_unread"
    SERVO_MODEL = "servo_model"
    SERVO_REGISTER = "servo_register"
    SERVO_SETTING = "servo_setting"
    GIMBALS_STUCK = "gimbals_stuck"
    BOARD_TRIP = "board_trip"
    BOARD_REFUSES = "board_refuses"
    BOARD_GEOMETRY = "board_geometry"
    BOARD_RESTARTED = "board_restarted"
    BOARD_LOST = "board_lost"
    NODE_HANGS = "node_hangs"
    ARMING_OBSTACLE = "arming_obstacle"
    BATTERY_TOO_LOW = "battery_too_low"
    ESCS_NOT_READY = "escs_not_ready"
    RECEIVER_SILENT = "receiver_silent"
    MANUAL_ON = "manual_on"
    SERVOS_RESTARTED = "servos_restarted"
    WATCHDOG_EXPIRED = "watchdog_expired"
    HEARTBEAT_LOST = "heartbeat_lost"
    BATTERY_EMPTY = "battery_empty"
    WHEEL_STUCK = "wheel_stuck"
    WHEELS_SILENT = "wheels_silent"
    WHEEL_FAULT = "wheel_fault"
    WHEEL_TIMED_OUT = "wheel_timed_out"
    CABLE_PLUG = "cable_plug"
    CABLE_WIRE = "cable_wire"
    CABLE_BUS = "cable_bus"
    CABLE_SUPPLY = "cable_supply"
    CABLE_GROUND = "cable_ground"
    CABLE_LINE = "cable_line"
    CABLE_RECEIVER = "cable_receiver"
    # Faults of robots behind ROS.
    NO_ODOMETRY = "no_odometry"
    ODOMETRY_OLD = "odometry_old"
    CMD_VEL_UNSENT = "cmd_vel_unsent"
    ROS_NAME_PUBLISHED = "ros_name_published"
    ROS_NAME_READ = "ros_name_read"
    # Events.
    MODE_CHANGED = "mode_changed"
    REQUEST_REFUSED = "request_refused"
    COMMAND_DROPPED = "command_dropped"
    LEASE_GRANTED = "lease_granted"
    LEASE_TAKEN_OVER = "lease_taken_over"
    LEASE_HANDED_OVER = "lease_handed_over"
    LEASE_RELEASED = "lease_released"
    LEASE_EXPIRED = "lease_expired"
    CONTROL_REQUESTED = "control_requested"
    REQUEST_DENIED = "request_denied"
    REQUEST_WITHDRAWN = "request_withdrawn"
    REQUEST_EXPIRED = "request_expired"
    RESERVATION_EXPIRED = "reservation_expired"
    LIMITED = "limited"
    SLOWED = "slowed"
    BATTERY_LOW = "battery_low"
    BATTERY_CHARGED = "battery_charged"
    SERVO_HOT = "servo_hot"
    SERVO_WARM = "servo_warm"
    SERVOS_COOLED = "servos_cooled"
    ACTUATOR_SUSPECT = "actuator_suspect"
    ACTUATORS_CONTRADICT = "actuators_contradict"
    POSE_RESET = "pose_reset"
    DUPLICATE_ID_GONE = "duplicate_id_gone"
    RECORDING_PAUSED = "recording_paused"
    RECORDING_CONTINUES = "recording_continues"
    MESSAGES_NOT_RECORDED = "messages_not_recorded"
    # Ends of control, seen by a client.
    HAS_CONTROL_NOW = "has_control_now"
    OTHER_CLIENT = "other_client"
    LEASE_ENDED = "lease_ended"
    CONTROL_RELEASED = "control_released"
    # Messages of the dashboard to its pages.
    CONTROL_IS_LOST = "control_is_lost"
    CONTROL_ASKED_FOR = "control_asked_for"
    CONTROL_HANDED_OVER = "control_handed_over"
    PAGE_SILENT = "page_silent"
    PAGE_STALLED = "page_stalled"
    PAGE_NOT_IN_FRONT = "page_not_in_front"
    STOP_PRESSED = "stop_pressed"
    OTHER_ROBOT_SHOWN = "other_robot_shown"
    ROBOT_SILENT = "robot_silent"
    STOPPED_BY_ITSELF = "stopped_by_itself"
    NO_ANSWER = "no_answer"
    REQUEST_UNDER_WAY = "request_under_way"
    NO_ROBOT_SHOWN = "no_robot_shown"
    NO_ROBOT_THERE = "no_robot_there"
    UNKNOWN_ROBOT = "unknown_robot"
    NOT_ASKING = "not_asking"
    VIEWER = "viewer"
    WATCH_ONLY = "watch_only"
    RECORDING_SHOWN = "recording_shown"
    MARK_UNDER_WAY = "mark_under_way"
    PATH_REPLANNED = "path_replanned"
    PATH_GIVEN_UP = "path_given_up"
    PATH_REFUSED = "path_refused"
    PATH_NOT_PLANNED = "path_not_planned"
    NO_PATHS = "no_paths"
    # Messages that do not count.
    BAD_KEY = "bad_key"
    BAD_SHAPE = "bad_shape"
    NOT_FINITE = "not_finite"
    NOT_HOLDER = "not_holder"
    NO_LEASE = "no_lease"
    OUT_OF_ORDER = "out_of_order"
    UNKNOWN_STATUS = "unknown_status"
    SENT_BEFORE_CHANGE = "sent_before_change"
    TOO_OLD = "too_old"
    SIGNATURE_MISSING = "signature_missing"
    SIGNATURE_WRONG = "signature_wrong"
    SIGNATURE_REPEATED = "signature_repeated"
    SIGNATURE_LATE = "signature_late"
    KEY_REFUSED = "key_refused"
    OPERATORS_UNUSABLE = "operators_unusable"
    # Paths.
    PATH_NOT_ON_FLOOR = "path_not_on_floor"
    PATH_NOT_FINITE = "path_not_finite"
    PATH_TOO_LONG = "path_too_long"
    ALREADY_THERE = "already_there"
    PATH_BLOCKED = "path_blocked"
    PATH_CANNOT_BE_FOLLOWED = "path_cannot_be_followed"
    PATH_NO_LONGER_PLANNED = "path_no_longer_planned"
    POSE_OUT_OF_DATE = "pose_out_of_date"
    PATH_OUT_OF_DATE = "path_out_of_date"
    PATH_STARTS_AT_REST = "path_starts_at_rest"
    POSE_NOT_FINITE = "pose_not_finite"
    OFF_PATH = "off_path"
    NO_PROGRESS = "no_progress"
    STAYS_FROM_GOAL = "stays_from_goal"
    # Shadow twin.
    SERVO_SLOWER = "servo_slower"
    WHEEL_SLOWER = "wheel_slower"
    WHEELS_SLOWER = "wheels_slower"
    WHEEL_WEAKER = "wheel_weaker"
    WHEELS_WEAKER = "wheels_weaker"
    WHEEL_WORN = "wheel_worn"
    WHEELS_WORN = "wheels_worn"
    GIMBAL_ASIDE = "gimbal_aside"
    BATTERY_LOWER = "battery_lower"
    UNKNOWN_PART = "unknown_part"
    UNKNOWN_WHEEL = "unknown_wheel"
    SPEEDS_UNMEASURED = "speeds_unmeasured"


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
    SINCE = "since"
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

_MS_OF_LIMIT = {"ms": Type.MS, "limit_ms": Type.MS}
_OPERATOR = {"operator": Type.OPERATOR}
_HOLDER = {"holder": Type.OPERATOR}
_ASKER = {"asker": Type.OPERATOR}
_SERVOS = {"servos": Type.SERVOS}
_TEXT = {"text": Type.TEXT}
_LOST = {"percent": Type.PERCENT, "since?": Type.SINCE}
_WHEEL_LOST = {"wheel": Type.NAME, **_LOST}

PARAMETERS: Mapping[Code, Mapping[str, Type]] = {
    Code.TEXT: _TEXT,
    Code.HARDWARE: _TEXT,
    Code.TAKE_CONTROL_FIRST: {},
    Code.HELD_BY: _HOLDER,
    Code.DRIVEN_BY: _HOLDER,
    Code.RESERVED_FOR: _OPERATOR,
    Code.LEASE_NOT_IN_FORCE: {},
    Code.NO_OPERATOR: {},
    Code.HAS_CONTROL_ALREADY: _HOLDER,
    Code.DENIED_LATELY: {"s": Type.S},
    Code.OTHER_REQUEST: _ASKER,
    Code.NO_REQUEST: {},
    Code.NO_REQUEST_OF: _OPERATOR,
    Code.REQUEST_OF: _ASKER,
    Code.RELEASED: {},
    Code.WITHDRAWN: {},
    Code.RESERVED: _OPERATOR,
    Code.CONTROL_KEPT: {},
    Code.HOLDER_ASKED: _HOLDER,
    Code.ARM_FIRST: {},
    Code.STILL_ARMING: {},
    Code.COMING_TO_REST: {},
    Code.RESET_FIRST: {"mode": Type.LATCHED},
    Code.WRONG_MODE: {"mode": Type.MODE},
    Code.NOT_LATCHED: {"mode": Type.MODE},
    Code.RELEASE_FIRST: {},
    Code.AT_REST_ONLY: {},
    Code.NO_WHEEL_SPEED: {},
    Code.WHEEL_SPEED_REFUSED: {"least_rpm": Type.RPM, "most_rpm": Type.RPM},
    Code.NOT_SERVED: {},
    Code.RECORDING: {"robot": Type.NAME},
    Code.MODE_ONLY: {"mode": Type.MODE},
    Code.STOP_REQUESTED: {"by?": Type.OPERATOR, "cause?": Type.CAUSE},
    Code.STOP_WITH_TEXT: {"by?": Type.OPERATOR, "text": Type.TEXT, "cause?": Type.CAUSE},
    Code.ARMED_BY_OPERATOR: {},
    Code.DISARMED_BY_OPERATOR: {},
    Code.RESET_BY_OPERATOR: {},
    Code.CONTROL_LOST: {},
    Code.NO_COMMAND: _MS_OF_LIMIT,
    Code.ECHO_UNKNOWN: {"limit_ms": Type.MS},
    Code.ECHO_TOO_OLD: _MS_OF_LIMIT,
    Code.LOOP_LATE: {"ms": Type.MS},
    Code.UNATTENDED: {"s": Type.S},
    Code.NOT_NEUTRAL: {},
    Code.NOT_AT_SPEED: {},
    Code.JOINTS_SILENT: {"ms": Type.MS},
    Code.JOINTS_SILENT_LOOP_LATE: {"ms": Type.MS},
    Code.FOLLOWING_ERROR: {"joint": Type.NAME, "deg": Type.DEG},
    Code.DUPLICATE_ID: {"robot": Type.NAME},
    Code.RADIO_CONTROL: {},
    Code.DEVICE_DISCONNECTED: {"device": Type.DEVICE, "text": Type.TEXT},
    Code.DEVICE_SILENT: {"device": Type.DEVICE, "ms": Type.MS},
    Code.LINE_GARBAGE: {"line": Type.LINE, "count": Type.COUNT, "s": Type.S},
    Code.SERVOS_SILENT: _SERVOS,
    Code.SERVO_BUS_SILENT: _SERVOS,
    Code.ALL_SERVOS_SILENT: {},
    Code.SERVO_ERROR: _SERVOS,
    Code.SERVO_TOO_HOT: {"servos": Type.SERVOS, "limit_c": Type.CELSIUS},
    Code.SERVO_FAR: _SERVOS,
    Code.SERVO_LIMP: _SERVOS,
    Code.SERVO_UNREAD: _SERVOS,
    Code.SERVO_MODEL: {"servo": Type.SERVOS, "model": Type.COUNT, "known": Type.NAME},
    Code.SERVO_REGISTER: {"servo": Type.SERVOS, "register": Type.COUNT, "value": Type.COUNT},
    Code.SERVO_SETTING: {
        "servo": Type.SERVOS,
        "setting": Type.NAME,
        "register": Type.COUNT,
        "value": Type.COUNT,
        "wanted": Type.NAME,
    },
    Code.GIMBALS_STUCK: {"servos": Type.SERVOS, "cause": Type.CAUSE},
    Code.BOARD_TRIP: {"trip": Type.TRIP},
    Code.BOARD_REFUSES: {"what": Type.OBSTACLE},
    Code.BOARD_GEOMETRY: {"item": Type.NAME, "board": Type.NAME, "robot": Type.NAME},
    Code.BOARD_RESTARTED: {"reset?": Type.RESET_CAUSE},
    Code.BOARD_LOST: {},
    Code.NODE_HANGS: {},
    Code.ARMING_OBSTACLE: {"what": Type.OBSTACLE},
    Code.BATTERY_TOO_LOW: {"volts": Type.VOLT},
    Code.ESCS_NOT_READY: {},
    Code.RECEIVER_SILENT: {"channels": Type.NAME},
    Code.MANUAL_ON: {},
    Code.SERVOS_RESTARTED: _SERVOS,
    Code.WATCHDOG_EXPIRED: _SERVOS,
    Code.HEARTBEAT_LOST: {},
    Code.BATTERY_EMPTY: {"volts": Type.VOLT},
    Code.WHEEL_STUCK: {"wheel": Type.NAME, "rpm": Type.RPM, "wanted_rpm": Type.RPM},
    Code.WHEELS_SILENT: {"wheels": Type.NAME},
    Code.WHEEL_FAULT: {"wheel": Type.NAME, "text": Type.TEXT},
    Code.WHEEL_TIMED_OUT: {"wheels": Type.NAME},
    Code.CABLE_PLUG: {"servos": Type.SERVOS, "missed": Type.COUNT, "total": Type.COUNT},
    Code.CABLE_WIRE: {"servos": Type.SERVOS, "missed": Type.COUNT, "total": Type.COUNT},
    Code.CABLE_BUS: {"missed": Type.COUNT, "total": Type.COUNT},
    Code.CABLE_SUPPLY: {"servos": Type.SERVOS, "volts?": Type.VOLT},
    Code.CABLE_GROUND: {"servos": Type.SERVOS, "broken": Type.COUNT, "total": Type.COUNT},
    Code.CABLE_LINE: {"reconnects": Type.COUNT},
    Code.CABLE_RECEIVER: {"channels": Type.NAME, "missed": Type.COUNT},
    Code.NO_ODOMETRY: {"topic": Type.NAME},
    Code.ODOMETRY_OLD: {"topic": Type.NAME, "s": Type.S},
    Code.CMD_VEL_UNSENT: _TEXT,
    Code.ROS_NAME_PUBLISHED: {"topic": Type.NAME, "node": Type.NAME},
    Code.ROS_NAME_READ: {"topic": Type.NAME, "node": Type.NAME},
    Code.MODE_CHANGED: {"before": Type.MODE, "after": Type.MODE, "cause?": Type.CAUSE},
    Code.REQUEST_REFUSED: {"request": Type.REQUEST, "cause": Type.CAUSE},
    Code.COMMAND_DROPPED: {"cause": Type.CAUSE},
    Code.LEASE_GRANTED: _OPERATOR,
    Code.LEASE_TAKEN_OVER: {
        "operator": Type.OPERATOR,
        "other": Type.OPERATOR,
        "text?": Type.TEXT,
    },
    Code.LEASE_HANDED_OVER: {"operator": Type.OPERATOR, "other": Type.OPERATOR},
    Code.LEASE_RELEASED: _OPERATOR,
    Code.LEASE_EXPIRED: _OPERATOR,
    Code.CONTROL_REQUESTED: {"operator": Type.OPERATOR, "holder": Type.OPERATOR},
    Code.REQUEST_DENIED: {"operator": Type.OPERATOR, "asker": Type.OPERATOR},
    Code.REQUEST_WITHDRAWN: _OPERATOR,
    Code.REQUEST_EXPIRED: {"holder": Type.OPERATOR, "asker": Type.OPERATOR},
    Code.RESERVATION_EXPIRED: _OPERATOR,
    Code.LIMITED: {"percent": Type.PERCENT},
    Code.SLOWED: {"percent": Type.PERCENT, "cause": Type.CAUSE},
    Code.BATTERY_LOW: {"volts": Type.VOLT},
    Code.BATTERY_CHARGED: {"volts": Type.VOLT},
    Code.SERVO_HOT: {"limit_c": Type.CELSIUS},
    Code.SERVO_WARM: {"celsius": Type.CELSIUS, "limit_c": Type.CELSIUS},
    Code.SERVOS_COOLED: {},
    Code.ACTUATOR_SUSPECT: {"actuator": Type.NAME},
    Code.ACTUATORS_CONTRADICT: {"actuators": Type.NAME},
    Code.POSE_RESET: {"metres": Type.M, "deg": Type.DEG},
    Code.DUPLICATE_ID_GONE: {"robot": Type.NAME},
    Code.RECORDING_PAUSED: _TEXT,
    Code.RECORDING_CONTINUES: {"lost": Type.COUNT},
    Code.MESSAGES_NOT_RECORDED: {"count": Type.COUNT, "file": Type.NAME},
    Code.HAS_CONTROL_NOW: _HOLDER,
    Code.OTHER_CLIENT: {},
    Code.LEASE_ENDED: {},
    Code.CONTROL_RELEASED: {},
    Code.CONTROL_IS_LOST: {"cause": Type.CAUSE},
    Code.CONTROL_ASKED_FOR: {},
    Code.CONTROL_HANDED_OVER: {},
    Code.PAGE_SILENT: {"s": Type.S},
    Code.PAGE_STALLED: {"s": Type.S},
    Code.PAGE_NOT_IN_FRONT: {},
    Code.STOP_PRESSED: {},
    Code.OTHER_ROBOT_SHOWN: {},
    Code.ROBOT_SILENT: {"s?": Type.S},
    Code.STOPPED_BY_ITSELF: {},
    Code.NO_ANSWER: {},
    Code.REQUEST_UNDER_WAY: {},
    Code.NO_ROBOT_SHOWN: {},
    Code.NO_ROBOT_THERE: {},
    Code.UNKNOWN_ROBOT: {"robot": Type.NAME},
    Code.NOT_ASKING: {},
    Code.VIEWER: {},
    Code.WATCH_ONLY: {},
    Code.RECORDING_SHOWN: {},
    Code.MARK_UNDER_WAY: {},
    Code.PATH_REPLANNED: {},
    Code.PATH_GIVEN_UP: {},
    Code.PATH_REFUSED: _TEXT,
    Code.PATH_NOT_PLANNED: {},
    Code.NO_PATHS: {},
    Code.BAD_KEY: {"key": Type.NAME},
    Code.BAD_SHAPE: {"detail": Type.TEXT},
    Code.NOT_FINITE: {"quantity": Type.QUANTITY},
    Code.NOT_HOLDER: {"operator": Type.OPERATOR, "holder": Type.OPERATOR},
    Code.NO_LEASE: _OPERATOR,
    Code.OUT_OF_ORDER: {"number": Type.COUNT, "latest": Type.COUNT},
    Code.UNKNOWN_STATUS: {"number": Type.COUNT},
    Code.SENT_BEFORE_CHANGE: {},
    Code.TOO_OLD: {"s": Type.S, "limit_s": Type.S},
    Code.SIGNATURE_MISSING: {},
    Code.SIGNATURE_WRONG: {},
    Code.SIGNATURE_REPEATED: {},
    Code.SIGNATURE_LATE: {},
    Code.KEY_REFUSED: _OPERATOR,
    Code.OPERATORS_UNUSABLE: _TEXT,
    Code.PATH_NOT_ON_FLOOR: {},
    Code.PATH_NOT_FINITE: {},
    Code.PATH_TOO_LONG: {"limit_m": Type.M},
    Code.ALREADY_THERE: {},
    Code.PATH_BLOCKED: {"robot": Type.NAME},
    Code.PATH_CANNOT_BE_FOLLOWED: {"at_m": Type.M},
    Code.PATH_NO_LONGER_PLANNED: {},
    Code.POSE_OUT_OF_DATE: {"s": Type.S},
    Code.PATH_OUT_OF_DATE: {},
    Code.PATH_STARTS_AT_REST: {},
    Code.POSE_NOT_FINITE: {},
    Code.OFF_PATH: {"metres": Type.M, "deg": Type.DEG},
    Code.NO_PROGRESS: {},
    Code.STAYS_FROM_GOAL: {"metres": Type.M},
    Code.SERVO_SLOWER: {"joint": Type.NAME, **_LOST},
    Code.WHEEL_SLOWER: _WHEEL_LOST,
    Code.WHEELS_SLOWER: _LOST,
    Code.WHEEL_WEAKER: _WHEEL_LOST,
    Code.WHEELS_WEAKER: _LOST,
    Code.WHEEL_WORN: _WHEEL_LOST,
    Code.WHEELS_WORN: _LOST,
    Code.GIMBAL_ASIDE: {"joint": Type.NAME, "deg": Type.DEG, "since?": Type.SINCE},
    Code.BATTERY_LOWER: {"volts": Type.VOLT, "lost": Type.VOLT},
    Code.UNKNOWN_PART: {"parts?": Type.NAME},
    Code.UNKNOWN_WHEEL: {"parts": Type.NAME},
    Code.SPEEDS_UNMEASURED: {},
}
"""Parameters of each code, by name; a name that ends with "?" may be missing."""

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
