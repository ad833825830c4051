# SPDX-License-Identifier: GPL-3.0-or-later
"""Simulated servos on a bus, and their responses to requests."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from types import ModuleType

from firmware.simulator import protocol1, protocol2
from firmware.simulator.mx64 import Mx64


class ServoBusSimulation:
    """Simulated servos on a half-duplex bus, by id."""

    def __init__(self, servos: Iterable[Mx64]) -> None:
        self.servos = {servo.number: servo for servo in servos}
        self.requests = 0
        self.nonsense = 0
        """Number of malformed requests."""
        self.reserved: set[tuple[int, int]] = set()
        """Reads (address, length) that cover an undocumented address."""

    def answer(self, request: bytes) -> tuple[bytes, int] | None:
        """Return the response to a request and its delay in microseconds, or None."""
        self.requests += 1
        protocol = protocol2 if request[:4] == b"\xff\xff\xfd\x00" else protocol1
        parsed = protocol.parse(request)
        if parsed is None:
            self.nonsense += 1
            return None
        number, instruction, parameters = parsed
        if instruction == protocol.SYNC_WRITE:
            self._sync_write(protocol, parameters)
            return None
        servo = self.servos.get(number)
        if servo is None or not servo.answers or servo.registers.protocol is not protocol:
            return None
        reply = self._reply(servo, instruction, parameters)
        return None if reply is None else (reply, servo.return_delay_us)

    def _reply(self, servo: Mx64, instruction: int, parameters: bytes) -> bytes | None:
        protocol = servo.registers.protocol
        if instruction == protocol.PING:
            return servo.answer_to_ping()
        address, rest = protocol.fields(parameters)
        if instruction == protocol.READ:
            length = int.from_bytes(rest, "little")
            if not _covers(servo.registers.documented, address, length):
                self.reserved.add((address, length))
            return servo.status(servo.read(address, length))
        servo.write(address, rest)
        return servo.status() if servo.answers_writes else None

    def _sync_write(self, protocol: ModuleType, parameters: bytes) -> None:
        address, rest = protocol.fields(parameters)
        head = 2 if protocol is protocol2 else 1
        size, rest = int.from_bytes(rest[:head], "little"), rest[head:]
        for at in range(0, len(rest), size + 1):
            servo = self.servos.get(rest[at])
            if servo is not None and servo.answers and servo.registers.protocol is protocol:
                servo.write(address, rest[at + 1 : at + 1 + size])


@cache
def _covers(documented: frozenset[int], address: int, length: int) -> bool:
    return documented.issuperset(range(address, address + length))
