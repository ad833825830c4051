# SPDX-License-Identifier: GPL-3.0-or-later
"""Simulated MX-64 with either firmware. Source: Robotis e-Manual, MX-64, MX-64(2.0)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import ModuleType

from firmware.simulator import protocol1, protocol2


@dataclass(frozen=True)
class Registers:
    """Register addresses with sizes in bytes, and other properties of a firmware."""

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
    """Velocity unit."""
    fault: int
    """Error bits of a status with a hardware error."""
    alarm_v: float
    """Minimum voltage without an alarm, factory default."""
    status_return_level: int
    """Address of the status return level; below 2, writes are not answered."""
    defaults: Mapping[tuple[int, int], int]
    """Non-zero factory defaults by address and size; RAM registers are restored at each restart."""
    documented: frozenset[int]
    """Addresses listed in the manual; the others are reserved."""
    limit: tuple[int, int, int]
    """Address, size and default of the torque limit; 0 disables torque."""
    ram: int
    """Start address of the RAM; lower addresses survive a restart."""


def _addresses(*ranges: tuple[int, int]) -> frozenset[int]:
    """Return the addresses in inclusive ranges."""
    return frozenset(i for first, last in ranges for i in range(first, last + 1))


REGISTERS = {
    1: Registers(
        protocol1, 310, torque=24, goal=(30, 2), position=(36, 2), velocity=(38, 2),
        voltage=(42, 1), temperature=43, current=(68, 2),
        steps_per_s=0.114 * 4096 / 60, fault=0x20, alarm_v=6.0, limit=(34, 2, 1023), ram=24,
        status_return_level=16,
        defaults={
            (0, 2): 310, (5, 1): 250, (8, 2): 4095, (11, 1): 80, (12, 1): 60, (13, 1): 160,
            (14, 2): 1023, (16, 1): 2, (17, 1): 36, (18, 1): 36, (22, 1): 1, (28, 1): 32,
            (34, 2): 1023,
        },
        documented=_addresses(
            (0, 9), (11, 18), (20, 22), (24, 28), (30, 44), (46, 49), (68, 73)
        ),
    ),
    2: Registers(
        protocol2, 311, torque=64, goal=(116, 4), position=(132, 4), velocity=(128, 4),
        voltage=(144, 2), temperature=146, current=(126, 2),
        steps_per_s=0.229 * 4096 / 60, fault=0x80, alarm_v=9.5, limit=(36, 2, 885), ram=64,
        status_return_level=68,
        defaults={
            (0, 2): 311, (9, 1): 250, (11, 1): 3, (12, 1): 255, (13, 1): 2, (24, 4): 10,
            (31, 1): 80, (32, 2): 160, (34, 2): 95, (36, 2): 885, (38, 2): 1941, (40, 4): 32767,
            (44, 4): 285, (48, 4): 4095, (63, 1): 52, (68, 1): 2, (76, 2): 1920, (78, 2): 100,
            (84, 2): 850, (100, 2): 885, (102, 2): 1941, (104, 4): 285,
        },
        documented=_addresses(
            (0, 13), (20, 27), (31, 55), (63, 65), (68, 70), (76, 85), (88, 91), (98, 98),
            (100, 146),
        ),
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
        """Injected fault: responds but does not move."""
        self.fault = False
        """Whether it reports a hardware error."""
        self.return_delay_us = 500
        self.position = 2048
        self.velocity_steps_per_s = 0.0
        self.volts = 12.0
        self.goal_enables_torque = self.registers.protocol is protocol1
        """Whether writing the goal enables torque, as in the factory firmware."""
        self._memory = bytearray(256)
        for register, value in self.registers.defaults.items():
            self._put(register, value)
        self._put(self.registers.goal, 2048)
        self._memory[self.registers.temperature] = 35

    @property
    def torque(self) -> bool:
        """Whether torque is enabled and not disabled by a shutdown."""
        at, size, _ = self.registers.limit
        return bool(self._memory[self.registers.torque]) and any(self._memory[at : at + size])

    @property
    def answers(self) -> bool:
        """Whether it has power and is not dead."""
        return self.powered and not self.dead

    def set_power(self, volts: float, least_v: float) -> None:
        """Set the voltage; below `least_v` the servo is off and loses its RAM."""
        self.volts, self.powered = volts, volts >= least_v
        if not self.powered:
            self.restart()

    def restart(self) -> None:
        """Reset the RAM, which disables torque."""
        registers = self.registers
        self._memory[registers.ram :] = bytes(256 - registers.ram)
        for register, value in registers.defaults.items():
            if register[0] >= registers.ram:
                self._put(register, value)
        self._put(registers.goal, self.position)
        self._memory[registers.temperature] = 35

    def shut_down(self) -> None:
        """Disable torque because of an overload, like the hardware."""
        self.fault = True
        if self.registers.protocol is protocol1:
            self._put(self.registers.limit[:2], 0)
        else:
            self._memory[self.registers.torque] = 0

    def recover(self) -> None:
        """Restart after a shutdown, as after a power cycle."""
        self.fault = False
        self.restart()

    def switch_off(self) -> None:
        """Disable torque, like another program on the bus."""
        self._memory[self.registers.torque] = 0

    def set_register(self, address: int, size: int, value: int) -> None:
        """Change a register, like another program on the bus."""
        self._put((address, size), value)

    @property
    def goal(self) -> int:
        """Goal position, steps."""
        at, size = self.registers.goal
        return int.from_bytes(self._memory[at : at + size], "little", signed=size == 4)

    def write(self, address: int, data: bytes) -> None:
        """Handle a write."""
        self._memory[address : address + len(data)] = data
        if self.goal_enables_torque and address == self.registers.goal[0]:
            self._memory[self.registers.torque] = 1

    def read(self, address: int, length: int) -> bytes:
        """Return the current registers."""
        registers = self.registers
        self._put(registers.position, self.position)
        units = round(self.velocity_steps_per_s / registers.steps_per_s)
        if registers.protocol is protocol1:
            # Sign-magnitude velocity, and a current with zero at 2048.
            self._put(registers.velocity, min(abs(units), 0x3FF) | (0x400 if units < 0 else 0))
            self._put(registers.current, 2048)
        else:
            self._put(registers.velocity, units)
        self._put(registers.voltage, round(10.0 * self.volts))
        return bytes(self._memory[address : address + length])

    @property
    def temperature_c(self) -> int:
        """Internal temperature."""
        return self._memory[self.registers.temperature]

    @temperature_c.setter
    def temperature_c(self, value: int) -> None:
        self._memory[self.registers.temperature] = value

    @property
    def answers_writes(self) -> bool:
        """Whether the status return level is at its default."""
        return self._memory[self.registers.status_return_level] == 2

    def status(self, data: bytes = b"") -> bytes:
        """Return a status packet of this servo."""
        registers = self.registers
        fault = registers.fault if self.fault else 0
        if self.volts < registers.alarm_v:
            fault |= _LOW_VOLTAGE[registers.protocol]
        return registers.protocol.status(self.number, data, fault)

    def answer_to_ping(self) -> bytes:
        """Return the ping response, with model and version in Protocol 2.0 only."""
        if self.registers.protocol is protocol1:
            return self.status()
        return self.status(self.registers.model.to_bytes(2, "little") + b"\x29")

    def _put(self, register: tuple[int, int], value: int) -> None:
        at, size = register
        self._memory[at : at + size] = (value % (1 << 8 * size)).to_bytes(size, "little")
