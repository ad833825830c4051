"""VESC motor controllers: frames of CAN. Pure.

Source: vedderb/bldc, comm/comm_can.c, confgenerator.c and datatypes.h, firmware 7.
A VESC stops a time after the last set command; its time-out does not latch, so the next command
turns the motor again, and the bridge must not send one. Status frames are off as delivered.
"""

from __future__ import annotations

import math
from binascii import crc_hqx
from collections.abc import Sequence
from enum import IntEnum
from struct import pack, unpack

from tsd_twin.hardware.motors.base import Frame, MotorState


class Can(IntEnum):
    """Packet ids of extended CAN frames, in bits 8 to 15 of the identifier."""

    SET_CURRENT = 1
    SET_RPM = 3
    FILL_RX_BUFFER = 5
    FILL_RX_BUFFER_LONG = 6
    PROCESS_RX_BUFFER = 7
    PROCESS_SHORT_BUFFER = 8
    STATUS = 9
    STATUS_4 = 16
    STATUS_5 = 27


class Comm(IntEnum):
    """Commands in the buffers of CAN."""

    FW_VERSION = 0
    SET_RPM = 8
    GET_APPCONF = 17


HOST_ID = 253
"""Id of this program on the bus; controllers have smaller ones."""
LEAST_ERPM = 900.0
"""Below this electrical speed a sensorless VESC lets its motor go."""
TIMEOUT_S = (0.05, 0.5)
"""Shortest and longest permitted time-out."""
_STATUS_1, _STATUS_4, _STATUS_5 = 1, 8, 16
"""Bits of `can_status_msgs`."""
_NEEDED = _STATUS_1 | _STATUS_4 | _STATUS_5
_LEAST_RATE_HZ = 20
_UNREAD = "it does not answer with its settings"


def frame(packet: Can, device: int, data: bytes) -> Frame:
    """Return a frame to a controller."""
    return Frame(packet << 8 | device, data)


def set_erpm(device: int, erpm: float) -> Frame:
    """Return the frame that sets an electrical speed."""
    return frame(Can.SET_RPM, device, pack(">i", round(erpm)))


def release(device: int) -> Frame:
    """Return the frame that sets zero current: the motor runs down."""
    return frame(Can.SET_CURRENT, device, pack(">i", 0))


class LongReply:
    """Reply of a controller that arrives in several frames."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def add(self, packet: int, data: bytes) -> bytes | None:
        """Return the payload once it is complete and its CRC is right."""
        if len(data) < 2:
            return None
        if packet == Can.FILL_RX_BUFFER:
            self._put(data[0], data[1:])
        elif packet == Can.FILL_RX_BUFFER_LONG:
            self._put(int.from_bytes(data[:2], "big"), data[2:])
        elif packet == Can.PROCESS_SHORT_BUFFER:
            return data[2:]
        elif packet == Can.PROCESS_RX_BUFFER and len(data) >= 6:
            size, crc = unpack(">HH", data[2:6])
            payload = bytes(self._buffer[:size])
            self._buffer.clear()
            return payload if len(payload) == size and crc_hqx(payload, 0) == crc else None
        return None

    def _put(self, at: int, data: bytes) -> None:
        if len(self._buffer) < at:
            self._buffer.extend(bytes(at - len(self._buffer)))
        self._buffer[at : at + len(data)] = data


class VescMotors:
    """`Motors` that are VESC controllers, without a sensor at the motor."""

    def __init__(self, ids: Sequence[int], pole_pairs: int, signs: Sequence[int]) -> None:
        self.states = [MotorState() for _ in ids]
        self._ids = list(ids)
        self._erpm = [sign * pole_pairs * 30.0 / math.pi for sign in signs]
        """Electrical rpm per rad/s of a wheel."""
        self._reply = LongReply()
        self._problems = [_UNREAD] * len(self._ids)

    def questions(self) -> Sequence[Frame]:
        """Ask one controller for its settings, because replies have no sender until they end."""
        data = bytes([HOST_ID, 0, Comm.GET_APPCONF])
        for device, problem in zip(self._ids, self._problems, strict=True):
            if problem == _UNREAD:
                return [frame(Can.PROCESS_SHORT_BUFFER, device, data)]
        return []

    def problem(self, i: int) -> str:
        """Return why motor `i` must not be armed, or ""."""
        return self._problems[i]

    def drive(self, speeds: Sequence[float]) -> Sequence[Frame]:
        """Return the frames that turn the wheels; a speed of 0 releases a motor."""
        return [
            set_erpm(device, erpm * speed) if speed else release(device)
            for device, erpm, speed in zip(self._ids, self._erpm, speeds, strict=True)
        ]

    def stop(self, *, armed: bool) -> Sequence[Frame]:  # noqa: ARG002  Common signature.
        """Return the frames that release the motors."""
        return [release(device) for device in self._ids]

    def receive(self, frame: Frame, now_s: float) -> None:
        """Update the states."""
        packet, device = frame.id >> 8, frame.id & 0xFF
        if not frame.extended or frame.fd:
            return
        if device == HOST_ID:
            payload = self._reply.add(packet, frame.data)
            if payload and payload[0] == Comm.GET_APPCONF and len(payload) >= 22:
                self._check(payload[1:])
        elif device in self._ids and len(frame.data) == 8:
            self._update(self._ids.index(device), packet, frame.data, now_s)

    def _update(self, i: int, packet: int, data: bytes, now_s: float) -> None:
        state = self.states[i]
        if packet == Can.STATUS:
            erpm, tenths_a, _ = unpack(">ihh", data)
            state.speed_rad_per_s, state.current_a = erpm / self._erpm[i], tenths_a / 10.0
            state.heard_s = now_s
        elif packet == Can.STATUS_4:
            fet, _, _, _ = unpack(">hhhh", data)
            state.temperature_c = fet / 10.0
        elif packet == Can.STATUS_5:
            _, tenths_v, _ = unpack(">ihh", data)
            state.voltage_v = tenths_v / 10.0

    def _check(self, conf: bytes) -> None:
        """Check the beginning of a controller's settings."""
        _, device, timeout_ms, _, rate_1, rate_2, sent_1, sent_2 = unpack(">IBIIHHBB", conf[:19])
        if device not in self._ids:
            return
        i = self._ids.index(device)
        self.states[i].timeout_s = timeout_ms / 1000.0
        least, most = TIMEOUT_S
        sent = (sent_1 if rate_1 >= _LEAST_RATE_HZ else 0) | (
            sent_2 if rate_2 >= _LEAST_RATE_HZ else 0
        )
        if not least <= timeout_ms / 1000.0 <= most:
            self._problems[i] = (
                f"its time-out is {timeout_ms} ms: set {1000 * least:.0f} to {1000 * most:.0f} ms "
                "in VESC Tool (App Settings, General, Timeout)"
            )
        elif _NEEDED & ~sent:
            self._problems[i] = (
                "it does not send CAN status 1, 4 and 5 at 20 Hz or more: switch them on in VESC "
                "Tool (App Settings, General)"
            )
        else:
            self._problems[i] = ""
