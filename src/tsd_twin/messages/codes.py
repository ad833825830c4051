"""Reason for a refusal, stop, fault, event or dropped command: a code with typed parameters.

A robot sends a `Reason`: a code and its parameters. `sentences` has the English text of each code.
Clients show a code that they do not know as its words.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TypeAlias

import msgspec

from tsd_twin.messages.code_list import Code
from tsd_twin.messages.code_parameters import DECIMALS, PARAMETERS, Type, type_of

__all__ = [
    "DECIMALS",
    "PARAMETERS",
    "Code",
    "Reason",
    "Type",
    "Value",
    "because",
    "hardware_reason",
    "problem_of",
    "text_reason",
    "type_of",
]

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


def _rounded(value: float, types: Mapping[str, Type], name: str) -> Value:
    decimals = DECIMALS.get(type_of(types, name) or Type.TEXT, 2)
    if not math.isfinite(value):
        return str(value)  # JSON has no such number.
    return round(value, decimals) if decimals else round(value)
