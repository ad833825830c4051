# SPDX-License-Identifier: GPL-3.0-or-later
"""Simulated power: battery, contactor, and the voltage behind it."""

from __future__ import annotations

import math

DRIVING_S, IDLE_S = 0.02, 0.1
"""Time constants of the voltage behind an open contactor, from the capacitors of three speed
controllers: with throttle, and without. Assumed: 1 mF, 0.6 A at cruising speed, 0.1 A at rest."""
DRIVE_LEAST_V = 5.0
"""Speed controllers stop working below this."""


class PowerSimulation:
    """Voltages of the battery and of the drive."""

    def __init__(self) -> None:
        self.battery_v = 12.0
        self.contactor = True
        """Whether it is closed: both stops of the stop circuit let it."""
        self.drive_v = 12.0
        """Behind the contactor."""

    @property
    def driven(self) -> bool:
        """Whether the speed controllers work."""
        return self.drive_v >= DRIVE_LEAST_V

    def advance(self, dt_s: float, *, throttle: bool) -> None:
        """Let time pass."""
        if self.contactor:
            self.drive_v = self.battery_v
        else:
            self.drive_v *= math.exp(-dt_s / (DRIVING_S if throttle else IDLE_S))
