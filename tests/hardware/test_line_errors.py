"""Bit errors on the line are counted as broken packets, and silence and delays are not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tests.support.virtual_robot import VirtualPort
from tests.support.virtual_time import VirtualClock
from tsd_twin.hardware import serial_transport as serial
from tsd_twin.hardware.dynamixel.packets import Decoder, Instruction, Packet, protocol2
from tsd_twin.hardware.serial_transport import SerialTransport

pytestmark = pytest.mark.computes

CYCLES = 120
DATA = bytes(range(1, 128))
REQUEST = protocol2.read(200, 0, len(DATA))
ANSWER = protocol2.encode(Packet(200, Instruction.STATUS, b"\0" + DATA))
PATIENCE_S = 0.03
_ANSWERS_AFTER_S = 0.002


class Line:
    """Device in virtual time that answers each request through a function."""

    def __init__(self, patch: pytest.MonkeyPatch, answer: Callable[[bytes], bytes]) -> None:
        self.clock = VirtualClock(patch)
        self.spoilt = 0
        self.delay_s = _ANSWERS_AFTER_S
        self._answer, self._decoder = answer, Decoder(protocol2)
        self._sent: list[tuple[float, bytes]] = []
        patch.setattr(serial, "open_port", self._open)
        self.transport = SerialTransport("line", 1_000_000)

    def _open(self, _name: str, _baud: int, timeout_s: float) -> VirtualPort:
        return VirtualPort(self.clock, timeout_s, self._hear, self._say)

    def _hear(self, data: bytes) -> None:
        for _ in self._decoder.feed(data, self.clock.now_s):
            sent = self._answer(ANSWER)
            self.spoilt += sent != ANSWER
            self._sent.append((self.clock.now_s + self.delay_s, sent))

    def _say(self) -> bytes:
        due = [sent for at_s, sent in self._sent if at_s <= self.clock.now_s]
        self._sent = self._sent[len(due) :]
        return b"".join(due)


@pytest.mark.parametrize("rate", [1e-4, 1e-3, 1e-2, 5e-2])
@pytest.mark.parametrize("seed", range(10, 15))
def test_answers_with_bit_errors_are_counted_as_broken(
    monkeypatch: pytest.MonkeyPatch, rate: float, seed: int
) -> None:
    random = np.random.default_rng(seed)

    def noisy(answer: bytes) -> bytes:
        bits = np.unpackbits(np.frombuffer(answer, np.uint8))
        return np.packbits(bits ^ (random.random(bits.size) < rate)).tobytes()

    line = Line(monkeypatch, noisy)
    right = 0
    for _ in range(CYCLES):
        found = line.transport.request(REQUEST, 1, PATIENCE_S)
        right += bool(found)
        assert all(answer.data == DATA for answer in found), "none is taken that was changed"
    line.transport.request(REQUEST, 1, PATIENCE_S)
    assert CYCLES - right >= (line.spoilt - 1) * 0.9
    assert 0.95 * (line.spoilt - 1) <= line.transport.broken <= line.spoilt


def test_a_device_that_says_nothing_is_silent_and_not_broken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    transport = Line(monkeypatch, lambda _: b"").transport
    for _ in range(20):
        assert not transport.request(REQUEST, 1, 0.01)
    assert transport.broken == 0


@pytest.mark.parametrize("missing", [1, 2, 3])
def test_devices_that_do_not_answer_beside_others_break_nothing(
    monkeypatch: pytest.MonkeyPatch, missing: int
) -> None:
    line = Line(monkeypatch, lambda answer: (3 - missing) * answer)
    for _ in range(20):
        assert len(line.transport.request(REQUEST, 3, PATIENCE_S)) == 3 - missing
    assert line.transport.broken == line.transport.late == 0


@pytest.mark.parametrize("part", [1, 4, 60, len(ANSWER) - 1])
def test_an_answer_whose_rest_comes_later_is_late_and_not_broken(
    monkeypatch: pytest.MonkeyPatch, part: int
) -> None:
    """As of a program that was held up within an answer."""
    kept: list[bytes] = []

    def halves(answer: bytes) -> bytes:
        before = kept.pop() if kept else b""
        kept.append(answer[part:])
        return before + answer[:part]

    line = Line(monkeypatch, halves)
    for _ in range(20):
        line.transport.request(REQUEST, 1, 0.01)
        line.clock.advance(0.002)
    assert line.transport.broken == 0


def test_an_answer_after_the_time_out_is_late_and_not_broken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    line = Line(monkeypatch, lambda answer: answer)
    line.delay_s = PATIENCE_S + 0.005
    for _ in range(20):
        line.transport.request(REQUEST, 1, PATIENCE_S)
        line.clock.advance(0.01)
    assert line.transport.broken == 0
    assert line.transport.late >= 18
