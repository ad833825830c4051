"""English text of each code: the only place where reasons are put into words.

A template is part of a sentence, without capital and full stop. `{name}` is a parameter, `{cause}`
the text of the reason behind it. `{name:.1}` has one decimal, `{name:+.1}` always a sign,
`{name:,}` commas between thousands. A part in brackets is omitted if one of its parameters is
missing; the part after its bar is shown instead.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

from tsd_twin.messages.codes import PARAMETERS, Code, Reason, Type, Value, type_of
from tsd_twin.messages.modes import Mode

TEMPLATES: Mapping[Code, str] = {
    Code.TEXT: "{text}",
    Code.HARDWARE: "{text}",
    Code.TAKE_CONTROL_FIRST: "take control first",
    Code.HELD_BY: "{holder} has control",
    Code.DRIVEN_BY: "{holder} drives; ask for control or take over",
    Code.RESERVED_FOR: "control is kept for {operator}, for a moment",
    Code.LEASE_NOT_IN_FORCE: "this lease is not in force",
    Code.NO_OPERATOR: "the robot has no operator: acquire control",
    Code.HAS_CONTROL_ALREADY: "{holder} has control already",
    Code.DENIED_LATELY: "control was kept: ask again in {s} s",
    Code.OTHER_REQUEST: "{asker} asks already",
    Code.NO_REQUEST: "no operator has requested control",
    Code.NO_REQUEST_OF: "{operator} does not ask for control",
    Code.REQUEST_OF: "it is {asker} who asks",
    Code.RELEASED: "released",
    Code.WITHDRAWN: "withdrawn",
    Code.RESERVED: "control is kept for {operator}",
    Code.CONTROL_KEPT: "control is kept",
    Code.HOLDER_ASKED: "{holder} is asked",
    Code.ARM_FIRST: "the robot is disarmed: arm it first",
    Code.STILL_ARMING: "the robot is still arming",
    Code.COMING_TO_REST: "the robot is coming to rest",
    Code.RESET_FIRST: "the robot is {mode}: reset first",
    Code.WRONG_MODE: "the robot is {mode} already",
    Code.NOT_LATCHED: "the robot is {mode}, not stopped",
    Code.RELEASE_FIRST: "let go of the stick first",
    Code.AT_REST_ONLY: "the pose can be set at rest only",
    Code.NO_WHEEL_SPEED: (
        "the wheels of this robot stand when it does, so they have no speed to choose"
    ),
    Code.WHEEL_SPEED_REFUSED: "the wheels turn at {least_rpm:,} to {most_rpm:,} rpm",
    Code.NOT_SERVED: "the node answers this",
    Code.RECORDING: "this is a recording of '{robot}': it cannot be driven or stopped",
    Code.MODE_ONLY: "the robot is {mode}",
    Code.STOP_REQUESTED: "software stop by [{by}|an unnamed client][; before: {cause}]",
    Code.STOP_WITH_TEXT: "{text}[; before: {cause}]",
    Code.ARMED_BY_OPERATOR: "armed by the operator",
    Code.DISARMED_BY_OPERATOR: "disarmed by the operator",
    Code.RESET_BY_OPERATOR: "reset by the operator",
    Code.CONTROL_LOST: "the operator gave up or lost control",
    Code.NO_COMMAND: "no command for {ms} ms (limit {limit_ms} ms)",
    Code.ECHO_UNKNOWN: "the last command was based on no state of the last {limit_ms} ms",
    Code.ECHO_TOO_OLD: "the last command was based on a state {ms} ms old (limit {limit_ms} ms)",
    Code.LOOP_LATE: "the robot's computer was too busy for {ms} ms",
    Code.UNATTENDED: "no operator has had control for {s} s",
    Code.NOT_NEUTRAL: "not armed: the gimbals are not at neutral tilt",
    Code.NOT_AT_SPEED: "not armed: the wheels did not come to speed",
    Code.JOINTS_SILENT: "the joints have not been measured for {ms} ms",
    Code.JOINTS_SILENT_LOOP_LATE: (
        "the joints have not been measured, since the robot's computer was too busy for {ms} ms"
    ),
    Code.FOLLOWING_ERROR: "{joint} does not follow: it is {deg:+.1}° from its set-point",
    Code.DUPLICATE_ID: (
        "another robot with the id '{robot}' is on the bus: end one, or choose another id"
    ),
    Code.RADIO_CONTROL: "the radio control has the robot",
    Code.DEVICE_DISCONNECTED: "{device} is not connected: {text}",
    Code.DEVICE_SILENT: "{device} has not answered for {ms} ms",
    Code.LINE_GARBAGE: "garbage on {line}: {count} broken packets in {s:.2} s",
    Code.SERVOS_SILENT: "{servos}: no answer",
    Code.SERVO_BUS_SILENT: (
        "{servos}: no answer: the wire between them, or the bus, its supply or its fuse"
    ),
    Code.ALL_SERVOS_SILENT: "all servos: no answer: the bus, its supply or its fuse",
    Code.SERVO_ERROR: "{servos}: hardware error",
    Code.SERVO_TOO_HOT: "{servos}: at least {limit_c} °C: let it cool",
    Code.SERVO_FAR: (
        "{servos}: more than 9 degrees from its neutral position, so it gets no torque: turn its "
        "gimbal upright by hand, or correct neutral_step in the calibration"
    ),
    Code.SERVO_LIMP: "{servos}: no torque: it restarted, or another program switched it off",
    Code.SERVO_UNREAD: "{servos}: the settings have not been read yet",
    Code.SERVO_MODEL: "{servo}: model {model} is not one of {known}",
    Code.SERVO_REGISTER: "{servo}: register {register} is {value}, which must not be",
    Code.SERVO_SETTING: (
        "{servo}: {setting} (register {register}) is {value}, and must be {wanted}; set it with "
        "Dynamixel Wizard"
    ),
    Code.GIMBALS_STUCK: "{servos}: {cause}",
    Code.BOARD_TRIP: "the board disarmed itself: {trip}",
    Code.BOARD_REFUSES: "the board does not arm: {what}",
    Code.BOARD_GEOMETRY: (
        "the controller board is built for a robot with {item} {board}, and the robot file says "
        "{robot}: flash firmware that is built for this robot"
    ),
    Code.BOARD_RESTARTED: "the controller board has restarted[: {reset}]",
    Code.BOARD_LOST: "the controller board was lost",
    Code.NODE_HANGS: "the robot node hangs",
    Code.ARMING_OBSTACLE: "{what}",
    Code.BATTERY_TOO_LOW: "the battery is too low to arm: {volts:.1} V",
    Code.ESCS_NOT_READY: "the speed controllers have not had zero throttle for 2 s yet",
    Code.RECEIVER_SILENT: (
        "the radio control is off, or a wire of its receiver: no pulses of {channels}"
    ),
    Code.MANUAL_ON: "the radio control is switched to manual",
    Code.SERVOS_RESTARTED: (
        "{servos}: restarted: the supply failed, or an OpenRB-150 was reset, which cuts it"
    ),
    Code.WATCHDOG_EXPIRED: "{servos}: stopped by the bus watchdog: no packet came in time",
    Code.HEARTBEAT_LOST: "no word of an operator came in time",
    Code.BATTERY_EMPTY: "the battery is empty: {volts:.1} V",
    Code.WHEEL_STUCK: (
        "{wheel} does not follow: it turns at {rpm:,} rpm, and {wanted_rpm:,} rpm are set"
    ),
    Code.WHEELS_SILENT: "no answer from the motor controllers of {wheels}",
    Code.WHEEL_FAULT: "motor controller of {wheel}: {text}",
    Code.WHEEL_TIMED_OUT: (
        "the motor controllers of {wheels} stopped by themselves: no command came in time"
    ),
    Code.CABLE_PLUG: (
        "{servos}: {missed:,} of {total:,} answers missing, those behind it none: its plug"
    ),
    Code.CABLE_WIRE: (
        "{servos}: {missed:,} of {total:,} answers missing together, those before none: the wire "
        "that leads to the first of them"
    ),
    Code.CABLE_BUS: (
        "all servos: {missed:,} of {total:,} answers missing together: the data wire of the bus, "
        "at the adapter"
    ),
    Code.CABLE_SUPPLY: (
        "{servos}: the supply failed for a moment[, at {volts:.1} V]: its supply wire, plug or fuse"
    ),
    Code.CABLE_GROUND: (
        "{servos}: {broken:,} of {total:,} answers broken: the ground or the shield of the data "
        "wire"
    ),
    Code.CABLE_LINE: "the adapter was lost {reconnects:,} times: its USB plug",
    Code.CABLE_RECEIVER: "receiver: {missed:,} drop-outs of {channels}: the wire of these channels",
    Code.NO_ODOMETRY: "no odometry has come on {topic} yet",
    Code.ODOMETRY_OLD: "no odometry newer than {s} s has come on {topic}",
    Code.CMD_VEL_UNSENT: "cmd_vel cannot be published: {text}",
    Code.ROS_NAME_PUBLISHED: (
        "two robots have the ROS name {topic}, which is also published by {node}: end one, or use "
        "another --domain"
    ),
    Code.ROS_NAME_READ: (
        "two robots have the ROS name {topic}, which is also read by {node}: end one, or use "
        "another --domain"
    ),
    Code.MODE_CHANGED: "from {before} to {after}[: {cause}]",
    Code.REQUEST_REFUSED: "request to {request} refused: {cause}",
    Code.COMMAND_DROPPED: "a command was dropped: {cause}",
    Code.LEASE_GRANTED: "{operator} has control",
    Code.LEASE_TAKEN_OVER: "{operator} took control over from {other}[: {text}]",
    Code.LEASE_HANDED_OVER: "{operator} hands control over to {other}",
    Code.LEASE_RELEASED: "{operator} released control",
    Code.LEASE_EXPIRED: "control of {operator} has run out",
    Code.CONTROL_REQUESTED: "{operator} asks {holder} for control",
    Code.REQUEST_DENIED: "{operator} keeps control, for which {asker} has asked",
    Code.REQUEST_WITHDRAWN: "{operator} asks for control no longer",
    Code.REQUEST_EXPIRED: "{holder} has given no answer to {asker}, who asked for control",
    Code.RESERVATION_EXPIRED: "control was kept for {operator}, who did not take it",
    Code.LIMITED: "the limits let {percent} % of the command through",
    Code.SLOWED: "{cause}. The speed limit is {percent} % of the usual",
    Code.BATTERY_LOW: "the battery is low: below {volts} V",
    Code.BATTERY_CHARGED: "the battery has {volts:.1} V: the robot drives as usual",
    Code.SERVO_HOT: "a servo is hot: above {limit_c} °C",
    Code.SERVO_WARM: "a servo has {celsius} °C: at {limit_c} °C the robot slows down",
    Code.SERVOS_COOLED: "the servos have cooled: the robot drives as usual",
    Code.ACTUATOR_SUSPECT: "{actuator} contradicts the others",
    Code.ACTUATORS_CONTRADICT: "one of {actuators} contradicts the others",
    Code.POSE_RESET: (
        "the pose sensor is {metres:.2} m and {deg} degrees off the estimate, at rest: the "
        "estimate is reset to it"
    ),
    Code.DUPLICATE_ID_GONE: "no other robot has the id '{robot}' any more",
    Code.RECORDING_PAUSED: "the recording stands still: {text}. Driving goes on",
    Code.RECORDING_CONTINUES: "the recording goes on: {lost} messages are lost",
    Code.MESSAGES_NOT_RECORDED: (
        "messages that are too long to record, or of too many topics, are left out: {count} so "
        "far in {file}"
    ),
    Code.HAS_CONTROL_NOW: "{holder} has control now",
    Code.OTHER_CLIENT: "another client has control now",
    Code.LEASE_ENDED: "the lease has ended",
    Code.CONTROL_RELEASED: "control was released",
    Code.CONTROL_IS_LOST: "control is lost: {cause}",
    Code.CONTROL_ASKED_FOR: "control is asked for",
    Code.CONTROL_HANDED_OVER: "control is handed over",
    Code.PAGE_SILENT: "your page was silent for {s} s, so it lost control: take it again",
    Code.PAGE_STALLED: "your page stalled for {s} s, so the robot stopped",
    Code.PAGE_NOT_IN_FRONT: "the page is not in front",
    Code.STOP_PRESSED: "software stop",
    Code.OTHER_ROBOT_SHOWN: "another robot is shown",
    Code.ROBOT_SILENT: "[the robot was silent for {s} s|the robot is silent]",
    Code.STOPPED_BY_ITSELF: "the robot has stopped by itself",
    Code.NO_ANSWER: "the robot does not answer",
    Code.REQUEST_UNDER_WAY: "the last request is still under way",
    Code.NO_ROBOT_SHOWN: "no robot is shown",
    Code.NO_ROBOT_THERE: "no robot is there",
    Code.UNKNOWN_ROBOT: "there is no robot {robot}",
    Code.NOT_ASKING: "you do not ask for control",
    Code.VIEWER: "a viewer only watches",
    Code.WATCH_ONLY: "you may only watch this robot",
    Code.RECORDING_SHOWN: "this is a recording: press L for the live robots",
    Code.MARK_UNDER_WAY: "a mark is being written",
    Code.PATH_REPLANNED: "another path is planned",
    Code.PATH_GIVEN_UP: "the path is given up",
    Code.PATH_REFUSED: "{text}",
    Code.PATH_NOT_PLANNED: "the path could not be planned",
    Code.NO_PATHS: "this robot turns in place and follows no path",
    Code.BAD_KEY: "{key} is not the key of one operator",
    Code.BAD_SHAPE: "{detail}",
    Code.NOT_FINITE: "{quantity}",
    Code.NOT_HOLDER: "{operator} sent a command, {holder} holds the lease",
    Code.NO_LEASE: "{operator} sent a command, no operator holds the lease",
    Code.OUT_OF_ORDER: "command {number} came after {latest}",
    Code.UNKNOWN_STATUS: "status {number} was not sent lately",
    Code.SENT_BEFORE_CHANGE: "command was sent before the robot last stopped or was armed",
    Code.TOO_OLD: "command is {s:.2} s old, {limit_s} s are allowed",
    Code.SIGNATURE_MISSING: "the robot requires signed commands: use the key of a listed operator",
    Code.SIGNATURE_WRONG: "the signature is not that of the operator who has control",
    Code.SIGNATURE_REPEATED: "a signed request counts once",
    Code.SIGNATURE_LATE: "the signed request is too old",
    Code.KEY_REFUSED: "the robot's list of operators has no valid key for {operator}",
    Code.OPERATORS_UNUSABLE: "the list of operators was not read again: {text}",
    Code.PATH_NOT_ON_FLOOR: "that is not on the floor",
    Code.PATH_NOT_FINITE: "the pose of the robot, or the heading to turn to, is no number",
    Code.PATH_TOO_LONG: "a path may be {limit_m} long at most",
    Code.ALREADY_THERE: "the robot is there already",
    Code.PATH_BLOCKED: "{robot} is in the way",
    Code.PATH_CANNOT_BE_FOLLOWED: "the route cannot be followed at {at_m}",
    Code.PATH_NO_LONGER_PLANNED: "that path is no longer planned",
    Code.POSE_OUT_OF_DATE: "the robot has not sent its pose for {s}",
    Code.PATH_OUT_OF_DATE: "the robot has moved or its limits have changed; a new path is planned",
    Code.PATH_STARTS_AT_REST: "the robot is not at rest",
    Code.POSE_NOT_FINITE: "the pose is no number",
    Code.OFF_PATH: "the robot is {metres} and {deg} off its path",
    Code.NO_PROGRESS: "the robot makes no progress",
    Code.STAYS_FROM_GOAL: "the robot stays {metres} from its goal",
    Code.SERVO_SLOWER: "the servo of {joint} follows {percent} % slower[, {since}]",
    Code.WHEEL_SLOWER: "{wheel} turns {percent} % slower than its set-point[, {since}]",
    Code.WHEELS_SLOWER: "all wheels turn {percent} % slower than their set-points[, {since}]",
    Code.WHEEL_WEAKER: "{wheel} drives the robot {percent} % less than its set-point[, {since}]",
    Code.WHEELS_WEAKER: (
        "all wheels drive the robot {percent} % less than their set-points[, {since}]"
    ),
    Code.WHEEL_WORN: "{wheel} drives the robot {percent} % less than it turns[, {since}]",
    Code.WHEELS_WORN: "all wheels drive the robot {percent} % less than they turn[, {since}]",
    Code.GIMBAL_ASIDE: "{joint} is {deg:+.1}° off its measured angle[, {since}]",
    Code.BATTERY_LOWER: "the battery has {volts:.1} V, {lost:.1} V less than expected",
    Code.UNKNOWN_PART: (
        "the motion differs from the joints, and the part is not known[: one of {parts}]"
    ),
    Code.UNKNOWN_WHEEL: "wheel speeds differ from their set-points: one of {parts}",
    Code.SPEEDS_UNMEASURED: (
        "wheel speeds are not measured: a slow wheel shows only with a pose sensor or a gyro"
    ),
}

_DRIVE = "the speed controllers have no power: the stop circuit is open"
_HEAT = "a servo is too hot: let it cool"
_KILL = "the kill switch of the radio control is on"
_SERVO = "a servo does not answer or has an error"
_SILENT = "it does not say why"

WORDS: Mapping[Type, Mapping[str, str]] = {
    Type.SERVOS: {"one": "servo", "several": "servos"},
    Type.MODE: {mode.value: mode.value for mode in Mode},
    Type.SINCE: {"start": "from the start"},
    Type.LATCHED: {"stopped": "stopped", "fault": "in a fault"},
    Type.REQUEST: {
        "acquire": "acquire control",
        "renew": "renew control",
        "release": "release control",
        "peek": "peek control",
        "request": "request control",
        "withdraw": "withdraw control",
        "grant": "grant control",
        "deny": "deny control",
        "lease": "lease",
        "arm": "arm",
        "disarm": "disarm",
        "reset": "reset",
        "set_pose": "set_pose",
        "speed": "change the drive speed",
        "stop": "stop",
        "desc": "desc",
    },
    Type.QUANTITY: {
        "twist": "a twist must be finite numbers",
        "pose": "a pose must be finite numbers",
        "max_age_s": "max_age_s must be a finite number",
    },
    Type.DEVICE: {
        "board": "the controller board",
        "servo_bus": "the servo bus",
        "can_bus": "the CAN bus",
        "vesc": "the motor controller",
    },
    Type.LINE: {
        "board": "the serial line",
        "servo_bus": "the serial line of the servos",
        "can_bus": "the CAN bus",
        "vesc": "the serial line of the motor controller",
    },
    Type.TRIP: {
        "none": _SILENT,
        "heartbeat": "no word of an operator came in time",
        "kill": _KILL,
        "rc_lost": "the radio control is lost",
        "rc_took_over": "the radio control took over",
        "servo": _SERVO,
        "watchdog": "its firmware hung and was restarted",
        "battery": "the battery is empty",
        "torque": "a servo lost its torque",
        "hot": _HEAT,
        "line": "the line from the computer lost bytes, and kept the board from its servos",
        "drive": "the stop circuit opened: the speed controllers lost their power",
        "following": "a gimbal does not follow its goal: it is stuck, or its servo is",
        "wheel": "a wheel does not follow its throttle",
        "stopped": "STOP",
    },
    Type.OBSTACLE: {
        "none": _SILENT,
        "esc_hold": "zero throttle must be held for 2 s first",
        "throttle": "the throttles are not zero",
        "goal": "the goals of the gimbals are not neutral",
        "servo": _SERVO,
        "not_neutral": "the gimbals are not at neutral tilt",
        "receiver": "the radio control is off, or a wire of its receiver",
        "kill": _KILL,
        "rc": "the radio control has the robot",
        "setup": "its set-up was not written: neutral positions are unknown",
        "battery": "the battery is too low",
        "setting": "a setting of a servo is not as it must be, or not read yet",
        "torque": "a servo has no torque",
        "hot": _HEAT,
        "drive": _DRIVE,
        "stop_not_proven": "the stop was not tested since power came: press and release it once",
        "rc_without_servos": "the radio control drives with all six servos at the board only",
        "neutral": "a servo is too far from its neutral position to get torque",
        "stopped": "the robot is stopped: reset first",
    },
    Type.RESET_CAUSE: {
        "power_on": "it had lost its power",
        "external": "by its reset pin",
        "brown_out": "its supply had sagged",
        "watchdog": "its firmware hung",
    },
}
"""Text of the words of each type that has a fixed list."""

replacement: Callable[[Reason], str] | None = None
"""Function in place of `sentence`; tests set it to show that no code reads sentences."""


def sentence(reason: Reason) -> str:
    """Return the text of a reason, as part of a sentence; an unknown code is shown as its words."""
    if replacement is not None:
        return replacement(reason)
    return _fill(reason)[0]


def full_sentence(reason: Reason) -> str:
    """Return the text of a reason with a capital, unless an id comes first, and a full stop."""
    if replacement is not None:
        return replacement(reason)
    text, keeps_case = _fill(reason)
    return f"{text if keeps_case else text[:1].upper() + text[1:]}."


_PART = re.compile(r"\[([^]|]*)(?:\|([^]]*))?]")
_SLOT = re.compile(r"\{(\w+)(?::([+,]?)(?:\.(\d))?)?\}")


def _fill(reason: Reason) -> tuple[str, bool]:
    """Return the text of a reason, and whether its first letter belongs to an id."""
    if reason.code not in PARAMETERS:
        return reason.code.replace("_", " "), False
    code = Code(reason.code)
    types = PARAMETERS[code]
    causes = ("", False) if reason.cause is None else _fill(reason.cause)

    def shown(name: str, sign: str, decimals: str) -> str:
        if name == "cause":
            return causes[0]
        return _shown(reason.params.get(name, ""), type_of(types, name), sign, decimals)

    def part(found: re.Match[str]) -> str:
        inside, instead = found[1], found[2] or ""
        has_all = all(shown(slot[1], "", "") for slot in _SLOT.finditer(inside))
        return inside if has_all else instead

    template = _PART.sub(part, TEMPLATES[code])
    text = _SLOT.sub(lambda slot: shown(slot[1], slot[2] or "", slot[3] or ""), template)
    first = _SLOT.match(template)
    if first is None:
        return text, False
    is_id = type_of(types, first[1]) in (Type.OPERATOR, Type.NAME)
    return text, causes[1] if first[1] == "cause" else is_id


def _shown(value: Value, kind: Type | None, sign: str, decimals: str) -> str:
    if isinstance(value, str):
        if kind is Type.SERVOS:
            word = WORDS[kind]["several" if ", " in value else "one"]
            return f"{word} {value}" if value else ""
        words = WORDS.get(kind) if kind is not None else None
        return value if words is None else words.get(value, value.replace("_", " "))
    if sign == ",":
        return f"{round(value):,}"
    if not decimals:
        return str(int(value)) if float(value).is_integer() else repr(value)
    digits = f"{abs(value):.{decimals}f}"
    return ("-" if value < 0.0 else sign) + digits
