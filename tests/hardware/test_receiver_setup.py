"""A person is led through the set-up of a radio control, and each mistake is named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.support.faulty_devices import PretendBoard, plugged
from tsd_twin.hardware import HardwareError, ServoCalibration
from tsd_twin.hardware.joints import Receiver
from tsd_twin.hardware.receiver_setup import (
    PulseWatcher,
    learn_receiver,
    write_receiver,
)
from tsd_twin.hardware.serial_transport import SerialTransport

REST = (1510, 1495, 1500, 1104, 1900, 1100)
LOW = (1104, 1090, 1120, 1100, 1900, 1100)
HIGH = (1880, 1910, 1899, 1896, 1900, 1100)
LOST = (1500, 1500, 1500, 1104, 1000, 1100)


class Person:
    """Does at each step what it says, or makes a mistake."""

    def __init__(self, **mistakes: list[tuple[int, ...]]) -> None:
        self.shown: list[str] = []
        self._pulses = {"rest": [REST] * 5, "moved": [LOW, REST, HIGH], "lost": [LOST]} | mistakes
        self._steps = iter(self._pulses.values())

    def ask(self, text: str) -> None:
        self.shown.append(text)

    def watch(self, _: float) -> list[tuple[int, ...]]:
        return next(self._steps)


def without(pulses: tuple[int, ...], channel: int, value: int) -> tuple[int, ...]:
    return (*pulses[:channel], value, *pulses[channel + 1 :])


def test_end_points_and_rest_are_learned() -> None:
    person = Person()
    learned = learn_receiver(person.watch, person.ask)
    assert learned == Receiver(
        low_us=(1104, 1090, 1120, 1104), centre_us=REST[:4], high_us=HIGH[:4]
    )
    assert ["on" in person.shown[0], "both" in person.shown[1], "off" in person.shown[2]] == [
        True
    ] * 3


@pytest.mark.parametrize(
    ("mistakes", "message"),
    [
        ({"rest": [without(REST, 4, 0)] * 3}, "channel kill has no pulses"),
        ({"rest": [REST, without(REST, 1, 1600)]}, "channel left does not stand still"),
        ({"rest": [without(REST, 4, 1100)] * 3}, "the kill switch is on"),
        ({"rest": [without(REST, 5, 1900)] * 3}, "the manual switch is on"),
        ({"moved": [LOW, without(HIGH, 2, 1500)]}, "stick turn went from 1120 to 1500 us"),
        ({"moved": [LOW, without(HIGH, 3, 1104)]}, "stick speed went from 1100 to 1104 us"),
        ({"lost": [without(LOST, 4, 1900)]}, "set its fail-safe to kill"),
    ],
)
def test_a_mistake_is_named(mistakes: dict[str, list[tuple[int, ...]]], message: str) -> None:
    person = Person(**mistakes)
    with pytest.raises(HardwareError, match=message):
        learn_receiver(person.watch, person.ask)


def test_the_file_keeps_what_else_it_has(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    for text in ("", 'reversed = ["module1_beta"]\n\n[neutral_step]\nmodule1_alpha = 2061\n'):
        file.write_text(text)
        for low in (1100, 1120):
            write_receiver(Receiver(low_us=(low,) * 4), file)
            read = ServoCalibration.read(str(file))
            assert read.receiver == Receiver(low_us=(low,) * 4)
            assert bool(read.neutral_step) == bool(text)
            assert file.read_text().count("[receiver]") == 1


def test_pulses_are_read_from_a_board(tmp_path: Path) -> None:
    board = PretendBoard()
    board.telemetry = replace(board.telemetry, rc=REST)
    with plugged(tmp_path, board) as peer:
        transport = SerialTransport(peer.port, 1_000_000)
        assert set(PulseWatcher(transport, 1_000_000).watch(0.1)) == {REST}
        transport.close()
    assert not any(command.arm for command in board.commands)
