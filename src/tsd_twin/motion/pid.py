"""Proportional, integral and differential control of several errors at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsd_twin.lie import Array


@dataclass(frozen=True, slots=True)
class Gains:
    """Of one error; what comes out is a speed, so their units count seconds."""

    proportional_per_s: float = 0.0
    integral_per_s2: float = 0.0
    differential: float = 0.0
    integral_limit: float = 0.1
    """The most speed that the integral part may give, m/s or rad/s: it must not wind up."""


class Pid:
    """One controller for each of the last axis of the errors; leading dimensions are a batch."""

    def __init__(self, *gains: Gains) -> None:
        self._p = np.array([g.proportional_per_s for g in gains])
        self._i = np.array([g.integral_per_s2 for g in gains])
        self._d = np.array([g.differential for g in gains])
        self._limit = np.array([g.integral_limit for g in gains])
        self._integral: Array = np.zeros(len(gains))
        self._previous: Array | None = None

    def advance(self, error: Array, dt_s: float) -> Array:
        """Return the speeds (..., k) against `error` (..., k), `dt_s` after the last one."""
        previous = error if self._previous is None or dt_s <= 0.0 else self._previous
        self._previous = np.array(error)
        summed = self._integral + self._i * error * dt_s
        self._integral = np.clip(summed, -self._limit, self._limit)
        slope = (error - previous) / dt_s if dt_s > 0.0 else np.zeros_like(error)
        return self._p * error + self._integral + self._d * slope

    def reset(self) -> None:
        """Forget what was."""
        self._integral = np.zeros_like(self._p)
        self._previous = None
