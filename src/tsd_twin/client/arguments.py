"""Argument validation for public methods, run before any state changes (pure).

Each function raises a `ClientError` that names the argument; those for paths a `PathError`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from tsd_twin.client.errors import ClientError
from tsd_twin.errors import PathError
from tsd_twin.lie import Array
from tsd_twin.messages.cdr import BASE, ODOM


def check_numbers(**values: object) -> None:
    """Check that all arguments are finite numbers."""
    for name, value in values.items():
        if not math.isfinite(_number(name, value)):
            raise ClientError(f"{name} must be finite, not {value}", "not_finite")


def check_optional(**values: object) -> None:
    """Check that all arguments are finite numbers or None, like `check_numbers`."""
    check_numbers(**{name: value for name, value in values.items() if value is not None})


def check_duration(**values: object) -> None:
    """Check that all arguments are finite, non-negative durations in seconds."""
    check_numbers(**values)
    for name, value in values.items():
        if _number(name, value) < 0.0:
            raise ClientError(f"{name} must be at least 0, not {value}", "negative")


def check_frame(frame: object) -> None:
    """Check a frame name."""
    if frame not in (BASE, ODOM):
        raise ClientError(f"frame must be '{BASE}' or '{ODOM}', not {frame!r}", "bad_frame")


def check_text(**values: object) -> None:
    """Check that all arguments are strings or None."""
    for name, value in values.items():
        if value is not None and not isinstance(value, str):
            raise ClientError(f"{name} must be a string, not {value!r}", "no_string")


def checked_points(points: Sequence[Sequence[float]]) -> Array:
    """Return path points as an (n, 2) array in metres."""
    wrong = PathError("a path is a list of (x, y) in metres")
    if isinstance(points, str):
        raise wrong
    try:
        line = np.array([[_number("a point", number) for number in point] for point in points])
    except (TypeError, ValueError, ClientError):
        raise wrong from None
    if line.ndim != 2 or line.shape[1] != 2:
        raise wrong
    if not np.isfinite(line).all():
        raise PathError("the points of a path must be finite")
    return line


def checked_twist(twist: Sequence[float] | Array, frame: str) -> Array:
    """Return a twist as (3,), m/s and rad/s in `frame`."""
    check_frame(frame)
    try:
        numbers = np.array([_number("a twist", number) for number in twist])
    except (TypeError, ClientError):
        numbers = np.empty(0)
    if numbers.shape != (3,) or not all(map(math.isfinite, numbers.tolist())):
        raise ClientError(f"a twist is three finite numbers, not {twist}", "bad_twist")
    return numbers


def _number(name: str, value: Any) -> float:
    try:
        if isinstance(value, str | bytes):
            raise TypeError
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise ClientError(f"{name} must be a number, not {value!r}", "no_number") from None
