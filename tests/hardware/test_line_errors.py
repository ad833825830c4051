"""Bit errors on the line are counted as broken packets, and silence and delays are not."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.support.faulty_devices import Peer
from tsd_twin.hardware.dynamixel.packets import Decoder, Instruction, Packet, protocol2
from tsd_twin.hardware.serial_transport import SerialTransport

CYCLES = 120
DATA = bytes(range(1, 128))
REQUEST = protocol2.read(200, 0, len(DATA))
ANSWER = protocol2.encode(Packet(200, Instruction.STATUS, b"\0" + DATA))
PATIENCE_S = 0.03


class Line:
    """Device that answers each request through a function."""

    def __init__(self, folder: Path, answer: Callable[[bytes], bytes]) -> None:
        self.spoilt = 0
        self._answer, self._decoder = answer, Decoder(protocol2)
        self.peer = Peer(folder / "line", self.respond)

    def respond(self, data: bytes, now_s: float) -> bytes:
        out = b""
        for _ in self._decoder.feed(data, now_s):
            sent = self._answer(ANSWER)
            self.spoilt += sent != ANSWER
            out += sent
        return out


@pytest.mark.parametrize("rate", [1e-4, 1e-3, 1e-2, 5e-2])
def test_answers_with_bit_errors_are_counted_as_broken(tmp_path: Path, rate: float) -> None:
    random = np.random.default_rng(5)

    def noisy(answer: bytes) -> bytes:
        bits = np.unpackbits(np.frombuffer(answer, np.uint8))
        return np.packbits(bits ^ (random.random(bits.size) < rate)).tobytes()

    line = Line(tmp_path, noisy)
    transport = SerialTransport(line.peer.port, 1_000_000)
    try:
        right = 0
        for _ in range(CYCLES):
            found = transport.request(REQUEST, 1, PATIENCE_S)
            right += bool(found)
            assert all(answer.data == DATA for answer in found), "none is taken that was changed"
        transport.request(REQUEST, 1, PATIENCE_S)
    finally:
        transport.close()
        line.peer.unplug()
    missed = CYCLES - right
    assert missed >= (line.spoilt - 1) * 0.9
    # A busy machine that holds up an answer makes it late, and not broken.
    assert transport.broken >= 0.95 * (line.spoilt - 1)
    assert transport.broken <= line.spoilt + 0.05 * CYCLES


def test_a_device_that_says_nothing_is_silent_and_not_broken(tmp_path: Path) -> None:
    line = Line(tmp_path, lambda _: b"")
    transport = SerialTransport(line.peer.port, 1_000_000)
    try:
        for _ in range(20):
            assert not transport.request(REQUEST, 1, 0.01)
    finally:
        transport.close()
        line.peer.unplug()
    assert transport.broken == 0


def test_an_answer_whose_rest_comes_later_is_late_and_not_broken(tmp_path: Path) -> None:
    """As of a program that was held up within an answer."""
    kept: list[bytes] = []

    def halves(answer: bytes) -> bytes:
        before = kept.pop() if kept else b""
        kept.append(answer[60:])
        return before + answer[:60]

    line = Line(tmp_path, halves)
    transport = SerialTransport(line.peer.port, 1_000_000)
    for _ in range(20):
        transport.request(REQUEST, 1, 0.01)
        time.sleep(0.002)
    transport.close()
    line.peer.unplug()
    assert transport.broken == 0
