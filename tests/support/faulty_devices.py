"""Devices at the other end of a real pty that behave in ways that no correct firmware does."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import threading
import time
import tty
from collections.abc import Callable, Generator
from dataclasses import replace
from pathlib import Path

from tests.support.priorities import this_thread_is_a_robot
from tsd_twin.hardware.board_geometry import compiled_geometry
from tsd_twin.hardware.dynamixel.control_table import (
    TABLE_SIZE,
    BoardCommand,
    BoardIdentity,
    BoardMode,
    Setup,
    Telemetry,
    TripHistory,
    Wheels,
)
from tsd_twin.hardware.dynamixel.packets import Decoder, Instruction, Packet, protocol2
from tsd_twin.robots import SingularityDescription, description_of_kind, load_robot


class Peer:
    """Pty whose other end answers by a function; `port` stays the same when replugged."""

    def __init__(self, port: Path, answer: Callable[[bytes, float], bytes]) -> None:
        self.port = str(port)
        self._answer = answer
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        self.plug_in()

    def plug_in(self) -> None:
        """Appear, under the same name as before, unless plugged in."""
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
        """Vanish."""
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
    """A control table without any rule: what is written stays, and tests set what is read."""

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
        self.obeys_arm = True
        self.silent = False
        self.late = 0
        """Answers that are kept back before any goes out."""
        self.asked = 0
        self.stray = b""
        """Bytes that come with every answer, and are none."""
        self.spoils = 0
        """Answers to come in which a bit is wrong."""
        self._decoder = Decoder(protocol2)
        self._kept: list[bytes] = []
        self.error = 0
        """Answer to a set-up."""
        self.commands: list[BoardCommand] = []
        self.setups: list[Setup] = []

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
            packed = block.pack()
            self.table[block.ADDRESS : block.ADDRESS + len(packed)] = packed


@contextlib.contextmanager
def plugged(folder: Path, board: PretendBoard) -> Generator[Peer]:
    """Have a pretended board at a pty."""
    peer = Peer(folder / "board", board.answer)
    try:
        yield peer
    finally:
        peer.unplug()
