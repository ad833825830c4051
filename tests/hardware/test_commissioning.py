"""`tsd-bridge --check` at a simulated Mega: interruptions, wrong answers, faults in a motion."""

from __future__ import annotations

import math
import os
import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.hardware.wired_machines import Bench, Person, WiredMega
from tests.hardware.wiring_errors import TSD, MegaMachine, U2D2Machine
from tsd_twin.hardware.commissioning import findings, verdicts
from tsd_twin.hardware.commissioning.findings import FindingCode, found
from tsd_twin.hardware.commissioning.leaving import LEAVING, leave_on_signals
from tsd_twin.hardware.commissioning.sheet import Sheet, read_sheet
from tsd_twin.hardware.commissioning.steps import Turn, steps_for
from tsd_twin.hardware.commissioning.walk import Commissioned
from tsd_twin.hardware.dynamixel.control_table import ESCS, SERVOS, ZERO_THROTTLE, BoardCommand
from tsd_twin.hardware.joints import JointConverter
from tsd_twin.hardware.serial_transport import HardwareError
from tsd_twin.simulation import Motors

pytestmark = pytest.mark.computes
JUMP_STEPS = 5
"""Largest change of a goal, also after a missed response: half a degree."""
STEP_RAD = 2.0 * math.pi / 4096.0
SLOWEST = np.tile([0.0, 0.0, TSD.wheel_speed_range.least_rad_per_s], 3)


@pytest.fixture
def it(monkeypatch: pytest.MonkeyPatch) -> MegaMachine:
    return MegaMachine(Bench(monkeypatch))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "sheet.json"


def last(file: Path) -> tuple[str, str]:
    """Return step and code of the last result, "" if it passed."""
    result = read_sheet(file, "tsd", "mega").results[-1]
    return result.step, result.finding.code if result.finding else ""


def check_mega(file: Path, it: MegaMachine) -> tuple[bool, list[str]]:
    """Walk through the steps, and check that nothing moved unasked, fast or together."""
    try:
        return it.check(file)
    finally:
        assert not it.board.moved_unasked
        assert not it.driven
        moves_one_joint_slowly(it.board.commands)


def moves_one_joint_slowly(commands: list[BoardCommand]) -> None:
    """Check that commands tilt one gimbal slowly or turn one wheel at the lowest speed."""
    goals = np.array([command.goal for command in commands]).reshape(-1, SERVOS)
    throttles = np.array([command.throttle for command in commands]).reshape(-1, ESCS)
    driven = np.hstack([goals != 0, throttles > ZERO_THROTTLE])
    assert driven.sum(axis=1).max(initial=0) <= 1
    assert abs(goals).max(initial=0) <= round(math.radians(verdicts.SWING_DEG) / STEP_RAD)
    assert np.diff(abs(goals), axis=0).max(initial=0) <= JUMP_STEPS
    slowest = max(JointConverter(TSD, Motors.of(TSD)).throttles(SLOWEST))
    assert throttles.max(initial=0) <= slowest


def test_page_lists_all_steps(it: MegaMachine, file: Path) -> None:
    ok, said = check_mega(file, it)
    assert ok, said[-2]
    page = next(text for text in said if "Signature" in text)
    assert all(f"  {step.name} " in page for step in it.steps())
    assert "FAIL" not in page


def test_motors_are_plugged_in_after_all_else() -> None:
    for machine in (MegaMachine, U2D2Machine):
        steps = steps_for(machine.kind, TSD.kinematics().joints)
        plugged = next(i for i, step in enumerate(steps) if step.name == "plugged")
        assert {type(step) for step in steps[plugged + 1 :] if step.name != "restarted"} == {Turn}
        assert not any(isinstance(step, Turn) for step in steps[:plugged])


@pytest.mark.parametrize("end", [KeyboardInterrupt, HardwareError])
def test_interrupted_walk_leaves_wheels_off_and_continues(
    it: MegaMachine, file: Path, end: type[BaseException]
) -> None:
    it.begin(file, "swing_module3_beta")

    def interrupt(question: str) -> None:
        if "Number of the wheel" in question:
            assert not it.driven, "disarmed while a question is open"
            raise end

    it.person.interrupt = interrupt
    with pytest.raises(end):
        check_mega(file, it)
    assert last(file) == ("restarted", "")
    it.person.interrupt = None
    it.person.shown.clear()
    it.board.stop()
    ok, said = check_mega(file, it)
    assert ok, said[-2]
    assert not any("module3_beta tilts" in question for question in it.person.shown)


def test_signal_while_connecting_closes_the_connection(
    it: MegaMachine, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    connect = it.connect

    def interrupted() -> Commissioned:
        io = connect()
        os.kill(os.getpid(), signal.SIGTERM)
        assert it.person.bench.idle, "connected"
        return io

    monkeypatch.setattr(it, "connect", interrupted)
    before = {number: signal.getsignal(number) for number in LEAVING}
    leave_on_signals()
    try:
        with pytest.raises(SystemExit) as ended:
            check_mega(file, it)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    assert ended.value.code == 128 + signal.SIGTERM
    assert not it.person.bench.idle, "closed"
    assert last(file) == ("sbus_level", "")


@pytest.mark.parametrize("answer", ["n", "", "1", "yes please"])
def test_motion_that_is_not_agreed_to_moves_nothing(
    it: MegaMachine, file: Path, answer: str
) -> None:
    it.begin(file, "swing_module1_alpha")
    it.person.answers["module1_alpha tilts"] = answer
    ok, _ = check_mega(file, it)
    assert not ok
    assert last(file) == ("swing_module1_alpha", FindingCode.DECLINED)
    assert not any(command.arm == 1 for command in it.board.commands)


@pytest.mark.parametrize(
    "harm",
    [
        lambda it: setattr(it.board, "silent", True),
        lambda it: setattr(it.board, "late", 1),
        lambda it: it.telemetry(servo_alive=0b111110),
    ],
    ids=["board silent", "answers late", "servo silent"],
)
@pytest.mark.parametrize("step", ["swing_module1_alpha", "turn_module1_wheel"])
def test_fault_during_a_motion_ends_it(
    it: MegaMachine, file: Path, step: str, harm: Callable[[MegaMachine], None]
) -> None:
    it.begin(file, step)
    harmed_s: list[float] = []
    off_s: list[float] = []

    def watch(now_s: float) -> None:
        if it.driven and not harmed_s and moving(it.board):
            harmed_s.append(now_s)
            harm(it)
        if harmed_s and not off_s and not it.driven:
            off_s.append(now_s)

    it.person.bench.clock.machines.append(watch)
    ok, said = check_mega(file, it)
    assert not ok
    assert last(file) == (step, FindingCode.FAULT), said[-2]
    assert off_s[0] - harmed_s[0] < 0.3


def moving(board: WiredMega) -> bool:
    return any(board.commands[-1].goal) or max(board.commands[-1].throttle) > ZERO_THROTTLE


def test_what_is_not_a_number_is_asked_again(it: MegaMachine, file: Path) -> None:
    it.begin(file, "turn_module1_wheel")
    asked: dict[str, int] = {}
    nonsense = ("", "nan", "inf", "two")
    person = it.person

    def ask(question: str) -> str:
        if question.endswith(("[y/n] ", ". ")):
            return Person.ask(person, question)
        number = asked[question] = asked.get(question, -1) + 1
        return nonsense[number] if number < len(nonsense) else Person.ask(person, question)

    person.ask = ask
    ok, said = check_mega(file, it)
    assert ok, said[-2]
    assert said.count("Enter a number.") == len(nonsense) * len(asked)


def test_sheet_of_another_machine_is_refused(file: Path) -> None:
    Sheet("tsd", "mega").save(file)
    with pytest.raises(HardwareError, match=r"sheet of tsd \(mega\), not of kiwi"):
        read_sheet(file, "kiwi", "can")
    file.write_text("{")
    with pytest.raises(HardwareError, match="is not a commissioning sheet"):
        read_sheet(file, "tsd", "mega")


def test_each_code_has_a_sentence() -> None:
    assert set(findings.SENTENCES) == set(FindingCode)
    assert "5.6 V" in found(FindingCode.DRIVE_ON, value=5.6).sentence()


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_values_that_are_not_finite_fail(value: float) -> None:
    assert verdicts.measured(value, 0.0, 1.0, "V", "")
    assert verdicts.speed(1, value, 100.0, measured=True)
    reading = verdicts.Reading({"battery_v": value, "drive_v": value}, np.zeros(9))
    assert verdicts.battery([reading], 12.0)
    assert verdicts.drive_closed([reading])
