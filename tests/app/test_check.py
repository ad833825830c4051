"""`tsd-bridge --check` in a real terminal, with simulated machines behind a real pty.

However the program ends, the robot must be disarmed, with goals that do not move.
"""

from __future__ import annotations

import math
import os
import pty
import select
import shutil
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.app.bridge_machine import Box, wait_until
from tests.support.programs import Program
from tests.support.robot_variants import WHEEL_ROBOTS
from tests.support.withheld import PATIENCE_S
from tsd_twin.hardware.commissioning.check import SLOW_RAD_PER_S
from tsd_twin.hardware.commissioning.sheet import Result, Sheet, read_sheet
from tsd_twin.hardware.commissioning.steps import Swing, Tilt, Turn, steps_for
from tsd_twin.hardware.dynamixel.control_table import BoardMode
from tsd_twin.robots import RobotDescription, load_robot

pytestmark = [pytest.mark.system, pytest.mark.busy]

Start = Callable[..., Program]
SETSID = str(shutil.which("setsid"))
ANY_PORT = ("--listen", "tcp/127.0.0.1:0")
PROMPTS = ("[y/n] ", ". ", ": ")
QUIET_S, STAYS_S = 0.05, 0.7
KIWI = "dynamixel_wheels"
ANSWERS = {
    "Resistance from + to -": "8000",
    "at the fuse holder": "12.4",
    "diode test": "0.6",
    "Resistance from the fuse of the drive": "15",
    "Voltage of the one BEC": "5.05",
    "board's 5 V pin": "0",
    "Mean voltage at D15": "4.9",
}


class Terminal:
    """Terminal window that runs a program as its controlling process."""

    def __init__(self, *arguments: str) -> None:
        self._master, slave = pty.openpty()
        modes = termios.tcgetattr(slave)
        modes[3] &= ~termios.ECHO
        termios.tcsetattr(slave, termios.TCSANOW, modes)
        self.process = subprocess.Popen(
            [SETSID, "--ctty", sys.executable, "-m", "tsd_bridge", *ANY_PORT, *arguments],
            stdin=slave,
            stdout=slave,
            stderr=slave,
        )
        os.close(slave)
        self.shown = ""
        self._open = True

    def question(self) -> str:
        """Return the next question, or "" if the program has ended."""
        end_s = time.monotonic() + PATIENCE_S
        while self._read(QUIET_S) or not self.shown.endswith(PROMPTS):
            assert time.monotonic() < end_s, self.shown
            if self.process.poll() is not None:
                return ""
        return self.shown.rpartition("\n")[2]

    def enter(self, answer: str) -> None:
        """Type a reply."""
        self.shown += answer + "\n"
        os.write(self._master, answer.encode() + b"\n")

    def close(self) -> None:
        """Close the window; the system notifies the program."""
        if self._open:
            self._open = False
            os.close(self._master)

    def _read(self, seconds: float) -> bool:
        if not select.select([self._master], [], [], seconds)[0]:
            return False
        try:
            data = os.read(self._master, 4096)
        except OSError:  # The program has closed its end.
            return False
        self.shown += data.decode().replace("\r", "")
        return bool(data)


@contextmanager
def checking(*arguments: str) -> Generator[Terminal]:
    terminal = Terminal(*arguments)
    try:
        yield terminal
    finally:
        terminal.process.kill()
        terminal.process.wait()
        terminal.close()


def begun(file: Path, robot: RobotDescription, kind: str, *left: str) -> None:
    """Write the sheet of a machine on which all motions but some have passed."""
    sheet = Sheet(robot.name, kind)
    for step in steps_for(kind, robot.kinematics().joints):
        if isinstance(step, (Tilt, Swing, Turn)) and step.name not in left:
            sheet.results.append(Result(step.name, "2026-01-01T00:00:00+00:00"))
    sheet.save(file)


ENDS: dict[str, Callable[[Terminal], object]] = {
    "SIGTERM": lambda it: it.process.terminate(),
    "SIGTERM twice": lambda it: (it.process.terminate(), it.process.send_signal(signal.SIGINT)),
    "terminal closed": Terminal.close,
    "SIGKILL": lambda it: it.process.kill(),
}


def answer_until(terminal: Terminal, part: str | None, act: Callable[[str], str]) -> None:
    """Answer all questions up to one with certain words, or until the program ends."""
    while (question := terminal.question()) and (part is None or part not in question):
        known = next((text for words, text in ANSWERS.items() if words in question), "")
        terminal.enter(known or act(question))
    assert question or part is None, terminal.shown


def keeps(file: Path, robot: RobotDescription, kind: str, before: str) -> None:
    """Check that a sheet keeps all results before a step, and has none for the step."""
    names = [step.name for step in steps_for(kind, robot.kinematics().joints)]
    results = read_sheet(file, robot.name, kind).results
    passed = [name for name in names[: names.index(before)] if name in {r.step for r in results}]
    assert passed == names[: names.index(before)]
    assert results[-1].step not in names[names.index(before) :]
    assert all(result.finding is None for result in results)


@pytest.mark.parametrize("end", ["SIGTERM", "terminal closed"])
def test_mega_is_left_at_rest_in_the_middle_of_a_tilt(box: Box, tmp_path: Path, end: str) -> None:
    interrupt_mega(box, tmp_path, "swing_module3_beta", "module3_beta tilts", end)


@pytest.mark.parametrize("end", ["SIGTERM twice", "SIGKILL"])
def test_mega_is_left_at_rest_while_a_wheel_turns(box: Box, tmp_path: Path, end: str) -> None:
    interrupt_mega(box, tmp_path, "turn_module1_wheel", "turns slowly", end)


@pytest.fixture(scope="module")
def box(start_shared: Start, tmp_path_factory: pytest.TempPathFactory) -> Box:
    """Compiled firmware, servos and motors."""
    port = str(tmp_path_factory.mktemp("box") / "port")
    return Box(start_shared("firmware.simulator", "--link", port, "--no-receiver"), port)


def interrupt_mega(box: Box, folder: Path, step: str, part: str, end: str) -> None:
    robot, file = load_robot("tsd"), folder / "sheet.json"
    begun(file, robot, "mega", step)

    def act(question: str) -> str:
        if "release start" in question or "Start again" in question:
            box.tell("contactor closed")
        elif "contactor open. " in question or "hard-wired stop" in question:
            box.tell("contactor open")
        return "12.0" if "Voltage of the battery" in question else "y"

    with checking("--port", box.port, "--check", str(file)) as terminal:
        answer_until(terminal, part, act)
        terminal.enter("y")
        tilts = step.startswith("swing")
        wait_until(lambda: not box.at_rest and (tilts or not box.shut_off), "a motion")
        ENDS[end](terminal)
        wait_until(lambda: box.at_rest and box.show()["mode"] == BoardMode.DISARMED, "rest")
        terminal.process.wait(PATIENCE_S)
    start_s = box.show()["time_s"]
    while (seen := box.show())["time_s"] < start_s + STAYS_S:
        assert box.at_rest
        assert seen["mode"] == BoardMode.DISARMED
    keeps(file, robot, "mega", step)


@pytest.fixture(scope="module")
def wheels(
    start_shared: Start, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Box, RobotDescription, str]:
    """Wheel servos of a kiwi, and its description."""
    folder = tmp_path_factory.mktemp("wheels")
    (folder / "robot.toml").write_text(WHEEL_ROBOTS["kiwi"].text)
    port = str(folder / "port")
    made = start_shared("tests.app.x_series_box", "--link", port)
    return Box(made, port), load_robot(str(folder / "robot.toml")), str(folder / "robot.toml")


@pytest.mark.parametrize("end", ["terminal closed", "SIGKILL"])
def test_kiwi_is_left_at_rest_while_a_wheel_turns(
    wheels: tuple[Box, RobotDescription, str], tmp_path: Path, end: str
) -> None:
    box, robot, description = wheels
    file = tmp_path / "sheet.json"
    begun(file, robot, KIWI, "turn_wheel2")
    arguments = ("--robot", description, "--servos", box.port, "--check", str(file))
    with checking(*arguments) as terminal:
        answer_until(terminal, "turns slowly", act_at_kiwi)
        terminal.enter("y")
        wait_until(lambda: box.show()["driven"] == [False, True, False], "a motion")
        ENDS[end](terminal)
        wait_until(lambda: not any(box.show()["driven"]), "rest")
        terminal.process.wait(PATIENCE_S)
    end_s = time.monotonic() + STAYS_S
    while time.monotonic() < end_s:
        assert not any(box.show()["driven"])
    keeps(file, robot, KIWI, "turn_wheel2")
    with checking(*arguments) as terminal:
        answer_until(terminal, None, act_at_kiwi)
        assert terminal.process.wait(PATIENCE_S) == 0, terminal.shown
    assert "Signature" in terminal.shown
    assert "FAIL" not in terminal.shown


def act_at_kiwi(question: str) -> str:
    if "Voltage of the battery" in question:
        return "11.1"
    if "Number of the wheel" in question:
        return "2"
    return f"{SLOW_RAD_PER_S * 30.0 / math.pi:.1f}" if "tachometer" in question else "y"
