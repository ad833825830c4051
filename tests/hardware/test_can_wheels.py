"""Wheels with VESC and moteus on a virtual CAN bus."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from tests.hardware.test_mega import PATIENCE_S, wait_until
from tests.support.can_motors import Motor, MotorBus
from tsd_twin import robots
from tsd_twin.hardware.can_wheels import CanWheelsIO
from tsd_twin.hardware.joints import MotorControllers
from tsd_twin.hardware.robot_io import HasWatchdog, RobotIO
from tsd_twin.hardware.serial_transport import HardwareError
from tsd_twin.messages.codes import Code, Reason
from tsd_twin.robots import RobotDescription
from tsd_twin.safety import Heartbeat

KIWI = robots.load_robot("kiwi")
TSD = robots.load_robot("tsd")
AHEAD = {"moteus": np.array([6.0, -4.0, 2.0]), "vesc": np.tile([0.0, 0.0, 260.0], 3)}
TRIES = 6


class Bench:
    """A robot with motor controllers, written to in the way the node does."""

    def __init__(self, kind: str, motors: list[Motor], channel: str) -> None:
        self.kind, self.motors = kind, motors
        self.robot: RobotDescription = KIWI if kind == "moteus" else TSD
        self.address = f"virtual:{channel}"
        self.bus = MotorBus("virtual", channel, motors)
        self.io_: CanWheelsIO | None = None
        self.faults: list[Reason] = []
        self._words = 0
        self.ahead = AHEAD[kind]
        self.rest = np.zeros_like(self.ahead)

    def connect(self) -> CanWheelsIO:
        kind = "moteus" if self.kind == "moteus" else "vesc"
        controllers = MotorControllers(kind, [motor.id for motor in self.motors])
        self.io_ = CanWheelsIO(self.robot, self.address, controllers)
        return self.io_

    @property
    def io(self) -> CanWheelsIO:
        assert self.io_ is not None
        return self.io_

    def until(
        self, condition: Callable[[], object], setpoint: np.ndarray, *, armed: bool = True
    ) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while not condition():
            now_s = time.monotonic()
            assert now_s < end_s, (self.io.fault(now_s), self.io.hardware())
            self._words += 1
            if (fault := self.io.fault(now_s)) is not None:
                self.faults.append(fault)
            self.io.set_heartbeat(Heartbeat(armed, self._words))
            self.io.write(setpoint, now_s)
            time.sleep(0.005)

    def for_s(self, seconds: float, *, armed: bool = True) -> None:
        end_s = time.monotonic() + seconds
        self.until(lambda: time.monotonic() > end_s, self.ahead, armed=armed)

    @property
    def runs(self) -> bool:
        wheels = self.ahead[self.ahead != 0.0]
        there = [2.0 * np.pi * motor.speed_hz for motor in self.motors]
        return bool(np.allclose(there, wheels, rtol=0.03))

    def drive(self) -> None:
        """Disarm, arm and drive; again while a busy machine is in the way."""
        end_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < end_s:
            self.until(lambda: not self.io.fault(time.monotonic()), self.rest, armed=False)
            self.faults.clear()
            self.until(lambda: self.faults or self.runs, self.ahead)
            if self.runs and not self.faults:
                return
        raise AssertionError(self.faults)


@contextmanager
def bench(kind: str, name: str, motors: list[Motor] | None = None) -> Iterator[Bench]:
    made = Bench(kind, motors or [Motor(i, kind) for i in (1, 2, 3)], f"{kind} {name}")
    try:
        yield made
    finally:
        if made.io_ is not None:
            made.io_.close()
        made.bus.close()


KINDS = pytest.mark.parametrize("kind", ["moteus", "vesc"])


@KINDS
def test_wheels_turn_at_the_set_speeds_and_are_measured(kind: str) -> None:
    with bench(kind, "drive") as it:
        io: RobotIO = it.connect()
        assert isinstance(io, HasWatchdog)
        it.drive()
        wheels = it.ahead[it.ahead != 0.0] * 30.0 / np.pi
        shown = lambda: it.io.hardware()["wheels"]  # noqa: E731
        it.until(lambda: np.allclose(shown()["rpm"], wheels, rtol=0.05), it.ahead)
        assert it.io.battery_v(0.0) == 24.0
        it.until(lambda: not it.bus.driven, it.rest)


def _mute(it: Bench) -> None:
    it.motors[1].mute = True


def _fault(it: Bench) -> None:
    it.motors[1].fault = 38


def _deaf(it: Bench) -> None:
    """A moteus answers nothing then; a VESC goes on reporting, and its time-out stops it."""
    it.motors[1].deaf = True


def _mend(it: Bench) -> None:
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
    kind: str, harm: Callable[[Bench], None], code: Code
) -> None:
    with bench(kind, f"{harm.__name__} {code}") as it:
        it.connect()
        for _ in range(TRIES):
            it.drive()
            harm(it)
            it.until(lambda: it.faults and not it.bus.driven, it.ahead)
            _mend(it)
            if it.faults[-1].code == code:
                break
        assert it.faults[-1].code == code
        it.for_s(0.5)
        assert not it.bus.driven, "mended, and nothing turns"
        it.drive()


@KINDS
def test_after_a_pause_of_the_program_nothing_turns_until_armed_again(kind: str) -> None:
    """A VESC does not latch its time-out, and would obey the next command."""
    with bench(kind, "pause") as it:
        it.connect()
        it.drive()
        wheels = it.io._wheels
        wheels._cycle = lambda: time.sleep(0.01)  # type: ignore[method-assign]
        wait_until(lambda: not it.bus.driven, "the dead-man of the controllers")
        assert all(motor.mode == 11 for motor in it.motors) == (kind == "moteus")
        del wheels._cycle
        it.for_s(0.5)
        assert not it.bus.driven
        it.drive()


@KINDS
def test_a_node_that_hangs_stops_the_wheels(kind: str) -> None:
    with bench(kind, "hang") as it:
        it.connect()
        it.drive()
        wait_until(lambda: not it.bus.driven, "zero")
        it.for_s(0.3)
        assert not it.bus.driven
        it.drive()


@pytest.mark.parametrize(
    ("motor", "words"),
    [
        (Motor(2, "vesc", timeout_s=1.0), "wheel: its time-out is 1000 ms: set 50 to 500 ms"),
        (Motor(2, "vesc", status=0), "does not send CAN status 1, 4 and 5"),
        (Motor(2, "vesc", mute=True), "settings were not read"),
        (Motor(2, "moteus", mute=True), "wheel2: it does not answer"),
        (Motor(2, "moteus", timeout_s=5.0, refuses_timeout=True), "its time-out reads 5 s"),
    ],
)
def test_a_controller_that_must_not_be_armed_is_named_at_the_start(
    motor: Motor, words: str
) -> None:
    others = [Motor(1, motor.kind), Motor(3, motor.kind)]
    with bench(motor.kind, words, [others[0], motor, others[1]]) as it:
        with pytest.raises(HardwareError, match=words):
            it.connect()
        assert not it.bus.driven


def test_a_vesc_is_refused_where_it_would_let_its_motor_go() -> None:
    one_pair = MotorControllers("vesc", [1, 2, 3], pole_pairs=1)
    text = robots.read_description("tsd")
    slow = text.replace("start_speed_rpm = 2000.0", "start_speed_rpm = 800.0")
    robot = robots.parse_description(slow, "tsd")
    with pytest.raises(HardwareError, match=r"below 900 rpm: raise motor.start_speed_rpm"):
        CanWheelsIO(robot, "virtual:none", one_pair)
    with pytest.raises(HardwareError, match="kiwi has wheels that stand and turn slowly"):
        CanWheelsIO(KIWI, "virtual:none", MotorControllers("vesc", [1, 2, 3]))


def test_closed_the_wheels_stand() -> None:
    with bench("moteus", "close") as it:
        it.connect()
        it.drive()
        it.io.close()
        wait_until(lambda: not it.bus.driven, "stopped")
