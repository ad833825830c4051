"""Verdicts on readings of a robot; pure."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsd_twin.hardware.commissioning.findings import Finding, FindingCode, found
from tsd_twin.lie import Array

OPEN_V = 5.0
"""Maximum voltage behind an open contactor."""
CLOSED_FRACTION = 0.9
"""Minimum voltage behind a closed contactor, as a fraction of the battery's."""
BATTERY_ERROR_V = 0.4
"""Permitted difference from the meter."""
BRANCH_DROP_V = 0.8
"""Permitted drop of a servo or controller without load."""
HAND_DEG = 0.4
"""Minimum deflection by hand against the torque of a servo."""
SWING_DEG = 3.0
SPEED_ERROR = 0.15
"""Permitted relative error of a wheel's speed."""
OPEN_LOOP_ERROR = 0.4
"""Permitted relative error of a speed controller without measurement."""
_COUNTERS = ("crc_errors", "rx_errors", "servo_errors")


@dataclass(frozen=True, slots=True)
class Reading:
    """One reading of the robot."""

    status: Mapping[str, Any]
    """Hardware section of the status."""
    joints: Array
    """Measured joints (n,): rad or rad/s; NaN if not measured."""
    fault: str = ""


def measured(value: float, least: float, most: float, unit: str, hint: str) -> Finding | None:
    """Judge a value typed by a person; NaN and infinity fail."""
    if math.isfinite(value) and least <= value <= most:
        return None
    shown = value if math.isfinite(value) else 0.0
    params: dict[str, str | float] = {"value": shown, "unit": unit, "least": least, "most": most}
    return found(FindingCode.MEASURED, **params, hint=hint)


def battery(readings: Sequence[Reading], meter_v: float) -> Finding | None:
    """Compare the measured battery voltage with a meter."""
    value = _battery_v(readings)
    if abs(value - meter_v) <= BATTERY_ERROR_V:
        return None
    shown = 0.0 if math.isnan(value) else value
    return found(FindingCode.BATTERY_DIFFERS, value=shown, wanted=meter_v)


def board_supply(readings: Sequence[Reading]) -> Finding | None:
    """Judge the board's supply; zero is a board that has not measured it."""
    value = float(readings[-1].status.get("supply_v", 0.0))
    return None if 4.75 <= value <= 5.25 else found(FindingCode.BOARD_SUPPLY, value=value)


def drive_open(readings: Sequence[Reading]) -> Finding | None:
    """Judge the voltage behind an open contactor, after it has decayed."""
    value = float(readings[-1].status.get("drive_v", math.inf))
    return found(FindingCode.DRIVE_ON, value=value) if not value < OPEN_V else None


def drive_closed(readings: Sequence[Reading]) -> Finding | None:
    """Judge the voltage behind a closed contactor."""
    value = float(readings[-1].status.get("drive_v", 0.0))
    if math.isfinite(value) and value >= CLOSED_FRACTION * _battery_v(readings):
        return None
    return found(FindingCode.DRIVE_OFF, value=value)


def receiver(readings: Sequence[Reading]) -> Finding | None:
    """Judge whether all channels have pulses."""
    pulses = readings[-1].status.get("rc_us", [0])
    return None if all(pulses) else found(FindingCode.NO_RECEIVER)


def servos(names: Sequence[str]) -> Callable[[Sequence[Reading]], Finding | None]:
    """Judge whether all servos answer with the battery's voltage."""

    def verdict(readings: Sequence[Reading]) -> Finding | None:
        state = readings[-1].status.get("servos", {})
        alive = state.get("alive", [False] * len(names))
        silent = [name for name, there in zip(names, alive, strict=True) if not there]
        if silent:
            return found(FindingCode.SERVO_SILENT, names=", ".join(silent))
        return _branches(names, state["voltage_v"], readings, FindingCode.SERVO_SUPPLY)

    return verdict


def controllers(names: Sequence[str]) -> Callable[[Sequence[Reading]], Finding | None]:
    """Judge the supply of motor controllers on CAN."""

    def verdict(readings: Sequence[Reading]) -> Finding | None:
        wheels = readings[-1].status["wheels"]
        volts = [math.nan if v is None else v for v in wheels["voltage_v"]]
        return _branches(names, volts, readings, FindingCode.CONTROLLER_SUPPLY)

    return verdict


def _branches(
    names: Sequence[str], volts: Sequence[float], readings: Sequence[Reading], code: FindingCode
) -> Finding | None:
    wanted = _battery_v(readings) if code is not FindingCode.SERVO_SUPPLY else max(volts)
    for name, value in zip(names, volts, strict=True):
        if not value >= wanted - BRANCH_DROP_V:
            shown = 0.0 if math.isnan(value) else value
            return found(code, name=name, value=shown, wanted=wanted)
    return None


def line(readings: Sequence[Reading]) -> Finding | None:
    """Judge whether counters of line errors stay the same."""
    first, last = readings[0].status, readings[-1].status
    for name in _COUNTERS:
        before, after = (it.get("counters", {}).get(name, 0) for it in (first, last))
        if after != before:
            return found(FindingCode.LINE_ERRORS, count=(after - before) % 65536, name=name)
    for link in ("link", "servo_link"):
        before, after = (it.get(link, {}).get("broken", 0) for it in (first, last))
        if after > before:
            return found(FindingCode.LINE_ERRORS, count=after - before, name=link)
    return None


def faults(readings: Sequence[Reading]) -> Finding | None:
    """Return the latest fault of the robot."""
    fault = readings[-1].fault
    return found(FindingCode.FAULT, text=fault) if fault else None


def warnings(readings: Sequence[Reading]) -> Finding | None:
    """Return the latest warnings of the robot."""
    texts = readings[-1].status.get("warnings", [])
    return found(FindingCode.WARNING, text="; ".join(texts)) if texts else None


def moved(
    names: Sequence[str], joint: int, before: Array, after: Array, least_deg: float
) -> Finding | None:
    """Judge which gimbal moved, and in which direction; other entries of `names` are wheels."""
    change = np.degrees(np.nan_to_num(after - before))
    most = int(np.argmax(np.abs(change)))
    name, value = names[joint], float(change[joint])
    if abs(change[most]) < least_deg:
        return found(FindingCode.JOINT_STILL, name=name, value=value, least=least_deg)
    if most != joint:
        return found(FindingCode.JOINT_SWAPPED, name=name, other=names[most])
    return None if value > 0.0 else found(FindingCode.JOINT_REVERSED, name=name)


def sensed(wheel: int, readings: Sequence[Reading]) -> Finding | None:
    """Judge which speed sensors sent pulses while a person turned one wheel."""
    ages = [it.status["wheels"]["age_ms"] for it in readings]
    pulsed = [i for i, column in enumerate(zip(*ages, strict=True), 1) if set(column) - {None}]
    return None if pulsed == [wheel] else wrong_sensor(wheel, pulsed)


def wrong_sensor(wheel: int, seen: Sequence[int]) -> Finding:
    """Return the finding that a wheel turned, and the sensors of other wheels measured it."""
    sensors = ", ".join(f"sensor {i}" for i in seen) or "no sensor"
    return found(FindingCode.WHEEL_SENSOR, name=str(wheel), seen=sensors)


def turned(wheel: int, seen: int, *, along: bool) -> Finding | None:
    """Judge which wheel a person saw turning, and in which direction."""
    if seen != wheel:
        return found(FindingCode.WHEEL_SWAPPED, name=str(wheel), other=str(seen))
    return None if along else found(FindingCode.WHEEL_REVERSED, name=str(wheel))


def speed(wheel: int, rpm: float, wanted_rpm: float, *, measured: bool) -> Finding | None:
    """Judge the speed that a person counted or measured with a tachometer."""
    error = SPEED_ERROR if measured else OPEN_LOOP_ERROR
    if math.isfinite(rpm) and abs(rpm - abs(wanted_rpm)) <= error * abs(wanted_rpm):
        return None
    shown = rpm if math.isfinite(rpm) else 0.0
    return found(FindingCode.WHEEL_SPEED, name=str(wheel), value=shown, wanted=abs(wanted_rpm))


def _battery_v(readings: Sequence[Reading]) -> float:
    value = readings[-1].status.get("battery_v")
    return math.nan if value is None else float(value)
