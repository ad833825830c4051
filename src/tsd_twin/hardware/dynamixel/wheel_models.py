"""Servo models for wheels: Dynamixel X in velocity mode, with the settings that wheels need.

All writable registers that matter in velocity mode are compared with the factory defaults, the
velocity limit with the speed of the robot's wheels. Source:
https://emanual.robotis.com/docs/en/dxl/x/, tables of each model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from tsd_twin.hardware.dynamixel.servo_models import ServoModel, ServoSetting, exactly

VELOCITY_MODE = 1
"""Operating mode (register 11) of a wheel."""
VELOCITY_UNIT_RAD_PER_S = 0.229 * math.pi / 30.0
"""Unit of goal, present velocity and velocity limit: 0.229 rpm."""
VELOCITY_LIMIT = 44
"""Register of the largest goal that a servo accepts; larger ones are refused, not limited."""
VELOCITY_LIMIT_SIZE = 4
LOAD_PERCENT = 0.1
"""Unit of register 126 of a servo that reports its load in place of a current."""


@dataclass(frozen=True, slots=True)
class WheelModel:
    """Servo model as a wheel."""

    servo: ServoModel
    """Its `current_ma` is 0 if register 126 is the load."""
    temperature_limit_c: int
    """The servo switches its torque off above this temperature."""
    velocity_limit: int
    """Factory value, in units of `VELOCITY_UNIT_RAD_PER_S`."""

    @property
    def reports_load(self) -> bool:
        """Whether register 126 is the load, in units of `LOAD_PERCENT`, in place of a current."""
        return self.servo.current_ma == 0.0


def _model(
    number: int,
    name: str,
    *,
    current_ma: float = 0.0,
    current_limit: int = 0,
    volts: tuple[int, int],
    temperature_c: int = 80,
    velocity_limit: int,
    gains: tuple[int, int] = (1920, 100),
    more: tuple[ServoSetting, ...] = (),
    shutdown: int = 52,
) -> WheelModel:
    """`gains` are the factory values of the velocity control, integral first."""
    settings = [
        ServoSetting(9, 1, 0, 250, "return delay time"),
        exactly(10, 1, 0, "drive mode"),
        exactly(11, 1, VELOCITY_MODE, "operating mode"),
        exactly(12, 1, 255, "secondary id"),
        exactly(13, 1, 2, "protocol type"),
        exactly(31, 1, temperature_c, "temperature limit"),
        exactly(32, 2, volts[1], "max voltage limit"),
        exactly(34, 2, volts[0], "min voltage limit"),
        exactly(36, 2, 885, "PWM limit"),
        exactly(63, 1, shutdown, "shutdown"),
        exactly(68, 1, 2, "status return level"),
        exactly(76, 2, gains[0], "velocity I gain"),
        exactly(78, 2, gains[1], "velocity P gain"),
        exactly(100, 2, 885, "goal PWM"),
        exactly(108, 4, 0, "profile acceleration"),
        *more,
    ]
    if current_limit:
        settings.append(exactly(38, 2, current_limit, "current limit"))
    by_address = tuple(sorted(settings, key=lambda setting: setting.address))
    servo = ServoModel(number, name, 2, current_ma, by_address)
    return WheelModel(servo, temperature_c, velocity_limit)


def _x330(number: int, name: str, velocity_limit: int) -> WheelModel:
    return _model(
        number, name, current_ma=1.0, current_limit=910, volts=(55, 140), temperature_c=70,
        velocity_limit=velocity_limit, gains=(1200, 40), more=(exactly(62, 1, 255, "PWM slope"),),
    )  # fmt: skip


def _xl330(number: int, name: str, velocity_limit: int, gains: tuple[int, int]) -> WheelModel:
    return _model(
        number, name, current_ma=1.0, current_limit=1750, volts=(35, 70), temperature_c=70,
        velocity_limit=velocity_limit, gains=gains, shutdown=53,
        more=(exactly(62, 1, 140, "PWM slope"),),
    )  # fmt: skip


def _xm(number: int, name: str, current_limit: int, velocity_limit: int) -> WheelModel:
    return _model(
        number, name, current_ma=2.69, current_limit=current_limit, volts=(95, 160),
        velocity_limit=velocity_limit,
    )  # fmt: skip


WHEEL_MODELS: dict[int, WheelModel] = {
    model.servo.number: model
    for model in (
        _model(
            1060, "XL430-W250", volts=(60, 140), temperature_c=72, velocity_limit=265,
            gains=(1000, 100),
        ),
        _model(1070, "XC430-W150", volts=(60, 160), velocity_limit=460),
        _model(1080, "XC430-W240", volts=(60, 160), velocity_limit=306),
        _xm(1020, "XM430-W350", 1193, 200),
        _xm(1030, "XM430-W210", 1193, 330),
        _xm(1120, "XM540-W270", 2047, 128),
        _xm(1130, "XM540-W150", 2047, 230),
        _xl330(1190, "XL330-M077", 1620, (400, 40)),
        _xl330(1200, "XL330-M288", 445, (1600, 180)),
        _x330(1210, "XC330-T181", 510),
        _x330(1220, "XC330-T288", 320),
    )
}  # fmt: skip
"""Servo models for wheels, by model number."""
SERVOS: dict[int, ServoModel] = {number: it.servo for number, it in WHEEL_MODELS.items()}
