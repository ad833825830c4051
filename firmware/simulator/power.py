# SPDX-License-Identifier: GPL-3.0-or-later
"""Simulated power: battery, fuses, contactor, USB, and what each wiring makes of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

DRIVING_S, IDLE_S = 0.02, 0.1
"""Time constants of the voltage behind an open contactor, from the capacitors of three speed
controllers: with throttle, and without. Assumed: 1 mF, 0.6 A at cruising speed, 0.1 A at rest."""
DRIVE_LEAST_V = 5.0
"""Speed controllers stop working below this."""
SERVO_LEAST_V = 6.0
"""The same for servos, the 5 V regulator of the board, and the coil of the contactor."""


@dataclass(frozen=True, slots=True)
class Wiring:
    """How the board is fed and reset, and how the contactor is held; by default as drawn."""

    supply: Literal["servos", "usb", "both"] = "servos"
    """What feeds the board: a regulator at the servos' fuse with VBUS cut, USB, or either."""
    auto_reset: bool = False
    """Whether a program that opens the port resets the board."""
    boot_loader_s: float = 0.0
    """Time that the boot loader takes after each reset; no pin is driven meanwhile."""
    coil: Literal["servos", "battery"] = "servos"
    """What feeds the coil of the contactor: the servos' fuse, or the battery itself."""
    signal_timeout_s: float = 1.0
    """Speed controllers without a signal drive on for this long."""


AS_DRAWN = Wiring()


class PowerSimulation:
    """Voltages of battery, servos and drive, and whether the board has power."""

    def __init__(self, wiring: Wiring = AS_DRAWN) -> None:
        self.wiring = wiring
        self.battery_v = 12.0
        self.usb = True
        """Whether the plug is in, and the PC on."""
        self.servo_fuse = True
        self.stop_circuit = True
        """Whether it is closed: both stops let it."""
        self.drive_v = 12.0
        """Behind the contactor."""

    @property
    def servo_v(self) -> float:
        """At the servos."""
        return self.battery_v if self.servo_fuse else 0.0

    @property
    def contactor(self) -> bool:
        """Whether the contactor is closed."""
        coil_v = self.servo_v if self.wiring.coil == "servos" else self.battery_v
        return self.stop_circuit and coil_v >= SERVO_LEAST_V

    @property
    def board(self) -> bool:
        """Whether the board has power."""
        regulated = self.wiring.supply != "usb" and self.servo_v >= SERVO_LEAST_V
        return regulated or (self.wiring.supply != "servos" and self.usb)

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
