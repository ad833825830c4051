"""Typed parameters of each code.

Parameters are only added, never renamed or given another meaning.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from tsd_twin.messages.code_list import Code


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


def type_of(types: Mapping[str, Type], name: str) -> Type | None:
    """Return the type of a parameter in a row of `PARAMETERS`; None for an unknown name."""
    return types.get(name) or types.get(f"{name}?")
