"""English sentences of reasons; `codes` has the template of each code, this module the words."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

from tsd_twin.messages.codes import PARAMETERS, Code, Reason, Type, Value, type_of
from tsd_twin.messages.modes import Mode

_DRIVE = "the speed controllers have no power: the stop circuit is open"
_HEAT = "a servo is too hot: let it cool"
_KILL = "the kill switch of the radio control is on"
_SERVO = "a servo does not answer or has an error"
_SILENT = "it does not say why"

WORDS: Mapping[Type, Mapping[str, str]] = {
    Type.SERVOS: {"one": "servo", "several": "servos"},
    Type.MODE: {mode.value: mode.value for mode in Mode},
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
    Type.DEVICE: {"board": "the controller board", "servo_bus": "the servo bus"},
    Type.LINE: {"board": "the serial line", "servo_bus": "the serial line of the servos"},
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

    template = _PART.sub(part, code.template)
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
