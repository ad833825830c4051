"""Wheels with VESC and moteus on a CAN bus, in virtual time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.hardware.wired_machines import Bench, VirtualMotors
from tests.support.can_motors import Motor
from tsd_twin import robots
from tsd_twin.hardware.can_wheels import CanWheelsIO
from tsd_twin.hardware.joints import MotorControllers
from tsd_twin.hardware.robot_io import HasWatchdog, RobotIO
from tsd_twin.hardware.serial_transport import HardwareError
from tsd_twin.kinematics import JointKind
from tsd_twin.messages.codes import Code, Reason
from tsd_twin.robots import RobotDescription
from tsd_twin.safety import Heartbeat

pytestmark = pytest.mark.computes

KIWI = robots.load_robot("kiwi")
TSD = robots.load_robot("tsd")
AHEAD = {"moteus": np.array([6.0, -4.0, 2.0]), "vesc": np.tile([0.0, 0.0, 260.0], 3)}
PERIOD_S, LONGEST_S = 0.01, 5.0
PAUSE_S = 0.22
"""Longer than the dead-man of the controllers, and shorter than the age limit of a command."""


class Robot:
    """A robot with motor controllers, written to in the way the node does."""

    def __init__(self, bench: Bench, motors: list[Motor]) -> None:
        self.bench, self.clock, self.motors = bench, bench.clock, motors
        kind = "moteus" if motors[0].kind == "moteus" else "vesc"
        robot: RobotDescription = KIWI if kind == "moteus" else TSD
        self.bus = bench.motors = VirtualMotors(self.clock, motors)
        controllers = MotorControllers(kind, [motor.id for motor in motors])
        self.io = CanWheelsIO(robot, "virtual:", controllers)
        self.faults: list[Reason] = []
        self._beats = 0
        self.ahead = AHEAD[kind]
        self.rest = np.zeros_like(self.ahead)
        joints = robot.kinematics().joints
        self.wheels = [joint.name for joint in joints if joint.kind is JointKind.VELOCITY]

    def until(
        self, condition: Callable[[], object], setpoint: np.ndarray, *, armed: bool = True
    ) -> None:
        give_up_s = self.clock.now_s + LONGEST_S
        while not condition():
            now_s = self.clock.now_s
            assert now_s < give_up_s, (self.io.fault(now_s), self.io.hardware())
            self._beats += 1
            if (fault := self.io.fault(now_s)) is not None:
                self.faults.append(fault)
            self.io.set_heartbeat(Heartbeat(armed, self._beats))
            self.io.write(setpoint, now_s)
            self.clock.advance(max(0.0, now_s + PERIOD_S - self.clock.now_s))

    def for_s(self, seconds: float, *, armed: bool = True) -> None:
        end_s = self.clock.now_s + seconds
        self.until(lambda: self.clock.now_s > end_s, self.ahead, armed=armed)

    @property
    def runs(self) -> bool:
        wheels = self.ahead[self.ahead != 0.0]
        there = [2.0 * np.pi * motor.speed_hz for motor in self.motors]
        return bool(np.allclose(there, wheels, rtol=0.03))

    def drive(self) -> None:
        """Disarm, arm and drive."""
        self.until(lambda: not self.io.fault(self.clock.now_s), self.rest, armed=False)
        self.faults.clear()
        self.until(lambda: self.runs, self.ahead)
        assert not self.faults


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    return Bench(monkeypatch)


@pytest.fixture
def it(bench: Bench, kind: str) -> Robot:
    return Robot(bench, [Motor(i, kind) for i in (1, 2, 3)])


KINDS = pytest.mark.parametrize("kind", ["moteus", "vesc"])


@KINDS
def test_wheels_turn_at_the_set_speeds_and_are_measured(it: Robot) -> None:
    io: RobotIO = it.io
    assert isinstance(io, HasWatchdog)
    it.drive()
    wheels = it.ahead[it.ahead != 0.0] * 30.0 / np.pi
    shown = lambda: it.io.hardware()["wheels"]  # noqa: E731
    it.until(lambda: np.allclose(shown()["rpm"], wheels, rtol=0.05), it.ahead)
    assert it.io.battery_v(0.0) == 24.0
    it.until(lambda: not it.bus.driven, it.rest)


def _mute(it: Robot) -> None:
    it.motors[1].mute = True


def _fault(it: Robot) -> None:
    it.motors[1].fault = 38


def _deaf(it: Robot) -> None:
    """A moteus answers nothing then; a VESC continues to report, and its time-out stops it."""
    it.motors[1].deaf = True


def _mend(it: Robot) -> None:
    for motor in it.motors:
        motor.mute = motor.deaf = False
        motor.fault = 0


@pytest.mark.parametrize(
    ("kind", "harm", "code"),
    [
        ("moteus", _mute, Code.WHEELS_SILENT),
        ("vesc", _mute, Code.WHEELS_SILENT),
        ("moteus", _deaf, Code.WHEELS_SILENT),
        ("moteus", _fault, Code.WHEEL_FAULT),
    ],
)
def test_a_fault_stops_all_wheels_and_only_a_new_arming_turns_them(
    it: Robot, harm: Callable[[Robot], None], code: Code
) -> None:
    it.drive()
    harm(it)
    it.until(lambda: it.faults and not it.bus.driven, it.ahead)
    _mend(it)
    assert it.faults[-1].code == code
    it.for_s(0.5)
    assert not it.bus.driven, "mended, and nothing turns"
    it.drive()


@KINDS
def test_after_a_pause_of_the_program_nothing_turns_until_armed_again(it: Robot, kind: str) -> None:
    """A VESC does not latch its time-out, and would obey the next command."""
    it.drive()
    it.clock.advance(PAUSE_S)
    assert not it.bus.driven, "the dead-man of the controllers"
    assert all(motor.mode == 11 for motor in it.motors) == (kind == "moteus")
    it.for_s(0.5)
    assert not it.bus.driven
    assert it.faults[-1].code == Code.WHEEL_TIMED_OUT
    assert it.faults[-1].params == {"wheels": ", ".join(it.wheels)}
    it.drive()


@KINDS
def test_a_node_that_hangs_stops_the_wheels(it: Robot) -> None:
    it.drive()
    it.bench.idle_for(0.3)
    assert not it.bus.driven
    it.for_s(0.3)
    assert not it.bus.driven
    it.drive()


@pytest.mark.parametrize(
    ("motor", "words"),
    [
        (Motor(2, "vesc", timeout_s=1.0), "wheel: its time-out is 1000 ms: set 50 to 500 ms"),
        (Motor(2, "vesc", status=0), "does not send CAN status 1, 4 and 5"),
        (Motor(2, "vesc", mute=True), "it does not answer"),
        (Motor(2, "moteus", mute=True), "wheel2: it does not answer"),
        (Motor(2, "moteus", timeout_s=5.0, refuses_timeout=True), "its time-out reads 5 s"),
    ],
)
def test_a_controller_that_must_not_be_armed_is_named_at_the_start(
    bench: Bench, motor: Motor, words: str
) -> None:
    motors = [Motor(1, motor.kind), replace(motor), Motor(3, motor.kind)]
    with pytest.raises(HardwareError, match=words):
        Robot(bench, motors)
    assert not any(it.driven for it in motors)


def test_a_vesc_is_refused_where_it_would_let_its_motor_go() -> None:
    one_pair = MotorControllers("vesc", [1, 2, 3], pole_pairs=1)
    text = robots.read_description("tsd")
    slow = text.replace("start_speed_rpm = 2000.0", "start_speed_rpm = 800.0")
    robot = robots.parse_description(slow, "tsd")
    with pytest.raises(HardwareError, match=r"below 900 rpm: raise motor.start_speed_rpm"):
        CanWheelsIO(robot, "virtual:none", one_pair)
    with pytest.raises(HardwareError, match="kiwi has wheels that stand and turn slowly"):
        CanWheelsIO(KIWI, "virtual:none", MotorControllers("vesc", [1, 2, 3]))


@pytest.mark.parametrize("kind", ["moteus"])
def test_closed_the_wheels_stand(it: Robot) -> None:
    it.drive()
    it.io.close()
    assert not it.bus.driven
