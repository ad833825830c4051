"""Registers of an MX-64 that must have a value before a robot arms, with either protocol.

Sources: https://emanual.robotis.com/docs/en/dxl/mx/mx-64/ and .../mx-64-2/. The firmware of the
board has the same lists, in protocol1.c and protocol2.c.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ServoSetting:
    """One register, and the value with which a servo goes where its goal is, as soon as it can."""

    address: int
    size: int
    """Bytes."""
    wanted: int
    name: str

    def value(self, data: bytes) -> int:
        """Return the value in the bytes of the register; of four, it is signed."""
        return int.from_bytes(data[: self.size], "little", signed=self.size == 4)


SETTINGS: dict[int, tuple[ServoSetting, ...]] = {
    1: (
        ServoSetting(6, 2, 0, "clockwise angle limit"),
        ServoSetting(8, 2, 4095, "counter-clockwise angle limit"),
        ServoSetting(20, 2, 0, "multi-turn offset"),
        ServoSetting(22, 1, 1, "resolution divider"),
        ServoSetting(32, 2, 0, "moving speed"),
        ServoSetting(34, 2, 1023, "torque limit"),
        ServoSetting(70, 1, 0, "torque control mode"),
        ServoSetting(73, 1, 0, "goal acceleration"),
    ),
    2: (
        ServoSetting(10, 1, 0, "drive mode"),
        ServoSetting(11, 1, 3, "operating mode"),
        ServoSetting(20, 4, 0, "homing offset"),
        ServoSetting(48, 4, 4095, "largest position"),
        ServoSetting(52, 4, 0, "smallest position"),
        ServoSetting(108, 4, 0, "profile acceleration"),
        ServoSetting(112, 4, 0, "profile velocity"),
    ),
}
"""By protocol."""


def wrong_setting(servo: str, protocol: int, address: int, found: int) -> str:
    """Sentence about a register of `servo` that has the value `found`, as it was read."""
    setting = next((s for s in SETTINGS[protocol] if s.address == address), None)
    if setting is None:
        return f"{servo}: register {address} is {found}, which must not be"
    value = setting.value(found.to_bytes(4, "little", signed=found < 0))
    return (
        f"{servo}: {setting.name} (register {address}) is {value}, and must be {setting.wanted}; "
        "set it with Dynamixel Wizard"
    )


NO_TORQUE = "no torque: it restarted, or another program switched it off"
