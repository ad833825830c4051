"""Registers of an MX-64 with Protocol 2.0, as far as they are used.

https://emanual.robotis.com/docs/en/dxl/mx/mx-64-2/
"""

from __future__ import annotations

from dataclasses import dataclass
from struct import Struct

RETURN_DELAY = 9
"""Units of 2 us between question and answer; 250 as it comes."""
OPERATING_MODE = 11
POSITION_MODE = 3
TORQUE_ENABLE = 64
"""While it is 1, addresses below 64 cannot be written."""
BUS_WATCHDOG = 98
"""Units of 20 ms without a request until the servo stops; 255 then, until 0 is written."""
BUS_WATCHDOG_S = 0.02
GOAL_POSITION = 116
GOAL = Struct("<i")
PRESENT = 126
_LAYOUT = Struct("<hiiiiHB")
PRESENT_SIZE = _LAYOUT.size
_CURRENT_A = 3.36e-3
_VELOCITY_STEP_PER_S = 0.229 / 60.0 * 4096.0


@dataclass(frozen=True, slots=True)
class Present:
    """Measurements of a servo."""

    position: int
    """Steps."""
    velocity_step_per_s: float
    current_a: float
    voltage_v: float
    temperature_c: int

    @staticmethod
    def unpack(data: bytes) -> Present:
        """Return the measurements decoded from the `PRESENT_SIZE` bytes from `PRESENT` on."""
        current, velocity, position, _, _, voltage, temperature = _LAYOUT.unpack(data)
        return Present(
            position,
            velocity * _VELOCITY_STEP_PER_S,
            current * _CURRENT_A,
            voltage / 10.0,
            temperature,
        )
