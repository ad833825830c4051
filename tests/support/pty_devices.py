"""Simulated boards and servos behind a pty, with faults that correct firmware does not have.

`python -m tests.support.pty_devices PORT` serves six MX-64 servos with sync read and bus watchdog,
as on a U2D2. Faults are lines on standard input: `dead N`, `hot N`, `limp N`, `unplug`, `mend`.
"""

from __future__ import annotations

import contextlib
import os
import pty
import select
import sys
import threading
import time
import tty
from collections.abc import Callable, Generator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from firmware.simulator.mx64 import Mx64
from firmware.simulator.servo_bus import ServoBusSimulation
from firmware.simulator.simulation import IDS
from tests.support.withheld import this_thread_is_a_robot
from tsd_twin import robots
from tsd_twin.hardware import servo_line, u2d2
from tsd_twin.hardware.board_geometry import compiled_geometry
from tsd_twin.hardware.dynamixel.control_table import (
    TABLE_SIZE,
    Block,
    BoardCommand,
    BoardIdentity,
    BoardMode,
    Setup,
    Telemetry,
    TripHistory,
    Wheels,
)
from tsd_twin.hardware.dynamixel.packets import Decoder, Instruction, Packet, protocol1, protocol2
from tsd_twin.robots import SingularityDescription, description_of_kind, load_robot
from tsd_twin.simulation import Servos


class Peer:
    """Pty with a function as its peer; `port` stays the same when replugged."""

    def __init__(self, port: Path, answer: Callable[[bytes, float], bytes]) -> None:
        self.port = str(port)
        self._answer = answer
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        self.plug_in()

    def plug_in(self) -> None:
        """Connect under the same name, unless connected."""
        if self._thread is not None:
            return
        master, slave = pty.openpty()
        tty.setraw(slave)
        link = Path(self.port)
        link.unlink(missing_ok=True)
        link.symlink_to(os.ttyname(slave))
        self._stopping.clear()
        self._thread = threading.Thread(target=self._run, args=(master, slave))
        self._thread.start()

    def unplug(self) -> None:
        """Disconnect."""
        if self._thread is not None:
            self._stopping.set()
            self._thread.join()
            self._thread = None
            Path(self.port).unlink()

    def _run(self, master: int, slave: int) -> None:
        this_thread_is_a_robot()
        while not self._stopping.is_set():
            if select.select([master], [], [], 0.01)[0]:
                with contextlib.suppress(OSError):
                    os.write(master, self._answer(os.read(master, 4096), time.monotonic()))
        os.close(master)
        os.close(slave)


class PretendBoard:
    """Control table without rules: writes are stored, and tests set the values to read."""

    def __init__(self) -> None:
        self.identity = BoardIdentity()
        self.geometry = compiled_geometry(
            description_of_kind(load_robot("tsd"), SingularityDescription)
        )
        self.telemetry = Telemetry(
            millis=100_000,
            drive_on=1,
            stop_proven=1,
            esc_ready=1,
            servo_found=63,
            servo_alive=63,
            servo_torque=63,
            servo_checked=63,
            servo_protocol=63,
            servo_model=(311,) * 6,
            battery_mv=12000,
            drive_mv=12000,
        )
        self.wheels = Wheels()
        self.history = TripHistory()
        self.table = bytearray(TABLE_SIZE)
        self._packed: dict[type[Block], tuple[Block, bytes]] = {}
        """Latest block of each kind in the table."""
        self.obeys_arm = True
        self.silent = False
        self.late = 0
        """Number of responses that are held back."""
        self.asked = 0
        self.stray = b""
        """Stray bytes after each response."""
        self.spoils = 0
        """Number of further responses with a wrong bit."""
        self._decoder = Decoder(protocol2)
        self._kept: list[bytes] = []
        self.error = 0
        """Error code in the response to a setup."""
        self.commands: list[BoardCommand] = []
        self.setups: list[Setup] = []

    def report(self, **values: Any) -> None:
        """Change values of the telemetry."""
        self.telemetry = replace(self.telemetry, **values)

    def answer(self, data: bytes, now_s: float) -> bytes:
        """Return the response."""
        return b"".join(self._late(packet) for packet in self._decoder.feed(data, now_s))

    def _late(self, packet: Packet) -> bytes:
        self.asked += 1
        self._kept.append(self._answer(packet))
        if self.spoils and packet.code == Instruction.READ:
            self.spoils -= 1
            spoilt = bytearray(self._kept[-1])
            spoilt[-5] ^= 4
            self._kept[-1] = bytes(spoilt)
        self._kept[-1] += self.stray
        if self.silent:
            self._kept.clear()
        out, self._kept = (
            self._kept[: -self.late or None],
            self._kept[-self.late or len(self._kept) :],
        )
        return b"".join(out)

    def _answer(self, packet: Packet) -> bytes:
        error, data = self._response(packet)
        return protocol2.encode(Packet(packet.id, Instruction.STATUS, bytes([error]) + data))

    def _response(self, packet: Packet) -> tuple[int, bytes]:
        if packet.code == Instruction.PING:
            return 0, self.identity.pack()[:3]
        address = int.from_bytes(packet.params[:2], "little")
        if packet.code == Instruction.READ:
            self._refresh()
            length = int.from_bytes(packet.params[2:4], "little")
            return 0, bytes(self.table[address : address + length])
        self._write(address, packet.params[2:])
        return self.error if address == Setup.ADDRESS else 0, b""

    def _write(self, address: int, data: bytes) -> None:
        self.table[address : address + len(data)] = data
        if address == Setup.ADDRESS:
            self.setups.append(Setup.unpack(data))
            self.telemetry = replace(self.telemetry, setup_known=1)
        else:
            self.commands.append(BoardCommand.unpack(data))
            self.telemetry = replace(self.telemetry, beat=self.commands[-1].heartbeat)
            if self.obeys_arm:
                mode = BoardMode.ARMED if self.commands[-1].arm else BoardMode.DISARMED
                self.telemetry = replace(self.telemetry, mode=int(mode))

    def _refresh(self) -> None:
        self.telemetry = replace(self.telemetry, millis=self.telemetry.millis + 10)
        for block in (self.identity, self.telemetry, self.wheels, self.geometry, self.history):
            kept, packed = self._packed.get(type(block), (None, b""))
            if kept is not block:  # Most stay the same.
                packed = block.pack()
                self._packed[type(block)] = block, packed
            self.table[block.ADDRESS : block.ADDRESS + len(packed)] = packed


@contextlib.contextmanager
def plugged(folder: Path, board: PretendBoard) -> Generator[Peer]:
    """Yield a pretended board at a pty."""
    peer = Peer(folder / "board", board.answer)
    try:
        yield peer
    finally:
        peer.unplug()


_LAWS = Servos.of(
    robots.description_of_kind(robots.load_robot("tsd"), robots.SingularityDescription), 12.0
)
TRIPPED = 255
COOL_C, HOT_C = 35, 90


class ServoChain:
    """Six simulated MX-64 at a U2D2; they stop when requests stop."""

    def __init__(
        self,
        protocols: tuple[int, ...] = (2,) * 6,
        ids: tuple[int, ...] = IDS,
        *,
        steps: int = 0,
    ) -> None:
        """`steps` is the offset of all servos from 2048."""
        self.servos = [Mx64(*servo) for servo in zip(ids, protocols, strict=True)]
        self.bus = ServoBusSimulation(self.servos)
        self.waits = False
        """Whether a servo responds to a sync read only after its predecessor in the request."""
        self.refused = 0
        """Number of goals rejected by a tripped watchdog."""
        self._decoders = (Decoder(protocol2), Decoder(protocol1))
        self.angles = np.full(6, steps * _LAWS.step_rad)
        """(6,): angles of the horns from 2048, rad."""
        self._heard_s = self._moved_s = 0.0

    def register(self, servo: int, address: int) -> int:
        """Return one byte of a servo's control table; servos count from 0."""
        return self.servos[servo].read(address, 1)[0]

    def tripped(self) -> bool:
        """Return whether every watchdog has expired."""
        return all(self.register(i, servo_line.BUS_WATCHDOG) == TRIPPED for i in range(6))

    def goals(self) -> list[int]:
        """Return the latest goals."""
        return [servo.goal for servo in self.servos]

    def answer(self, data: bytes, now_s: float) -> bytes:
        """Return the response to received bytes."""
        self.live(now_s)
        self._heard_s = now_s
        two, one = (decoder.feed(data, now_s) for decoder in self._decoders)
        out = b"".join(self._obey(packet) for packet in two)
        for packet in one:
            answer = self.bus.answer(protocol1.encode(packet))
            out += answer[0] if answer else b""
        return out

    def _obey(self, packet: Packet) -> bytes:
        if packet.code == Instruction.SYNC_READ:
            address = int.from_bytes(packet.params[:2], "little")
            length = int.from_bytes(packet.params[2:4], "little")
            read = [protocol2.read(device, address, length) for device in packet.params[4:]]
            answers = [a and a[0] for a in map(self.bus.answer, read)]
            if self.waits and None in answers:
                answers = answers[: answers.index(None)]
            return b"".join(filter(None, answers))
        writes_goals = (
            packet.code == Instruction.SYNC_WRITE and packet.params[0] == u2d2.GOAL_POSITION
        )
        if writes_goals and self.tripped():
            self.refused += 1
            return b""
        answer = self.bus.answer(protocol2.encode(packet))
        return answer[0] if answer else b""

    def mend(self) -> None:
        """Remove all injected faults."""
        for servo in self.servos:
            servo.dead, servo.temperature_c = False, COOL_C

    def live(self, now_s: float) -> None:
        """Advance to `now_s`; servos move until their watchdogs expire."""
        units = self.register(0, servo_line.BUS_WATCHDOG)
        until_s = now_s
        if 0 < units < TRIPPED and now_s - self._heard_s > units * servo_line.BUS_WATCHDOG_S:
            until_s = self._heard_s + units * servo_line.BUS_WATCHDOG_S
            for servo in self.servos:
                servo.write(servo_line.BUS_WATCHDOG, bytes([TRIPPED]))
        goals = (np.array(self.goals()) - 2048) * _LAWS.step_rad
        elapsed_s = max(0.0, until_s - self._moved_s) if units != TRIPPED else 0.0
        moved = _LAWS.after(self.angles, goals, np.float64(min(elapsed_s, 1.0)))
        still = [servo.jammed or not servo.torque for servo in self.servos]
        self.angles = np.where(still, self.angles, moved)
        self._moved_s = now_s
        for servo, angle in zip(self.servos, self.angles, strict=True):
            servo.position = 2048 + round(angle / _LAWS.step_rad)


def main() -> None:
    """Serve until standard input ends."""
    chain = ServoChain()
    peer = Peer(Path(sys.argv[1]), chain.answer)
    sys.stdout.write(f"ready: {peer.port}\n")
    sys.stdout.flush()
    for line in sys.stdin:
        match line.split():
            case ["dead", number]:
                chain.servos[int(number) - 1].dead = True
            case ["hot", number]:
                chain.servos[int(number) - 1].temperature_c = HOT_C
            case ["limp", number]:
                chain.servos[int(number) - 1].switch_off()
            case ["unplug"]:
                peer.unplug()
            case _:
                chain.mend()
                peer.plug_in()
    peer.unplug()


if __name__ == "__main__":
    main()
