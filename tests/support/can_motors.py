"""Simulated VESC and moteus controllers on a CAN bus of python-can, with their command timeouts.

A VESC releases its motor some time after the last setpoint, and the next setpoint restarts it. A
moteus latches its timeout until a stop command. `python -m tests.support.can_motors` runs some.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import threading
import time
from binascii import crc_hqx
from dataclasses import dataclass
from struct import pack, unpack, unpack_from

import can

FOLLOW_S = 0.03
STATUS_S = 0.02


@dataclass
class Motor:
    """Motor at a controller."""

    id: int
    kind: str
    timeout_s: float = 0.2
    speed_hz: float = 0.0
    wanted_hz: float = 0.0
    commanded_s: float = 0.0
    mode: int = 0
    fault: int = 0
    volts: float = 24.0
    temperature_c: float = 30.0
    mute: bool = False
    deaf: bool = False
    status: int = 25
    """Status messages that it sends."""
    sent_s: float = 0.0
    pole_pairs: int = 7
    refuses_timeout: bool = False

    @property
    def driven(self) -> bool:
        return self.wanted_hz != 0.0 and (self.kind == "vesc" or self.mode == 10)

    def live(self, seconds: float, now_s: float) -> None:
        if self.driven and now_s - self.commanded_s > self.timeout_s > 0.0:
            self.wanted_hz = 0.0
            if self.kind == "moteus":
                self.mode = 11
        if self.fault:
            self.mode, self.wanted_hz = 1, 0.0
        wanted = self.wanted_hz if self.driven else 0.0
        self.speed_hz += (wanted - self.speed_hz) * (1.0 - math.exp(-seconds / FOLLOW_S))


class MotorBus:
    """Controllers on one bus, in a thread."""

    def __init__(self, interface: str, channel: str, motors: list[Motor]) -> None:
        self.motors = motors
        self._fd = motors[0].kind == "moteus"
        self._bus = can.Bus(interface=interface, channel=channel, fd=self._fd)
        self._ended = threading.Event()
        self.off_s = self._since_s = 0.0
        self._lived_s = time.monotonic()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def mark(self) -> None:
        """Start the clock until no motor is driven."""
        self.off_s, self._since_s = 0.0, time.monotonic()

    @property
    def driven(self) -> bool:
        return any(motor.driven for motor in self.motors)

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self._bus.shutdown()

    def _run(self) -> None:
        while not self._ended.is_set():
            self.step(self._bus.recv(0.002), time.monotonic())

    def step(self, message: can.Message | None, now_s: float) -> None:
        """Advance to the current time, process a message, and send the replies that are due."""
        for motor in self.motors:
            motor.live(now_s - self._lived_s, now_s)
        self._lived_s = now_s
        if self._since_s and not self.off_s and not self.driven:
            self.off_s = now_s - self._since_s
        if message is not None:
            for motor in self.motors:
                if not motor.deaf:
                    (self._vesc if motor.kind == "vesc" else self._moteus)(
                        motor, message.arbitration_id, bytes(message.data), now_s
                    )
        for motor in self.motors:
            if motor.kind == "vesc" and now_s - motor.sent_s > STATUS_S:
                motor.sent_s = now_s
                self._send_status(motor)

    def _send(self, identifier: int, data: bytes) -> None:
        self._bus.send(
            can.Message(
                arbitration_id=identifier,
                data=data,
                is_extended_id=True,
                is_fd=self._fd,
                bitrate_switch=self._fd,
            )
        )

    def _send_status(self, motor: Motor) -> None:
        if motor.mute:
            return
        erpm = round(60.0 * motor.pole_pairs * motor.speed_hz)
        if motor.status & 1:
            self._send(9 << 8 | motor.id, pack(">ihh", erpm, 20, 100))
        if motor.status & 8:
            self._send(16 << 8 | motor.id, pack(">hhhh", round(10 * motor.temperature_c), 0, 0, 0))
        if motor.status & 16:
            self._send(27 << 8 | motor.id, pack(">ihh", 0, round(10 * motor.volts), 0))

    def _vesc(self, motor: Motor, identifier: int, data: bytes, now_s: float) -> None:
        packet, device = identifier >> 8, identifier & 0xFF
        if device != motor.id:
            return
        if packet == 3:
            (erpm,) = unpack(">i", data)
            least = 900.0
            motor.wanted_hz = erpm / 60.0 / motor.pole_pairs if abs(erpm) >= least else 0.0
            motor.commanded_s = now_s
        elif packet == 1:
            motor.wanted_hz, motor.commanded_s = 0.0, now_s
        elif packet == 8 and data[2:] == b"\x11" and not motor.mute:
            head = pack(
                ">IBIIHHBB", 982638166, motor.id, round(1000 * motor.timeout_s), 0, 50, 0,
                motor.status, 0,
            )  # fmt: skip
            self._send_long(data[0], motor.id, b"\x11" + head + bytes(300))

    def _send_long(self, target: int, sender: int, payload: bytes) -> None:
        at = 0
        while at < len(payload) and at <= 255:
            self._send(5 << 8 | target, bytes((at,)) + payload[at : at + 7])
            at += 7
        while at < len(payload):
            self._send(6 << 8 | target, pack(">H", at) + payload[at : at + 6])
            at += 6
        end = bytes((sender, 1)) + pack(">HH", len(payload), crc_hqx(payload, 0))
        self._send(7 << 8 | target, end)

    def _moteus(self, motor: Motor, identifier: int, data: bytes, now_s: float) -> None:
        if identifier & 0x7F != motor.id or not identifier & 0x8000:
            return
        at = 0
        while at < len(data) and data[at] < 0x10:
            count, kind, first = data[at] & 3, data[at] >> 2 & 3, data[at + 1]
            size = {0: 1, 3: 4}[kind]
            values = unpack_from(f"<{count}{'b' if kind == 0 else 'f'}", data, at + 2)
            for i, value in enumerate(values):
                self._write(motor, first + i, value)
            at += 2 + count * size
        motor.commanded_s = now_s
        if not motor.mute:
            self._send(motor.id << 8, self._reply(motor))

    @staticmethod
    def _write(motor: Motor, register: int, value: float) -> None:
        if register == 0:
            if value == 0:
                motor.mode, motor.wanted_hz = 0, 0.0
            elif motor.mode not in (1, 11):  # Only a stop clears a fault or a timeout.
                motor.mode = int(value)
        elif register == 0x21:
            motor.wanted_hz = value
        elif register == 0x27 and not motor.refuses_timeout:
            motor.timeout_s = value

    @staticmethod
    def _reply(motor: Motor) -> bytes:
        speed = max(-32767, min(32767, round(motor.speed_hz / 0.00025)))
        return (
            bytes((0x24, 4, 0)) + pack("<hhhh", motor.mode, 0, speed, 0)
            + bytes((0x23, 0x0D)) + pack("<bbb", round(2 * motor.volts), 30, motor.fault)
            + bytes((0x2D, 0x27)) + pack("<f", motor.timeout_s) + bytes((0x50,)) * 2
        )  # fmt: skip


def main() -> None:
    """Serve until standard input ends; commands are mark, show, mend, and a field of a motor with
    its number, from 1, and value, 1 by default.
    """
    parser = argparse.ArgumentParser()
    parser.add_argument("--channel", required=True)
    parser.add_argument("--kind", required=True)
    parser.add_argument("--ids", default="1,2,3")
    args = parser.parse_args()
    motors = [Motor(int(number), args.kind) for number in args.ids.split(",")]
    bus = MotorBus("udp_multicast", args.channel, motors)
    sys.stdout.write("ready: motors\n")
    sys.stdout.flush()
    for line in sys.stdin:
        what, *rest = line.split()
        bus.mark()
        if what == "show":
            shown = {
                "driven": [m.driven for m in motors],
                "speeds_hz": [m.speed_hz for m in motors],
            }
            sys.stdout.write(json.dumps(shown | {"modes": [m.mode for m in motors]}) + "\n")
            sys.stdout.flush()
        elif what == "mend":
            for motor in motors:
                motor.mute = motor.deaf = False
                motor.fault, motor.temperature_c = 0, 30.0
        else:
            setattr(motors[int(rest[0]) - 1], what, int(rest[1]) if rest[1:] else True)


if __name__ == "__main__":
    main()
