"""A board at a real pty, in real time; bounds add what the machine withholds from this process."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.hardware.test_mega import ROBOT
from tests.support.pty_devices import PretendBoard, plugged
from tests.support.withheld import Stopwatch
from tsd_twin.hardware.arduino_mega import ArduinoMegaIO
from tsd_twin.hardware.dynamixel.packets import protocol2
from tsd_twin.hardware.serial_transport import HardwareError
from tsd_twin.messages.codes import Code
from tsd_twin.simulation import Motors


def within(seconds: float, condition: Callable[[], object]) -> None:
    watch = Stopwatch()
    while not condition():
        assert watch.took_s < seconds
        time.sleep(0.002)


def code(robot: ArduinoMegaIO) -> str | None:
    fault = robot.fault(time.monotonic())
    return fault and fault.code


def test_an_unplugged_board_is_a_fault_and_is_found_again(tmp_path: Path) -> None:
    board = PretendBoard()
    with plugged(tmp_path, board) as peer:
        robot = ArduinoMegaIO(ROBOT, peer.port, Motors.of(ROBOT))
        peer.unplug()
        within(0.5, lambda: code(robot) == Code.DEVICE_DISCONNECTED)
        peer.plug_in()
        within(2.0, lambda: robot.hardware()["connected"])
        robot.close()
    assert board.commands[-1].arm == 0


def test_what_was_left_over_for_another_program_is_not_taken_for_an_answer(
    tmp_path: Path,
) -> None:
    board = PretendBoard()
    with plugged(tmp_path, board) as peer:
        with open(peer.port, "wb", buffering=0) as killed:  # noqa: PTH123
            for _ in range(3):
                killed.write(protocol2.read(200, 59, 95) + protocol2.ping(200))
            within(2.0, lambda: board.asked >= 6)
        robot = ArduinoMegaIO(ROBOT, peer.port, Motors.of(ROBOT))
        within(0.1, lambda: code(robot) is None)
        robot.close()


def test_two_on_one_port_is_refused_and_the_first_goes_on(tmp_path: Path) -> None:
    board = PretendBoard()
    with plugged(tmp_path, board) as peer:
        robot = ArduinoMegaIO(ROBOT, peer.port, Motors.of(ROBOT))
        with pytest.raises(HardwareError, match="in use by another program"):
            ArduinoMegaIO(ROBOT, peer.port, Motors.of(ROBOT))
        asked = board.asked
        within(0.5, lambda: board.asked > asked + 10 and not code(robot))
        robot.close()
