# SPDX-License-Identifier: GPL-3.0-or-later
"""Simulated power supply: battery, fuses, contactor and USB, for each wiring."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

DRIVING_S, IDLE_S = 0.02, 0.1
"""Decay time constants of the voltage behind an open contactor, with and without throttle. Assumed
for the capacitors of three speed controllers: 1 mF, 0.6 A at cruising speed, 0.1 A at rest.
"""
DRIVE_LEAST_V = 5.0
"""Minimum voltage of the speed controllers."""
SERVO_LEAST_V = 6.0
"""Minimum voltage of servos, the board's 5 V regulator, and the contactor's coil."""


@dataclass(frozen=True, slots=True)
class Wiring:
    """Wiring of board supply, reset and contactor coil; the default is as drawn."""

    supply: Literal["servos", "usb", "both"] = "servos"
    """Supply of the board: a regulator after the servos' fuse (VBUS cut), USB, or both."""
    auto_reset: bool = False
    """Whether opening the port resets the board."""
    boot_loader_s: float = 0.0
    """Duration of the boot loader after each reset, in which no pin is driven."""
    coil: Literal["servos", "battery"] = "servos"
    """Supply of the contactor's coil: after the servos' fuse, or the battery directly."""
    signal_timeout_s: float = 1.0
    """Time for which speed controllers keep driving without a signal."""


AS_DRAWN = Wiring()


class PowerSimulation:
    """Voltages of battery, servos and drive, and power state of the board."""

    def __init__(self, wiring: Wiring = AS_DRAWN) -> None:
        self.wiring = wiring
        self.battery_v = 12.0
        self.usb = True
        """Whether USB is connected and the PC is on."""
        self.servo_fuse = True
        self.stop_circuit = True
        """Whether both stop switches are closed."""
        self.drive_v = 12.0
        """Voltage behind the contactor."""

    @property
    def servo_v(self) -> float:
        """Voltage at the servos."""
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
        """Whether the speed controllers have enough voltage."""
        return self.drive_v >= DRIVE_LEAST_V

    def advance(self, dt_s: float, *, throttle: bool) -> None:
        """Let time pass."""
        if self.contactor:
            self.drive_v = self.battery_v
        else:
            self.drive_v *= math.exp(-dt_s / (DRIVING_S if throttle else IDLE_S))
