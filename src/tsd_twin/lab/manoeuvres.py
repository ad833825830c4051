"""Twists over time that experiments drive."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

# Manoeuvres of a healthy robot.

_STICK_S = 0.35
_STRAIGHT_S, _PAUSE_S = 3.0, 1.0
TwistAt = Callable[[float], tuple[float, float, float]]


def _wander(random: np.random.Generator) -> TwistAt:
    x, y, turn = random.uniform(0.0, 2.0 * np.pi, 3)

    def twist(t_s: float) -> tuple[float, float, float]:
        return (
            0.6 * math.cos(0.3 * t_s + x),
            0.6 * math.sin(0.8 * t_s + y),
            math.cos(0.7 * t_s + turn),
        )

    return twist


def _full_stick(random: np.random.Generator) -> TwistAt:
    """Return full speed and full turn rate in changing random directions."""
    key = int(random.integers(2**32))

    def twist(t_s: float) -> tuple[float, float, float]:
        fresh = np.random.default_rng([key, int(t_s / _STICK_S + 1e-6)])
        angle, side = fresh.uniform(0.0, 2.0 * np.pi), fresh.choice([-1.0, 1.0])
        return (math.cos(angle), math.sin(angle), 3.0 * side)

    return twist


def _straight(random: np.random.Generator) -> TwistAt:
    """Start, drive at 1 m/s and stop, in a new direction each time."""
    key = int(random.integers(2**32))

    def twist(t_s: float) -> tuple[float, float, float]:
        leg, within_s = divmod(t_s, _STRAIGHT_S + _PAUSE_S)
        angle = np.random.default_rng([key, int(leg)]).uniform(0.0, 2.0 * np.pi)
        on = float(within_s < _STRAIGHT_S)
        return (on * math.cos(angle), on * math.sin(angle), 0.0)

    return twist


MANOEUVRES: dict[str, Callable[[np.random.Generator], TwistAt]] = {
    "wander": _wander,
    "full stick": _full_stick,
    "straight 1 m/s": _straight,
}
