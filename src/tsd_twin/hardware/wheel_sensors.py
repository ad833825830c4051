"""Wheel speeds measured by the controller board: request, joint speeds, stuck wheel, status."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tsd_twin.hardware.dynamixel.control_table import (
    BOARD_ID,
    Telemetry,
    Trip,
    Wheels,
    WheelSensor,
)
from tsd_twin.hardware.dynamixel.packets import protocol2
from tsd_twin.lie import Array
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.robots import RPM, SingularityDescription

_KINDS = {"hall": WheelSensor.HALL, "telemetry": WheelSensor.TELEMETRY}
_OLDEST_MS = 255
_SILENT = {
    WheelSensor.HALL: "the speed sensor of {} has sent no pulse since the board started: its speed "
    "comes from the curve of the motor; look at the wheel, and the sensor's wires",
    WheelSensor.TELEMETRY: "no telemetry from the speed controller of {}: its speed comes from the "
    "curve of the motor; look at its telemetry wire, and switch automatic telemetry on",
}


class WheelSensors:
    """Sensors of a robot's wheels, if it has any."""

    def __init__(self, robot: SingularityDescription, names: Sequence[str]) -> None:
        """`names`: wheels in the order of the speed controllers."""
        described = robot.wheel_sensor
        self._names = list(names)
        self.kind = WheelSensor.NONE if described is None else _KINDS[described.kind]
        self.pulses = 1 if described is None else described.per_turn
        """Pulses per turn, or pole pairs."""

    @property
    def request(self) -> bytes:
        """Packet that reads the telemetry, and with sensors the wheels behind it."""
        return protocol2.read(BOARD_ID, Telemetry.ADDRESS, self._size)

    def parse(self, data: bytes) -> tuple[Telemetry, Wheels] | None:
        """Return the blocks of a response, or None if it has another size."""
        if len(data) != self._size:
            return None
        end = Telemetry.LAYOUT.size
        return Telemetry.unpack(data[:end]), Wheels.unpack(data[end:]) if self.kind else Wheels()

    def speeds(self, wheels: Wheels) -> Array:
        """Return the wheel speeds (k,), rad/s; NaN if not measured."""
        rpm = [
            rpm if wheels.wheel_measured >> i & 1 else np.nan
            for i, rpm in enumerate(wheels.wheel_rpm[: len(self._names)])
        ]
        return np.array(rpm, dtype=float) * RPM

    def stuck(self, telemetry: Telemetry, wheels: Wheels) -> Reason | None:
        """Return the reason for the wheel that caused the last trip, or None."""
        if telemetry.trip != Trip.WHEEL or not 0 < wheels.wheel_stuck <= len(self._names):
            return None
        return because(
            Code.WHEEL_STUCK,
            wheel=self._names[wheels.wheel_stuck - 1],
            rpm=float(wheels.stuck_rpm),
            wanted_rpm=float(wheels.stuck_wanted_rpm),
        )

    def status(self, wheels: Wheels) -> dict[str, Any]:
        """Return the section of the status, JSON-serializable; empty without sensors."""
        if not self.kind:
            return {}
        count = len(self._names)
        measured = [bool(wheels.wheel_measured >> i & 1) for i in range(count)]
        rpm = zip(wheels.wheel_rpm[:count], measured, strict=True)
        return {
            "wheels": {
                "measured": measured,
                "rpm": [it if known else None for it, known in rpm],
                "age_ms": [it if it < _OLDEST_MS else None for it in wheels.wheel_age[:count]],
            }
        }

    def warnings(self, wheels: Wheels) -> list[str]:
        """Return a warning for each sensor that is silent although other wheels turn."""
        if not self.kind or not any(wheels.wheel_rpm):
            return []
        return [
            _SILENT[self.kind].format(name)
            for i, name in enumerate(self._names)
            if not wheels.wheel_measured >> i & 1
        ]

    @property
    def _size(self) -> int:
        return Telemetry.LAYOUT.size + (Wheels.LAYOUT.size if self.kind else 0)
