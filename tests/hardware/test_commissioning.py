"""`tsd-bridge --check` finds each wiring error of the simulated machines at its step."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.hardware.test_mega import ROBOT
from tests.support.servo_chain import ServoChain
from tests.support.wired_machines import (
    Bench,
    Person,
    VirtualMotors,
    WatchedMotor,
    WatchedServo,
    WiredMega,
)
from tests.support.x_series import XBus
from tsd_twin.hardware.arduino_mega import ArduinoMegaIO
from tsd_twin.hardware.can_wheels import CanWheelsIO
from tsd_twin.hardware.commissioning import findings, verdicts
from tsd_twin.hardware.commissioning.check import check
from tsd_twin.hardware.commissioning.findings import FindingCode, found
from tsd_twin.hardware.commissioning.sheet import Result, Sheet, read_sheet
from tsd_twin.hardware.commissioning.steps import Swing, Tilt, Turn, steps_for
from tsd_twin.hardware.commissioning.walk import Commissioned
from tsd_twin.hardware.dynamixel.control_table import ESCS, SERVOS, ZERO_THROTTLE, BoardCommand
from tsd_twin.hardware.dynamixel_wheels import DynamixelWheelsIO
from tsd_twin.hardware.joints import (
    JointConverter,
    MotorControllers,
    Receiver,
    ServoCalibration,
)
from tsd_twin.hardware.serial_transport import HardwareError
from tsd_twin.hardware.u2d2 import U2D2IO
from tsd_twin.robots import OmniDescription, description_of_kind, load_robot
from tsd_twin.simulation import Motors

KIWI = description_of_kind(load_robot("examples/kiwi_xl430.toml"), OmniDescription)
CALIBRATION = ServoCalibration(receiver=Receiver())
SLOWEST = np.tile([0.0, 0.0, ROBOT.wheel_speed_range.least_rad_per_s], 3)
JUMP_STEPS = 5
"""Largest change of a goal, also after a missed response: half a degree."""
STEP_RAD = 2.0 * math.pi / 4096.0
RPM = ROBOT.wheel_speed_range.least_rad_per_s * 30.0 / math.pi


def passed(robot: str, kind: str, file: Path, *, until: str, receiver: bool = True) -> None:
    """Write the sheet of a machine that passed all motions before a step."""
    joints = (KIWI if kind == "dynamixel_wheels" else ROBOT).kinematics().joints
    sheet = Sheet(robot, kind)
    for step in steps_for(kind, joints, receiver=receiver):
        if step.name == until:
            break
        if isinstance(step, (Tilt, Swing, Turn)):
            sheet.results.append(Result(step.name, "2026-01-01T00:00:00+00:00"))
    sheet.save(file)


def last(file: Path, robot: str, kind: str) -> tuple[str, str]:
    """Return step and code of the last result, "" if it passed."""
    result = read_sheet(file, robot, kind).results[-1]
    return result.step, result.finding.code if result.finding else ""


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    return Bench(monkeypatch)


def check_mega(folder: Path, board: WiredMega, person: Person) -> tuple[bool, list[str]]:
    said: list[str] = []
    person.mega, person.rpm = board, RPM
    person.bench.ports["board"] = board.answer
    try:
        ok = check(
            ROBOT,
            "mega",
            folder / "sheet.json",
            lambda: ArduinoMegaIO(ROBOT, "board", Motors.of(ROBOT), CALIBRATION),
            receiver=True,
            ask=person.ask,
            say=said.append,
        )
    finally:
        assert not board.moved_unasked
        assert not board.commands or board.commands[-1].arm == 0
        moves_one_joint_slowly(board.commands)
    return ok, said


def moves_one_joint_slowly(commands: list[BoardCommand]) -> None:
    """Check that commands tilt one gimbal slowly or turn one wheel at the lowest speed."""
    goals = np.array([command.goal for command in commands]).reshape(-1, SERVOS)
    throttles = np.array([command.throttle for command in commands]).reshape(-1, ESCS)
    driven = np.hstack([goals != 0, throttles > ZERO_THROTTLE])
    assert driven.sum(axis=1).max(initial=0) <= 1
    assert abs(goals).max(initial=0) <= round(math.radians(verdicts.SWING_DEG) / STEP_RAD)
    assert np.diff(abs(goals), axis=0).max(initial=0) <= JUMP_STEPS
    slowest = max(JointConverter(ROBOT, Motors.of(ROBOT)).throttles(SLOWEST))
    assert throttles.max(initial=0) <= slowest


def test_sound_mega_passes_and_its_page_lists_all_steps(bench: Bench, tmp_path: Path) -> None:
    ok, said = check_mega(tmp_path, WiredMega(), Person(bench))
    assert ok, said[-2]
    page = next(text for text in said if "Signature" in text)
    for step in steps_for("mega", ROBOT.kinematics().joints, receiver=True):
        assert f"  {step.name} " in page
    assert "FAIL" not in page


def _set(**values: object) -> Callable[[WiredMega], None]:
    def apply(board: WiredMega) -> None:
        for name, value in values.items():
            setattr(board, name, value)

    return apply


def _telemetry(**values: object) -> Callable[[WiredMega], None]:
    def apply(board: WiredMega) -> None:
        board.telemetry = replace(board.telemetry, **values)  # type: ignore[arg-type]

    return apply


SWAPPED = [1, 0, 2, 3, 4, 5]
MEGA_ERRORS: list[tuple[str, FindingCode, dict[str, str], Callable[[WiredMega], None]]] = [
    ("short_circuit", FindingCode.MEASURED, {"Resistance from + to -": "0.4"}, _set()),
    ("polarity", FindingCode.MEASURED, {"at the fuse holder": "-12.4"}, _set()),
    ("coil_diode", FindingCode.MEASURED, {"minus end": "9"}, _set()),
    ("coil_zener", FindingCode.MEASURED, {"plus end": "9"}, _set()),
    ("precharge", FindingCode.MEASURED, {"precharge button": "1e6"}, _set()),
    ("regulator", FindingCode.MEASURED, {"board's 5 V wire off": "6.1"}, _set()),
    ("second_supply", FindingCode.MEASURED, {"board's 5 V pin": "5.0"}, _set()),
    ("usb_supply", FindingCode.NOT_CONFIRMED, {"are all lights": "n"}, _set()),
    ("sbus_level", FindingCode.MEASURED, {"Mean voltage at D15": "0.3"}, _set()),
    ("connection", FindingCode.NO_CONNECTION, {}, _set(silent=True)),
    ("board_supply", FindingCode.BOARD_SUPPLY, {}, _telemetry(supply_mv=4500)),
    ("drive_open", FindingCode.DRIVE_ON, {}, _set(welded=True)),
    ("drive_open", FindingCode.DRIVE_ON, {}, _set(a1_upstream=True)),
    ("receiver", FindingCode.NO_RECEIVER, {}, _telemetry(rc=(0,) * 6)),
    ("battery", FindingCode.BATTERY_DIFFERS, {}, _set(divider=0.8)),
    ("servos", FindingCode.SERVO_SILENT, {}, _telemetry(servo_alive=0b110111)),
    ("servos", FindingCode.SERVO_SUPPLY, {}, _telemetry(voltage=(120, 120, 120, 100, 120, 120))),
    ("line", FindingCode.LINE_ERRORS, {}, _set(noise=1)),
    ("warnings", FindingCode.WARNING, {}, WiredMega.young),
    ("faults", FindingCode.FAULT, {}, _telemetry(servo_far=2)),
    ("tilt_module1_alpha", FindingCode.JOINT_SWAPPED, {}, _set(servo_order=SWAPPED)),
    ("tilt_module1_beta", FindingCode.JOINT_REVERSED, {}, _set(servo_signs=[1, -1, 1, 1, 1, 1])),
    ("start", FindingCode.DRIVE_OFF, {}, _set(drive_fuse=False)),
    ("start", FindingCode.DRIVE_OFF, {}, _set(no_seal_in=True)),
    ("stop_opens", FindingCode.DRIVE_ON, {}, _set(recloses=True)),
    ("stop_opens", FindingCode.DRIVE_ON, {}, _set(ineffective_stop=True)),
    ("coil_supply", FindingCode.NOT_CONFIRMED, {"Pull the fuse": "n"}, _set()),
    ("esc_zero", FindingCode.NOT_CONFIRMED, {"beep once for zero": "n"}, _set()),
    ("turn_module1_wheel", FindingCode.WHEEL_SWAPPED, {}, _set(esc_order=[1, 0, 2])),
    ("turn_module1_wheel", FindingCode.WHEEL_REVERSED, {}, _set(esc_signs=[-1, 1, 1])),
    ("turn_module1_wheel", FindingCode.WHEEL_SPEED, {}, _set(speed_factor=2.0)),
]


@pytest.mark.parametrize(("step", "code", "answers", "harm"), MEGA_ERRORS)
def test_mega_error_is_found_at_its_step(
    bench: Bench,
    tmp_path: Path,
    step: str,
    code: FindingCode,
    answers: dict[str, str],
    harm: Callable[[WiredMega], None],
) -> None:
    board = WiredMega()
    harm(board)
    file = tmp_path / "sheet.json"
    names = [it.name for it in steps_for("mega", ROBOT.kinematics().joints, receiver=True)]
    if names.index(step) > names.index("tilt_module1_beta"):
        passed("tsd", "mega", file, until=step)
    ok, said = check_mega(tmp_path, board, Person(bench, answers))
    assert not ok
    assert last(file, "tsd", "mega") == (step, code), said[-2]
    if names.index(step) < names.index("swing_module1_alpha"):
        assert not any(command.arm == 1 for command in board.commands)


@pytest.mark.parametrize("end", [KeyboardInterrupt, HardwareError])
def test_interrupted_walk_leaves_wheels_off_and_continues(
    bench: Bench, tmp_path: Path, end: type[BaseException]
) -> None:
    file, board = tmp_path / "sheet.json", WiredMega()
    passed("tsd", "mega", file, until="swing_module3_beta")

    def interrupt(question: str) -> None:
        if "Number of the wheel" in question:
            assert board.commands[-1].arm == 0, "disarmed while a question is open"
            raise end

    with pytest.raises(end):
        check_mega(tmp_path, board, Person(bench, interrupt=interrupt))
    assert last(file, "tsd", "mega") == ("restarted", "")
    person = Person(bench)
    ok, _ = check_mega(tmp_path, WiredMega(), person)
    assert ok
    assert not any("module3_beta tilts" in question for question in person.shown)


@pytest.mark.parametrize("answer", ["n", "", "1", "yes please"])
def test_motion_that_is_not_agreed_to_moves_nothing(
    bench: Bench, tmp_path: Path, answer: str
) -> None:
    file, board = tmp_path / "sheet.json", WiredMega()
    passed("tsd", "mega", file, until="swing_module1_alpha")
    ok, _ = check_mega(tmp_path, board, Person(bench, {"module1_alpha tilts": answer}))
    assert not ok
    assert last(file, "tsd", "mega") == ("swing_module1_alpha", FindingCode.DECLINED)
    assert not any(command.arm == 1 for command in board.commands)


@pytest.mark.parametrize(
    "harm",
    [
        lambda board: setattr(board, "silent", True),
        lambda board: setattr(board, "late", 1),
        lambda board: setattr(board, "telemetry", replace(board.telemetry, servo_alive=0b111110)),
    ],
    ids=["board silent", "answers late", "servo silent"],
)
@pytest.mark.parametrize("step", ["swing_module1_alpha", "turn_module1_wheel"])
def test_fault_during_a_motion_ends_it(
    bench: Bench, tmp_path: Path, step: str, harm: Callable[[WiredMega], None]
) -> None:
    file, board = tmp_path / "sheet.json", WiredMega()
    passed("tsd", "mega", file, until=step)
    harmed_s: list[float] = []
    off_s: list[float] = []

    def watch(now_s: float) -> None:
        moves = bool(board.commands) and board.commands[-1].arm == 1 and moving(board.commands[-1])
        if moves and not harmed_s:
            harmed_s.append(now_s)
            harm(board)
        if harmed_s and not off_s and board.commands[-1].arm == 0:
            off_s.append(now_s)

    bench.clock.machines.append(watch)
    ok, said = check_mega(tmp_path, board, Person(bench))
    assert not ok
    assert last(file, "tsd", "mega") == (step, FindingCode.FAULT), said[-2]
    assert off_s[0] - harmed_s[0] < 0.3


def moving(command: BoardCommand) -> bool:
    return any(command.goal) or max(command.throttle) > ZERO_THROTTLE


def test_what_is_not_a_number_is_asked_again(bench: Bench, tmp_path: Path) -> None:
    file = tmp_path / "sheet.json"
    passed("tsd", "mega", file, until="turn_module1_wheel")
    person, asked = Person(bench), dict[str, int]()
    nonsense = ("", "nan", "inf", "two")

    def ask(question: str) -> str:
        if question.endswith(("[y/n] ", ". ")):
            return Person.ask(person, question)
        number = asked[question] = asked.get(question, -1) + 1
        return nonsense[number] if number < len(nonsense) else Person.ask(person, question)

    person.ask = ask  # type: ignore[method-assign]
    ok, said = check_mega(tmp_path, WiredMega(), person)
    assert ok, said[-2]
    assert said.count("Enter a number.") >= len(nonsense) * 9


class BusWheels:
    """Kiwi with wheels on a Dynamixel bus."""

    def __init__(self, bench: Bench) -> None:
        self.servos = [WatchedServo(i) for i in (1, 2, 3)]
        self.person = Person(bench, {"Voltage of the battery": "11.1"}, wheels=self.servos)


def _swap_ids(it: BusWheels) -> None:
    it.person.wheels = [it.servos[1], it.servos[0], it.servos[2]]


def _reverse(it: BusWheels) -> None:
    it.person.wheel_signs = (1, -1, 1)


def _low(it: BusWheels) -> None:
    it.servos[2].volts = 10.0


def _dead(it: BusWheels) -> None:
    it.servos[1].dead = True


def _equal_ids(it: BusWheels) -> None:
    it.servos[1].id = 1
    it.servos[1].put(7, 1, 1)


def _wrong_model(it: BusWheels) -> None:
    it.servos[1].put(0, 2, 311)


def _volts(it: BusWheels) -> None:
    it.person.answers["Voltage of the battery"] = "12.4"


def _reversed_supply(it: BusWheels) -> None:
    it.person.answers["at the fuse holder"] = "-11.1"


def _stop_recloses(it: BusWheels) -> None:
    it.person.answers["Press the stop: did"] = "n"


@pytest.mark.parametrize(
    ("harm", "step", "code"),
    [
        (None, "turn_wheel3", ""),
        (_reversed_supply, "polarity", FindingCode.MEASURED),
        (_dead, "connection", FindingCode.NO_CONNECTION),
        (_equal_ids, "connection", FindingCode.NO_CONNECTION),
        (_wrong_model, "connection", FindingCode.NO_CONNECTION),
        (_volts, "battery", FindingCode.BATTERY_DIFFERS),
        (_low, "servos", FindingCode.SERVO_SUPPLY),
        (_swap_ids, "turn_wheel1", FindingCode.WHEEL_SWAPPED),
        (_reverse, "turn_wheel2", FindingCode.WHEEL_REVERSED),
        (_stop_recloses, "stop", FindingCode.NOT_CONFIRMED),
    ],
)
def test_bus_wheel_error_is_found_at_its_step(
    bench: Bench, tmp_path: Path, harm: Callable[[BusWheels], None] | None, step: str, code: str
) -> None:
    it, file = BusWheels(bench), tmp_path / "sheet.json"
    if harm is not None:
        harm(it)
    bench.ports["servos"] = XBus(list(it.servos)).answer
    bench.watch(it.servos)
    said: list[str] = []
    check(
        KIWI,
        "dynamixel_wheels",
        file,
        lambda: DynamixelWheelsIO(KIWI, "servos"),
        ask=it.person.ask,
        say=said.append,
    )
    assert last(file, KIWI.name, "dynamixel_wheels") == (step, code), said[-2:]
    assert not any(servo.goal for servo in it.servos)
    assert bench.most_driven <= 1


class CanMachine:
    """Gimbals on a U2D2, and wheels with VESC."""

    def __init__(self, bench: Bench, ids: tuple[int, ...] = (1, 2, 3, 4, 5, 6)) -> None:
        self.chain = ServoChain(ids=ids)
        self.motors = [WatchedMotor(i, "vesc") for i in (1, 2, 3)]
        self.person = Person(
            bench, {"Voltage of the battery": "24.0"}, chain=self.chain, wheels=self.motors
        )


def _servo_missing(it: CanMachine) -> None:
    it.chain.servos[3].dead = True


def _servo_model(it: CanMachine) -> None:
    it.chain.servos[1]._memory[0:2] = (1060).to_bytes(2, "little")


def _motor_missing(it: CanMachine) -> None:
    it.motors[1].mute = it.motors[1].deaf = True


def _bus_silent(it: CanMachine) -> None:
    for motor in it.motors:
        motor.mute = motor.deaf = True


def _dead_man_off(it: CanMachine) -> None:
    it.motors[0].timeout_s = 0.0


def _no_status(it: CanMachine) -> None:
    it.motors[2].status = 0


def _unterminated(it: CanMachine) -> None:
    it.person.answers["CAN high"] = "120"


def _motor_equal_ids(it: CanMachine) -> None:
    it.motors[1].id = 1


def _gimbal_reversed(it: CanMachine) -> None:
    it.person.push_sign = -1


def _controller_branch(it: CanMachine) -> None:
    it.motors[1].volts = 22.0


def _servo_branch(it: CanMachine) -> None:
    it.chain.servos[4].volts = 10.5


def _motors_swapped(it: CanMachine) -> None:
    it.person.wheels = [it.motors[1], it.motors[0], it.motors[2]]


def _motor_reversed(it: CanMachine) -> None:
    it.person.wheel_signs = (-1, 1, 1)


def _poles(it: CanMachine) -> None:
    it.motors[0].pole_pairs = 14


@pytest.mark.parametrize(
    ("harm", "step", "code"),
    [
        (None, "turn_module3_wheel", ""),
        (_unterminated, "termination", FindingCode.MEASURED),
        (_servo_missing, "connection", FindingCode.NO_CONNECTION),
        (_servo_model, "connection", FindingCode.NO_CONNECTION),
        ((1, 1, 3, 4, 5, 6), "connection", FindingCode.NO_CONNECTION),
        (_motor_missing, "connection", FindingCode.NO_CONNECTION),
        (_motor_equal_ids, "connection", FindingCode.NO_CONNECTION),
        (_bus_silent, "connection", FindingCode.NO_CONNECTION),
        (_dead_man_off, "connection", FindingCode.NO_CONNECTION),
        (_no_status, "connection", FindingCode.NO_CONNECTION),
        (_servo_branch, "servos", FindingCode.SERVO_SUPPLY),
        (_controller_branch, "controllers", FindingCode.CONTROLLER_SUPPLY),
        ((2, 1, 3, 4, 5, 6), "tilt_module1_alpha", FindingCode.JOINT_SWAPPED),
        (_gimbal_reversed, "tilt_module1_alpha", FindingCode.JOINT_REVERSED),
        (_motors_swapped, "turn_module1_wheel", FindingCode.WHEEL_SWAPPED),
        (_motor_reversed, "turn_module1_wheel", FindingCode.WHEEL_REVERSED),
        (_poles, "turn_module1_wheel", FindingCode.WHEEL_SPEED),
    ],
)
def test_can_machine_error_is_found_at_its_step(
    bench: Bench,
    tmp_path: Path,
    harm: Callable[[CanMachine], None] | tuple[int, ...] | None,
    step: str,
    code: str,
) -> None:
    file = tmp_path / "sheet.json"
    it = CanMachine(bench, harm) if isinstance(harm, tuple) else CanMachine(bench)
    if callable(harm):
        harm(it)
    if step == "turn_module1_wheel":
        passed("tsd", "u2d2+can", file, until=step)
    bench.motors = VirtualMotors(bench.clock, it.motors)
    bench.ports["servos"] = it.chain.answer
    bench.watch(it.motors)
    said: list[str] = []

    def connect() -> Commissioned:
        wheels = CanWheelsIO(ROBOT, "virtual:", MotorControllers("vesc", [1, 2, 3]))
        return U2D2IO(ROBOT, wheels, "servos", Motors.of(ROBOT), ServoCalibration())

    check(ROBOT, "u2d2+can", file, connect, ask=it.person.ask, say=said.append)
    assert last(file, "tsd", "u2d2+can") == (step, code), said[-2:]
    assert not bench.motors.driven
    assert bench.most_driven <= 1


def test_sheet_of_another_machine_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "sheet.json"
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
