"""Simulated Dynamixel X servos as wheels.

Behaviour follows the control tables of the e-Manual: EEPROM is locked while torque is on, a goal
above the velocity limit is refused, torque goes off above the temperature limit, and the bus
watchdog counts while torque is on, is fed by any packet, stops the servo, and refuses goals until
it is cleared.
The e-Manual does not document the goal after clearing the watchdog; this servo resumes it, which is
the worst case.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from tsd_twin.hardware.dynamixel.packets import Decoder, Instruction, Packet, protocol2
from tsd_twin.hardware.dynamixel.wheel_models import VELOCITY_UNIT_RAD_PER_S, WHEEL_MODELS

RANGE_ERROR, LENGTH_ERROR, LIMIT_ERROR, ACCESS_ERROR = 4, 5, 6, 7
ALERT = 0x80
REBOOT = 0x08
OVERHEATED, OVERLOADED = 0x04, 0x20
EXPIRED = 255
FOLLOW_S, COAST_S = 0.02, 0.1
"""Time constants of the speed control and of a wheel without torque."""
_GOAL, _WATCHDOG, _TORQUE, _ERROR = 104, 98, 64, 70
_READ_ONLY = (*range(7), 69, 70, *range(120, 147))
RESERVED = frozenset(
    (*range(14, 20), 28, 29, 30, 66, 67, *range(71, 76), 86, 87, *range(92, 98), 99)
)
_RAM = {68: (1, 2), 100: (2, 885)}


@dataclass
class XServo:
    """Simulated servo."""

    id: int
    model: int = 1060
    dead: bool = False
    """Injected fault: loose data wire; the servo has power, receives nothing and keeps turning."""
    mute: bool = False
    """Injected fault: the servo obeys, but its responses are lost."""
    powered: bool = True
    jammed: bool = False
    volts: float = 11.1
    temperature_c: float = 35.0
    speed_rad_per_s: float = 0.0
    angle_rad: float = 0.0
    memory: bytearray = field(default_factory=lambda: bytearray(256))
    heard_s: float = 0.0
    """Time of the last received packet, which feeds the watchdog."""

    def __post_init__(self) -> None:
        for at, size, value in ((0, 2, self.model), (6, 1, 46), (7, 1, self.id), (8, 1, 3)):
            self.put(at, size, value)
        for setting in WHEEL_MODELS[self.model].servo.settings:
            self.put(setting.address, setting.size, setting.most)
        self.put(44, 4, WHEEL_MODELS[self.model].velocity_limit)
        self._reset()

    def _reset(self) -> None:
        self.memory[64:] = bytes(256 - 64)
        for setting in WHEEL_MODELS[self.model].servo.settings:
            if setting.address >= 64:
                self.put(setting.address, setting.size, setting.most)

    def get(self, at: int, size: int) -> int:
        return int.from_bytes(self.memory[at : at + size], "little", signed=size == 4)

    def put(self, at: int, size: int, value: int) -> None:
        self.memory[at : at + size] = (value % (1 << 8 * size)).to_bytes(size, "little")

    @property
    def torque(self) -> bool:
        return bool(self.memory[_TORQUE])

    @property
    def goal(self) -> int:
        return self.get(_GOAL, 4)

    @property
    def expired(self) -> bool:
        return self.memory[_WATCHDOG] == EXPIRED

    @property
    def driven(self) -> bool:
        """Whether the motor follows commands."""
        return self.powered and self.torque and not self.expired and self.goal != 0

    def restart(self) -> None:
        """Interrupt the power."""
        self._reset()

    def set_power(self, on: bool) -> None:
        self.powered = on
        if not on:
            self._reset()

    def live(self, seconds: float, silent_s: float) -> None:
        """Advance the time after a silence of the bus that ends now."""
        units = self.memory[_WATCHDOG]
        if self.torque and 0 < units < EXPIRED and silent_s > units * 0.02:
            self.memory[_WATCHDOG] = EXPIRED
            self.speed_rad_per_s = 0.0
        if self.temperature_c > self.memory[31]:
            self.memory[_ERROR] |= OVERHEATED
            self.memory[_TORQUE] = 0
        holds = self.powered and self.torque
        wanted = self.goal * VELOCITY_UNIT_RAD_PER_S if self.driven and not self.jammed else 0.0
        tau_s = FOLLOW_S if holds else COAST_S
        after = wanted + (self.speed_rad_per_s - wanted) * math.exp(-seconds / tau_s)
        self.angle_rad += 0.5 * (after + self.speed_rad_per_s) * seconds
        self.speed_rad_per_s = after

    def read(self, at: int, size: int) -> bytes:
        self.put(126, 2, 40 if self.driven else 0)
        self.put(128, 4, round(self.speed_rad_per_s / VELOCITY_UNIT_RAD_PER_S))
        self.put(132, 4, round(self.angle_rad / (2.0 * math.pi) * 4096))
        self.put(144, 2, round(10.0 * self.volts))
        self.memory[146] = round(self.temperature_c)
        return bytes(self.memory[at : at + size])

    def write(self, at: int, data: bytes) -> int:
        """Return the error, 0 if written."""
        if at in _READ_ONLY or (at < 64 and self.torque):
            return ACCESS_ERROR
        value = int.from_bytes(data, "little", signed=len(data) == 4)
        if at == _GOAL and self.expired:
            return RANGE_ERROR
        if at == _GOAL and abs(value) > self.get(44, 4):
            return LIMIT_ERROR
        if at == _WATCHDOG and not 0 <= value <= 127:
            return RANGE_ERROR
        if at == _TORQUE and value and self.memory[_ERROR]:
            return 1  # Torque stays off until a reboot.
        self.memory[at : at + len(data)] = data
        return 0

    def status(self, error: int = 0, data: bytes = b"") -> bytes:
        low = 10.0 * self.volts < self.get(34, 2)
        alert = ALERT if self.memory[_ERROR] or low else 0
        return protocol2.encode(Packet(self.id, Instruction.STATUS, bytes([error | alert]) + data))


class XBus:
    """Simulated servos on one line, in the caller's time."""

    def __init__(self, servos: list[XServo]) -> None:
        self.servos = servos
        self.reserved: set[tuple[int, int]] = set()
        """Number of reads that cover a reserved register."""
        self.silent = False
        """Injected fault: loose data wire of the bus."""
        self.waits = False
        """Whether a servo responds to a sync read only after its predecessor in the request."""
        self.spoil_bits = 0
        """Bits to flip in the next responses."""
        self._decoder = Decoder(protocol2)
        self._lived_s = 0.0

    def servo(self, device: int) -> XServo:
        """Return the servo with an id."""
        return next(servo for servo in self.servos if servo.id == device)

    def live(self, now_s: float) -> None:
        """Advance to the current time in steps."""
        while self._lived_s and self._lived_s < now_s:
            step_s = min(0.002, now_s - self._lived_s)
            self._lived_s += step_s
            for servo in self.servos:
                servo.live(step_s, self._lived_s - servo.heard_s)
            if now_s - self._lived_s < 1e-9:
                break
        self._lived_s = now_s

    def answer(self, data: bytes, now_s: float) -> bytes:
        """Return the response to received bytes."""
        self.live(now_s)
        packets = self._decoder.feed(data, now_s)
        if packets:
            for servo in self.servos:  # Any packet feeds the watchdog of a servo that hears it.
                servo.heard_s = servo.heard_s if servo.dead or self.silent else now_s
        out = b"".join(self._obey(packet) for packet in packets)
        return self._spoilt(out)

    def _spoilt(self, out: bytes) -> bytes:
        if not self.spoil_bits or not out:
            return out
        broken = bytearray(out)
        for i in range(min(self.spoil_bits, len(broken))):
            broken[-1 - 7 * i % len(broken)] ^= 4
        return bytes(broken)

    def _obey(self, packet: Packet) -> bytes:
        params = packet.params
        if packet.code == Instruction.SYNC_READ:
            at, size = int.from_bytes(params[:2], "little"), int.from_bytes(params[2:4], "little")
            answers = [self._read(device, at, size) for device in params[4:]]
            if self.waits and b"" in answers:
                answers = answers[: answers.index(b"")]
            return b"".join(answers)
        if packet.code == Instruction.SYNC_WRITE:
            at, size = int.from_bytes(params[:2], "little"), int.from_bytes(params[2:4], "little")
            for i in range(4, len(params), size + 1):
                for servo in self._heard(params[i]):
                    servo.write(at, params[i + 1 : i + 1 + size])
            return b""
        answers = [(servo, self._single(servo, packet)) for servo in self._heard(packet.id)]
        return b"".join(answer for servo, answer in answers if not servo.mute)

    def _heard(self, device: int) -> list[XServo]:
        return [
            s
            for s in self.servos
            if s.id == device and s.powered and not s.dead and not self.silent
        ]

    def _read(self, device: int, at: int, size: int) -> bytes:
        if RESERVED & set(range(at, at + size)):
            self.reserved.add((at, size))
        return b"".join(
            servo.status(0, servo.read(at, size)) for servo in self._heard(device) if not servo.mute
        )

    def _single(self, servo: XServo, packet: Packet) -> bytes:
        params = packet.params
        if packet.code == Instruction.PING:
            return servo.status(0, servo.read(0, 2) + servo.read(6, 1))
        if packet.code == REBOOT:
            servo.restart()
            return servo.status()
        at = int.from_bytes(params[:2], "little")
        if packet.code == Instruction.READ:
            return self._read(servo.id, at, int.from_bytes(params[2:4], "little"))
        return servo.status(servo.write(at, params[2:]))
