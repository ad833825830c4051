# SPDX-License-Identifier: GPL-3.0-or-later
"""Registers of an MX-64 with either firmware. Source: Robotis e-Manual, MX-64, MX-64(2.0)."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

from firmware.simulator import protocol1, protocol2


@dataclass(frozen=True)
class Registers:
    """Addresses, sizes in bytes, and how a servo of one firmware answers."""

    protocol: ModuleType
    model: int
    torque: int
    goal: tuple[int, int]
    position: tuple[int, int]
    velocity: tuple[int, int]
    voltage: tuple[int, int]
    temperature: int
    current: tuple[int, int]
    steps_per_s: float
    """One unit of velocity."""
    fault: int
    """Error of a status when the hardware is in trouble."""
    alarm_v: float
    """Lowest voltage without one, as it comes from the factory."""


REGISTERS = {
    1: Registers(
        protocol1, 310, torque=24, goal=(30, 2), position=(36, 2), velocity=(38, 2),
        voltage=(42, 1), temperature=43, current=(68, 2),
        steps_per_s=0.114 * 4096 / 60, fault=0x20, alarm_v=6.0,
    ),
    2: Registers(
        protocol2, 311, torque=64, goal=(116, 4), position=(132, 4), velocity=(128, 4),
        voltage=(144, 2), temperature=146, current=(126, 2),
        steps_per_s=0.229 * 4096 / 60, fault=0x80, alarm_v=9.5,
    ),
}  # fmt: skip


_LOW_VOLTAGE = {protocol1: 0x01, protocol2: 0x80}


class Mx64:
    """Simulated MX-64 on the bus; the robot simulation sets its position."""

    def __init__(self, number: int, version: int) -> None:
        self.number = number
        self.registers = REGISTERS[version]
        self.dead = False
        """Injected fault: no responses, and the motor holds its position."""
        self.powered = True
        self.jammed = False
        """Injected fault: it answers, but does not move."""
        self.fault = False
        """Reports a hardware error."""
        self.return_delay_us = 500
        self.position = 2048
        self.velocity_steps_per_s = 0.0
        self.volts = 12.0
        self._memory = bytearray(256)
        self._put(self.registers.goal, 2048)
        self._memory[self.registers.temperature] = 35

    @property
    def torque(self) -> bool:
        """Whether torque is enabled."""
        return bool(self._memory[self.registers.torque])

    @property
    def answers(self) -> bool:
        """Whether it has power and is not dead."""
        return self.powered and not self.dead

    def set_power(self, volts: float, least_v: float) -> None:
        """Set its voltage; below `least_v` it is off, and forgets that torque was enabled."""
        self.volts, self.powered = volts, volts >= least_v
        if not self.powered:
            self._memory[self.registers.torque] = 0

    @property
    def goal(self) -> int:
        """Goal position, steps."""
        at, size = self.registers.goal
        return int.from_bytes(self._memory[at : at + size], "little", signed=size == 4)

    def write(self, address: int, data: bytes) -> None:
        """Take a write. One of the goal switches torque on with the factory firmware."""
        self._memory[address : address + len(data)] = data
        if self.registers.protocol is protocol1 and address == self.registers.goal[0]:
            self._memory[self.registers.torque] = 1

    def read(self, address: int, length: int) -> bytes:
        """Return registers as they are now."""
        registers = self.registers
        self._put(registers.position, self.position)
        units = round(self.velocity_steps_per_s / registers.steps_per_s)
        if registers.protocol is protocol1:
            # Sign and magnitude, and a current that is 0 at 2048.
            self._put(registers.velocity, min(abs(units), 0x3FF) | (0x400 if units < 0 else 0))
            self._put(registers.current, 2048)
        else:
            self._put(registers.velocity, units)
        self._put(registers.voltage, round(10.0 * self.volts))
        return bytes(self._memory[address : address + length])

    def status(self, data: bytes = b"") -> bytes:
        """Answer of this servo."""
        registers = self.registers
        fault = registers.fault if self.fault else 0
        if self.volts < registers.alarm_v:
            fault |= _LOW_VOLTAGE[registers.protocol]
        return registers.protocol.status(self.number, data, fault)

    def answer_to_ping(self) -> bytes:
        """Answer, which has model and version with the newer firmware only."""
        if self.registers.protocol is protocol1:
            return self.status()
        return self.status(self.registers.model.to_bytes(2, "little") + b"\x29")

    def _put(self, register: tuple[int, int], value: int) -> None:
        at, size = register
        self._memory[at : at + size] = (value % (1 << 8 * size)).to_bytes(size, "little")
