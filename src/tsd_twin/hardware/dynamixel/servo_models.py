"""Servo models for gimbals, and the settings with which a servo moves straight to its goal.

`firmware/servo_models.h` is generated from this module. All writable registers that
can change the motion are compared with the factory defaults; a test lists the others. Source:
https://emanual.robotis.com/docs/en/dxl/.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from tsd_twin.messages.codes import Code, Reason, because

ProtocolVersion = Literal[1, 2]
MODEL_NUMBER = 0
"""Register of the model number in both protocols; two bytes."""
LONGEST_READ: dict[ProtocolVersion, int] = {1: 10, 2: 21}
"""Maximum setting bytes in one response, by protocol; same as the board's other reads."""


@dataclass(frozen=True, slots=True)
class ServoSetting:
    """Register and its allowed values."""

    address: int
    size: int
    """Size in bytes."""
    least: int
    most: int
    name: str

    def value(self, data: bytes) -> int:
        """Return the value in the register's bytes; four-byte registers are signed."""
        return int.from_bytes(data[: self.size], "little", signed=self.size == 4)

    def allows(self, value: int) -> bool:
        """Return whether the value is allowed."""
        return self.least <= value <= self.most

    @property
    def wanted(self) -> str:
        """Allowed value or range as text."""
        return str(self.least) if self.least == self.most else f"{self.least} to {self.most}"


def exactly(address: int, size: int, value: int, name: str) -> ServoSetting:
    """Return a setting with a single allowed value."""
    return ServoSetting(address, size, value, value, name)


_RETURN_DELAY = (25, 250)
"""Units of 2 us. The board listens after 50 us; values above the default exceed its cycle."""


@dataclass(frozen=True, slots=True)
class ServoModel:
    """Servo model with a specific firmware."""

    number: int
    name: str
    protocol: ProtocolVersion
    current_ma: float
    """Measured current per unit, mA."""
    settings: tuple[ServoSetting, ...]
    """Settings by address."""

    def reads(self) -> list[tuple[ServoSetting, ...]]:
        """Return groups of adjacent settings, each returned by one read."""
        groups: list[list[ServoSetting]] = []
        for setting in self.settings:
            group = groups[-1] if groups else []
            if (
                group
                and group[-1].address + group[-1].size == setting.address
                and span(group) + setting.size <= LONGEST_READ[self.protocol]
            ):
                group.append(setting)
            else:
                groups.append([setting])
        return [tuple(group) for group in groups]


def span(group: Sequence[ServoSetting]) -> int:
    """Return the size of adjacent settings, bytes."""
    return sum(setting.size for setting in group)


_MX64_1 = ServoModel(
    310,
    "MX-64",
    1,
    4.5,
    (
        ServoSetting(5, 1, *_RETURN_DELAY, "return delay time"),
        exactly(6, 2, 0, "clockwise angle limit"),
        exactly(8, 2, 4095, "counter-clockwise angle limit"),
        exactly(11, 1, 80, "temperature limit"),
        exactly(12, 1, 60, "lowest voltage limit"),
        ServoSetting(13, 1, 160, 240, "highest voltage limit"),
        exactly(14, 2, 1023, "max torque"),
        exactly(16, 1, 2, "status return level"),
        exactly(18, 1, 36, "shutdown"),
        exactly(20, 2, 0, "multi-turn offset"),
        exactly(22, 1, 1, "resolution divider"),
        exactly(26, 1, 0, "D gain"),
        exactly(27, 1, 0, "I gain"),
        exactly(28, 1, 32, "P gain"),
        exactly(32, 2, 0, "moving speed"),
        exactly(34, 2, 1023, "torque limit"),
        exactly(48, 2, 0, "punch"),
        exactly(70, 1, 0, "torque control mode"),
        exactly(71, 2, 0, "goal torque"),
        exactly(73, 1, 0, "goal acceleration"),
    ),
)


def _protocol2(
    current_limit: int, velocity_limit: int, p_gain: int, *more: ServoSetting
) -> tuple[ServoSetting, ...]:
    """Return the settings common to all models with Protocol 2.0.

    `velocity_limit` is the lowest factory value of any firmware version; higher values do not
    limit.
    """
    settings = (
        *more,
        ServoSetting(9, 1, *_RETURN_DELAY, "return delay time"),
        exactly(10, 1, 0, "drive mode"),
        exactly(11, 1, 3, "operating mode"),
        exactly(12, 1, 255, "secondary id"),
        exactly(13, 1, 2, "protocol type"),
        exactly(20, 4, 0, "homing offset"),
        exactly(31, 1, 80, "temperature limit"),
        exactly(32, 2, 160, "max voltage limit"),
        exactly(34, 2, 95, "min voltage limit"),
        exactly(36, 2, 885, "PWM limit"),
        exactly(38, 2, current_limit, "current limit"),
        ServoSetting(44, 4, velocity_limit, 1023, "velocity limit"),
        exactly(48, 4, 4095, "largest position"),
        exactly(52, 4, 0, "smallest position"),
        exactly(63, 1, 52, "shutdown"),
        exactly(68, 1, 2, "status return level"),
        exactly(76, 2, 1920, "velocity I gain"),
        exactly(78, 2, 100, "velocity P gain"),
        exactly(80, 2, 0, "position D gain"),
        exactly(82, 2, 0, "position I gain"),
        exactly(84, 2, p_gain, "position P gain"),
        exactly(88, 2, 0, "feedforward 2nd gain"),
        exactly(90, 2, 0, "feedforward 1st gain"),
        exactly(98, 1, 0, "bus watchdog"),
        exactly(100, 2, 885, "goal PWM"),
        exactly(108, 4, 0, "profile acceleration"),
        exactly(112, 4, 0, "profile velocity"),
    )
    return tuple(sorted(settings, key=lambda setting: setting.address))


_XM430_W350 = ServoModel(1020, "XM430-W350", 2, 2.69, _protocol2(1193, 200, 800))
MODELS: dict[int, ServoModel] = {
    model.number: model
    for model in (
        _MX64_1,
        ServoModel(
            311,
            "MX-64(2.0)",
            2,
            3.36,
            _protocol2(1941, 285, 850, exactly(40, 4, 32767, "acceleration limit")),
        ),
        _XM430_W350,
        replace(_XM430_W350, number=1030, name="XM430-W210", settings=_protocol2(1193, 330, 800)),
        replace(_XM430_W350, number=1120, name="XM540-W270", settings=_protocol2(2047, 128, 800)),
        replace(_XM430_W350, number=1130, name="XM540-W150", settings=_protocol2(2047, 230, 800)),
    )
}
"""Servo models by model number."""


def wrong_setting(
    servo: str, model: int, address: int, found: int, models: Mapping[int, ServoModel] | None = None
) -> Reason:
    """Return the reason for a register of `servo` with the value `found` as read.

    `models` are the supported ones, by default `MODELS`.
    """
    models = MODELS if models is None else models
    if address == MODEL_NUMBER:
        known = ", ".join(f"{known.name} ({known.number})" for known in models.values())
        return because(Code.SERVO_MODEL, servo=servo, model=found, known=known)
    settings = models[model].settings if model in models else ()
    setting = next((s for s in settings if s.address == address), None)
    if setting is None:
        return because(Code.SERVO_REGISTER, servo=servo, register=address, value=found)
    value = setting.value(found.to_bytes(4, "little", signed=found < 0))
    return because(
        Code.SERVO_SETTING,
        servo=servo,
        setting=setting.name,
        register=address,
        value=value,
        wanted=setting.wanted,
    )
