"""moteus motor controllers: register frames of CAN FD. Pure.

Source: mjbots/moteus, docs/protocol/can.md and registers.md. Each command carries the time after
which the controller stops without another one. That time-out latches until a stop command.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum
from struct import calcsize, pack, unpack_from

from tsd_twin.hardware.motors.base import Frame, MotorState


class Mode(IntEnum):
    """Modes in register 0."""

    STOPPED = 0
    FAULT = 1
    POSITION = 10
    TIMEOUT = 11
    BRAKE = 15


MODE, POSITION, VELOCITY, TORQUE = 0, 1, 2, 3
VOLTAGE, TEMPERATURE, FAULT = 0x0D, 0x0E, 0x0F
WATCHDOG = 0x27
TIMEOUT_S = 0.1
"""Time-out in each command."""
SCALES: dict[int, tuple[float, float]] = {
    MODE: (1.0, 1.0),
    POSITION: (0.01, 0.0001),
    VELOCITY: (0.1, 0.00025),
    TORQUE: (0.5, 0.01),
    VOLTAGE: (0.5, 0.1),
    TEMPERATURE: (1.0, 0.1),
    FAULT: (1.0, 1.0),
}
"""Unit of a register as int8 and as int16; revolutions, Hz, Nm, V, °C."""
FAULTS = {
    32: "calibration fault",
    33: "motor driver fault",
    34: "over voltage",
    35: "encoder fault",
    36: "motor not configured",
    37: "PWM cycle overrun",
    38: "over temperature",
    39: "outside limit",
    40: "under voltage",
    41: "configuration changed",
    42: "no valid commutation encoder",
    43: "no valid output encoder",
    44: "driver not enabled",
}
_FORMATS = ("b", "h", "i", "f")
_WRITE, _READ, _REPLY, _NOP = 0x00, 0x10, 0x20, 0x50
_SIZES = (*range(9), 12, 16, 20, 24, 32, 48, 64)
"""Data sizes of a CAN FD frame."""
_WANTS_REPLY = 0x8000
_QUERY = bytes((_READ | 4, 4, MODE, _READ | 3, VOLTAGE, _READ | 0x0C | 1, WATCHDOG))
"""int16: mode, position, velocity, torque; int8: voltage, temperature, fault; float: time-out."""


def padded(data: bytes) -> bytes:
    """Pad data to the next size of a CAN FD frame."""
    size = next(size for size in _SIZES if size >= len(data))
    return data + bytes((_NOP,)) * (size - len(data))


def command(device: int, body: bytes) -> Frame:
    """Return a frame from 0 to a controller, with a request for a reply."""
    identifier = _WANTS_REPLY | device
    return Frame(identifier, padded(body), extended=True, fd=True)


def write_mode(mode: Mode) -> bytes:
    """Return the subframe that writes the mode."""
    return bytes((_WRITE | 1, MODE, mode))


def position_mode(velocity_hz: float, timeout_s: float = TIMEOUT_S) -> bytes:
    """Return the subframes that turn a motor at a velocity, for at most `timeout_s`."""
    velocity = bytes((_WRITE | 0x0C | 2, 0x20)) + pack("<ff", math.nan, velocity_hz)
    watchdog = bytes((_WRITE | 0x0C | 1, WATCHDOG)) + pack("<f", timeout_s)
    return write_mode(Mode.POSITION) + velocity + watchdog


def parse_reply(data: bytes) -> dict[int, float] | None:
    """Return the registers in a reply, in SI units and revolutions; None if it is malformed."""
    values: dict[int, float] = {}
    at = 0
    while at < len(data):
        kind = data[at]
        at += 1
        if kind == _NOP:
            continue
        if not _REPLY <= kind < _REPLY + 16:
            return None
        letter, count = _FORMATS[kind >> 2 & 3], kind & 3
        if not count:
            count, at = (data[at], at + 1) if at < len(data) else (0, at)
        if at >= len(data):
            return None
        first, at = data[at], at + 1
        layout = f"<{count}{letter}"
        if at + calcsize(layout) > len(data):
            return None
        for i, raw in enumerate(unpack_from(layout, data, at)):
            values[first + i] = _value(first + i, letter, raw)
        at += calcsize(layout)
    return values


def _value(register: int, letter: str, raw: float) -> float:
    int8, int16 = SCALES.get(register, (1.0, 1.0))
    return raw * {"b": int8, "h": int16}.get(letter, 1.0)


class MoteusMotors:
    """`Motors` that are moteus controllers with encoders at the wheels."""

    def __init__(self, ids: Sequence[int], signs: Sequence[int]) -> None:
        self.states = [MotorState() for _ in ids]
        self._ids = list(ids)
        self._signs = list(signs)

    def questions(self) -> Sequence[Frame]:
        """Stop each controller; ask for its state and write the time-out."""
        watchdog = bytes((_WRITE | 0x0C | 1, WATCHDOG)) + pack("<f", TIMEOUT_S)
        body = write_mode(Mode.STOPPED) + watchdog + _QUERY
        return [command(device, body) for device in self._ids]

    def problem(self, i: int) -> str:
        """Return why motor `i` must not be armed, or ""."""
        state = self.states[i]
        if state.heard_s < 0.0:
            return "it does not answer"
        if not abs(state.timeout_s - TIMEOUT_S) < 0.001:
            return f"its time-out reads {state.timeout_s:g} s after {TIMEOUT_S:g} s was written"
        return state.fault

    def drive(self, speeds: Sequence[float]) -> Sequence[Frame]:
        """Return the frames that turn the wheels."""
        return [
            command(device, position_mode(sign * speed / (2.0 * math.pi)) + _QUERY)
            for device, sign, speed in zip(self._ids, self._signs, speeds, strict=True)
        ]

    def stop(self, *, armed: bool) -> Sequence[Frame]:
        """Brake; once disarmed, stop, which clears faults and time-outs."""
        if not armed:
            return self.questions()
        body = write_mode(Mode.BRAKE) + _QUERY
        return [command(device, body) for device in self._ids]

    def receive(self, frame: Frame, now_s: float) -> None:
        """Update the states."""
        source, target = frame.id >> 8 & 0x7F, frame.id & 0x7F
        if target != 0 or source not in self._ids or frame.id & _WANTS_REPLY:
            return
        values = parse_reply(frame.data)
        if values is None or MODE not in values or VELOCITY not in values:
            return
        i = self._ids.index(source)
        state, mode = self.states[i], round(values[MODE])
        state.heard_s = now_s
        state.speed_rad_per_s = self._signs[i] * 2.0 * math.pi * values[VELOCITY]
        state.voltage_v = values.get(VOLTAGE, math.nan)
        state.temperature_c = values.get(TEMPERATURE, math.nan)
        state.timeout_s = values.get(WATCHDOG, math.nan)
        state.timed_out = mode == Mode.TIMEOUT
        code = round(values.get(FAULT, 0.0))
        state.fault = FAULTS.get(code, f"fault {code}") if mode == Mode.FAULT else ""
