"""Codes of the errors that commissioning finds, and the table of their sentences."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

import msgspec

Value = str | float


class FindingCode(StrEnum):
    """Code of a wiring error."""

    MEASURED = "measured"
    NOT_CONFIRMED = "not_confirmed"
    DECLINED = "declined"
    NO_CONNECTION = "no_connection"
    FAULT = "fault"
    WARNING = "warning"
    NO_STATUS = "no_status"
    BATTERY_DIFFERS = "battery_differs"
    BOARD_SUPPLY = "board_supply"
    DRIVE_ON = "drive_on"
    DRIVE_OFF = "drive_off"
    LINE_ERRORS = "line_errors"
    SERVO_SILENT = "servo_silent"
    SERVO_SUPPLY = "servo_supply"
    CONTROLLER_SUPPLY = "controller_supply"
    NO_RECEIVER = "no_receiver"
    JOINT_STILL = "joint_still"
    JOINT_SWAPPED = "joint_swapped"
    JOINT_REVERSED = "joint_reversed"
    WHEEL_SWAPPED = "wheel_swapped"
    WHEEL_REVERSED = "wheel_reversed"
    WHEEL_SPEED = "wheel_speed"
    WHEEL_SENSOR = "wheel_sensor"


SENTENCES: Mapping[FindingCode, str] = {
    FindingCode.MEASURED: "measured {value:g} {unit}, must be {least:g} to {most:g} {unit}: {hint}",
    FindingCode.NOT_CONFIRMED: "not confirmed: {hint}",
    FindingCode.DECLINED: "the motion was declined; nothing moved",
    FindingCode.NO_CONNECTION: (
        "{text}; check power, ids (two devices with one id disturb each other), "
        "wires, rate and the bus termination"
    ),
    FindingCode.FAULT: "the robot reports a fault: {text}",
    FindingCode.WARNING: "the robot reports: {text}",
    FindingCode.NO_STATUS: "no measurement arrives: check the line",
    FindingCode.BATTERY_DIFFERS: (
        "the robot measures {value:.1f} V where the meter shows {wanted:.1f} V: check the divider"
    ),
    FindingCode.BOARD_SUPPLY: (
        "the board runs at {value:.2f} V, must be 4.75 to 5.25 V: check the regulator"
    ),
    FindingCode.DRIVE_ON: (
        "{value:.1f} V behind the contactor that should be open: welded contacts, the wire of A1 "
        "before the contacts, or a contactor that closes without the start button"
    ),
    FindingCode.DRIVE_OFF: (
        "{value:.1f} V behind the contactor that should be closed: check its coil, the seal-in "
        "contact, the fuse of the drive and the wire of A1"
    ),
    FindingCode.LINE_ERRORS: "{count:g} errors in {name}: check the wires, pull-up and grounds",
    FindingCode.SERVO_SILENT: "{names} not answering: check the data wire, power and id",
    FindingCode.SERVO_SUPPLY: (
        "{name} has {value:.1f} V and the battery {wanted:.1f} V: check its branch and its fuse"
    ),
    FindingCode.CONTROLLER_SUPPLY: (
        "the controller of wheel {name} has {value:.1f} V and the battery {wanted:.1f} V: check "
        "its branch and its fuse"
    ),
    FindingCode.NO_RECEIVER: "no pulses from the receiver: check its power, wire and inverter",
    FindingCode.JOINT_STILL: "{name} moved {value:.1f} deg, must be {least:g} deg or more",
    FindingCode.JOINT_SWAPPED: "{name} was moved, and {other} is measured: exchange their ids",
    FindingCode.JOINT_REVERSED: "{name} is measured in the wrong direction: set `reversed`",
    FindingCode.WHEEL_SWAPPED: "wheel {other} turned instead of wheel {name}: exchange them",
    FindingCode.WHEEL_REVERSED: (
        "wheel {name} turned against its arrow: exchange two motor wires, or set `reversed`"
    ),
    FindingCode.WHEEL_SPEED: (
        "wheel {name} turned at {value:.0f} rpm, must be {wanted:.0f} rpm: check pole pairs, gear "
        "ratio and throttle range"
    ),
    FindingCode.WHEEL_SENSOR: (
        "wheel {name} turned, and {seen} measured it: exchange the wires of the sensors, or check "
        "wire and magnet of sensor {name}"
    ),
}


class Finding(msgspec.Struct, frozen=True):
    """Error found by a step."""

    code: FindingCode
    params: dict[str, Value] = {}

    def sentence(self) -> str:
        """Return the sentence of the table."""
        return SENTENCES[self.code].format(**self.params)


def found(code: FindingCode, **params: Value) -> Finding:
    """Return a finding with its parameters."""
    return Finding(code, params)
