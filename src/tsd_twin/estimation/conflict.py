"""Whether the measured joints agree with one another.

A gimbal that jams or lags contradicts the others. What is not measured cannot be seen: a wheel that
slides on the floor moves no gimbal, so this is no slip sensor; a wheel that turns at another speed
than assumed shows only where speeds are measured; a mis-homed gimbal reports what it was told.
"""

from __future__ import annotations

import math

import numpy as np

from tsd_twin.lie import Array

_SMOOTHING_S = 0.1
_SUSPICION = 5.0
"""Residuals above this many standard deviations are evidence."""


class ConflictMonitor:
    """Smoothed residual of the forward kinematics against what the known noise explains."""

    def __init__(self, sigma_mps: float) -> None:
        self._sigma_mps = sigma_mps
        self._residual: Array | None = None
        self.residual_mps = 0.0
        """Root mean square over the contacts."""

    def advance(self, residual: Array, dt_s: float) -> None:
        """Take in the residual (m,) of one period."""
        if self._residual is None:
            self._residual = np.zeros(len(residual))
        share = 1.0 - math.exp(-dt_s / _SMOOTHING_S)
        self._residual = self._residual + share * (residual - self._residual)
        self.residual_mps = math.sqrt(float(self._residual @ self._residual) / len(residual))

    @property
    def evident(self) -> bool:
        """Whether the conflict is more than the known noise explains."""
        return self.residual_mps > _SUSPICION * self._sigma_mps

    @property
    def residual(self) -> Array | None:
        """(m,): smoothed, m/s."""
        return self._residual
