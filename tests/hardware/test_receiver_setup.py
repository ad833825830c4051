"""A person is led through the set-up of a radio control, and each mistake is named."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.pty_devices import PretendBoard, plugged
from tsd_twin.hardware.controller_board import find_board
from tsd_twin.hardware.dynamixel.control_table import Radio
from tsd_twin.hardware.joints import EscCalibration, Receiver, ServoCalibration
from tsd_twin.hardware.receiver_setup import (
    ask_line,
    learn_pulse_ends,
    learn_receiver,
    watch_channels,
    write_section,
)
from tsd_twin.hardware.serial_transport import HardwareError, SerialTransport

REST = (1510, 1495, 1500, 1104, 1900, 1100)
LOW = (1104, 1090, 1120, 1100, 1900, 1100)
HIGH = (1880, 1910, 1899, 1896, 1900, 1100)
LOST = (1500, 1500, 1500, 1104, 1000, 1100)
ORDER = (2, 0, 1, 7, 4, 11)
"""Channels of a transmitter, from 0, in the order of the functions."""


def changed(pulses: tuple[int, ...], channel: int, value: int) -> tuple[int, ...]:
    return (*pulses[:channel], value, *pulses[channel + 1 :])


def by_wires(pulses: tuple[int, ...]) -> tuple[int, ...]:
    return (*(0,) * 16, *pulses)


def by_sbus(pulses: tuple[int, ...]) -> tuple[int, ...]:
    channels = [1500] * 16
    for function, channel in enumerate(ORDER):
        channels[channel] = pulses[function]
    return (*channels, *(0,) * 6)


class Person:
    """Emulated user who follows each instruction, or makes one mistake."""

    def __init__(
        self,
        sent: Callable[[tuple[int, ...]], tuple[int, ...]] = by_wires,
        **mistakes: list[tuple[int, ...]],
    ) -> None:
        self.shown: list[str] = []
        self._pulses = {
            "rest": [REST] * 5,
            "forward": [changed(REST, 0, 1880)],
            "left": [changed(REST, 1, 1910)],
            "turn": [changed(REST, 2, 1899)],
            "speed": [changed(REST, 3, 1896)],
            "kill": [changed(REST, 4, 1100)],
            "manual": [changed(REST, 5, 1900)],
            "moved": [LOW, REST, HIGH],
            "back": [changed(REST, 1, 1510)],
            "lost": [LOST],
        } | mistakes
        self._sent = sent
        self._steps = iter(self._pulses.values())

    def ask(self, text: str) -> None:
        self.shown.append(text)

    def watch(self, _: float) -> list[tuple[int, ...]]:
        return [self._sent(pulses) for pulses in next(self._steps)]


@pytest.mark.parametrize(
    ("sent", "kind", "channels"),
    [(by_wires, "pulses", (1, 2, 3, 4, 5, 6)), (by_sbus, "sbus", (3, 1, 2, 8, 5, 12))],
)
def test_channels_end_points_rest_and_dead_band_are_learned(
    sent: Callable[[tuple[int, ...]], tuple[int, ...]], kind: str, channels: tuple[int, ...]
) -> None:
    person = Person(sent)
    learned = learn_receiver(person.watch, person.ask)
    assert (
        learned
        == Receiver(
            kind=kind,  # type: ignore[arg-type]
            channels=channels,  # type: ignore[arg-type]
            low_us=(1104, 1090, 1120, 1104),
            centre_us=REST[:4],
            high_us=HIGH[:4],
            dead_us=30,
        )
    )
    assert ["on" in person.shown[0], "both" in person.shown[7], "off" in person.shown[-1]] == [
        True
    ] * 3


@pytest.mark.parametrize(
    ("mistakes", "message"),
    [
        ({"rest": [(0,) * 6] * 3}, "no receiver is heard"),
        ({"rest": [changed(REST, 4, 0)] * 3}, "no pulses of channel 5"),
        ({"rest": [REST, changed(REST, 1, 1600)]}, "channel 2 does not stand still"),
        ({"left": [REST]}, "no channel moved for left"),
        ({"left": [changed(REST, 0, 1880)]}, "channel 1 moved for left, and for forward"),
        ({"turn": [changed(REST, 2, 1100)]}, "channel 3, turn, is turned round"),
        ({"kill": [changed(REST, 4, 2100)]}, "channel 5, kill, is turned round"),
        ({"kill": [changed(REST, 4, 1600)]}, "the switch kill does not pass 1500 us"),
        ({"moved": [LOW, changed(HIGH, 2, 1500)]}, "stick turn went from 1120 to 1500 us"),
        ({"moved": [LOW, changed(HIGH, 3, 1104)]}, "stick speed went from 1100 to 1104 us"),
        ({"back": [changed(REST, 0, 1570)]}, "stick forward does not return to its rest: 60 us"),
        ({"lost": [changed(LOST, 4, 1900)]}, "set its fail-safe to kill"),
    ],
)
def test_a_mistake_is_named(mistakes: dict[str, list[tuple[int, ...]]], message: str) -> None:
    person = Person(**mistakes)
    with pytest.raises(HardwareError, match=message):
        learn_receiver(person.watch, person.ask)


def test_two_receivers_at_once_are_named() -> None:
    person = Person(lambda pulses: (*by_sbus(pulses)[:16], *pulses))
    with pytest.raises(HardwareError, match="two receivers"):
        learn_receiver(person.watch, person.ask)


def test_pulse_ends_are_asked_for_and_checked() -> None:
    typed = iter(("", "1060 1940", "1100 1900.5"))
    learned = learn_pulse_ends(lambda _: next(typed))
    assert learned == EscCalibration((1000.0, 1060.0, 1100.0), (2000.0, 1940.0, 1900.5))
    assert learned.pulses_us((2000, 3000, 4000)) == [1000.0, 1500.0, 1900.5]
    for wrong in ("900 2000", "1500 2000", "1000 2300", "1000", "low high", "nan 2000"):
        with pytest.raises(HardwareError):
            learn_pulse_ends(lambda _, wrong=wrong: wrong)


@pytest.mark.parametrize(
    "text",
    ["channels = [1, 2, 3, 4, 5, 5]", "channels = [1, 2, 3, 4, 5, 7]", "kind = 'crsf'"],
)
def test_a_receiver_that_cannot_be_is_refused(text: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(f"[receiver]\n{text}\n")
    with pytest.raises(HardwareError, match="cannot be used as a calibration"):
        ServoCalibration.read(str(file))


def test_the_file_keeps_what_else_it_has(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    for text in ("", 'reversed = ["module1_beta"]\n\n[neutral_step]\nmodule1_alpha = 2061\n'):
        file.write_text(text)
        for low in (1100, 1120):
            receiver = Receiver(kind="sbus", channels=(1, 2, 3, 4, 16, 6), low_us=(low,) * 4)
            write_section("receiver", receiver, file)
            write_section("speed_controllers", EscCalibration((1000.0, low, 1000.0)), file)
            read = ServoCalibration.read(str(file))
            assert read.receiver == receiver
            assert read.speed_controllers.low_us[1] == low
            assert bool(read.neutral_step) == bool(text)
            assert file.read_text().count("[receiver]") == 1


def test_channels_are_read_from_a_board_whose_drive_is_off(tmp_path: Path) -> None:
    board = PretendBoard()
    board.report(drive_on=0)
    channels = Radio((1500,) * 16 + REST)
    board.table[Radio.ADDRESS : Radio.ADDRESS + Radio.LAYOUT.size] = channels.pack()
    with plugged(tmp_path, board) as peer:
        transport = SerialTransport(peer.port, 1_000_000)
        find_board(transport, 1_000_000)
        assert set(watch_channels(transport, 0.1)) == {channels.channel}
        board.report(drive_on=1)
        with pytest.raises(HardwareError, match="open the contactor first"):
            watch_channels(transport, 0.1)
        transport.close()
    assert not any(command.arm for command in board.commands)


def test_a_set_up_without_a_person_at_the_keyboard_ends_in_one_sentence(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    with pytest.raises(HardwareError, match="no input: the set-up needs a person"):
        learn_pulse_ends(ask_line)
