"""Wheels on a Dynamixel bus, over a pty, with simulated X servos at its other end."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from tests.hardware.test_mega import PATIENCE_S, wait_until
from tests.support.faulty_devices import Peer
from tests.support.x_series import XBus, XServo
from tsd_twin import robots
from tsd_twin.hardware.dynamixel.packets import protocol2
from tsd_twin.hardware.dynamixel.wheel_models import VELOCITY_UNIT_RAD_PER_S, WHEEL_MODELS
from tsd_twin.hardware.dynamixel_wheels import DynamixelWheelsIO
from tsd_twin.hardware.joints import ServoCalibration
from tsd_twin.hardware.robot_io import HasBattery, HasServoTemperature, HasWatchdog, RobotIO
from tsd_twin.hardware.serial_transport import HardwareError
from tsd_twin.hardware.wheel_bus import GOAL, GOAL_VELOCITY
from tsd_twin.messages.codes import Code, Reason
from tsd_twin.robots import OmniDescription, description_of_kind
from tsd_twin.safety import Heartbeat

TEXT = (Path(__file__).parents[2] / "examples" / "kiwi_xl430.toml").read_text(encoding="utf-8")
KIWI = description_of_kind(robots.parse_description(TEXT, "kiwi_xl430"), OmniDescription)
AHEAD, REST = np.array([3.0, -2.0, 1.0]), np.zeros(3)
UNIT = VELOCITY_UNIT_RAD_PER_S
CONNECTS, TRIES = 3, 8


class Bench:
    """A robot on a servo bus, written to in the way the node does."""

    def __init__(
        self, folder: Path, bus: XBus, calibration: ServoCalibration, robot: OmniDescription
    ) -> None:
        self.bus, self._calibration, self._robot = bus, calibration, robot
        self.line = Peer(folder / "servos", bus.answer)
        self.io_: DynamixelWheelsIO | None = None
        self.speeds = np.full(3, np.nan)
        self.faults: list[Reason] = []
        self._words = 0

    def connect(self) -> DynamixelWheelsIO:
        """Connect; retry if the emulated bus was delayed."""
        for left in reversed(range(CONNECTS)):
            try:
                self.io_ = DynamixelWheelsIO(self._robot, self.line.port, self._calibration)
                break
            except HardwareError as error:
                if not left or not re.search("fell silent|does not answer", str(error)):
                    raise
        return self.io

    @property
    def io(self) -> DynamixelWheelsIO:
        assert self.io_ is not None
        return self.io_

    @property
    def fault(self) -> Reason | None:
        return self.io.fault(time.monotonic())

    def tick(self, setpoint: np.ndarray, *, armed: bool, beats: bool = True) -> None:
        """Do what the node does in a period."""
        self._words += beats
        now_s = time.monotonic()
        measured = self.io.read(now_s)
        self.speeds = self.speeds if measured is None else measured
        if (fault := self.io.fault(now_s)) is not None:
            self.faults.append(fault)
        self.io.set_heartbeat(Heartbeat(armed, self._words))
        self.io.write(setpoint, now_s)
        time.sleep(0.005)

    def until(
        self,
        condition: Callable[[], object],
        setpoint: np.ndarray = REST,
        *,
        armed: bool = True,
        beats: bool = True,
    ) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end_s, (self.fault, self.io.hardware())
            self.tick(setpoint, armed=armed, beats=beats)

    def for_s(self, seconds: float, setpoint: np.ndarray, *, armed: bool = True) -> None:
        end_s = time.monotonic() + seconds
        self.until(lambda: time.monotonic() > end_s, setpoint, armed=armed)

    def drive(self) -> None:
        """Disarm, arm and drive ahead; again while a busy machine is in the way."""
        end_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < end_s:
            self.until(lambda: not self.fault, armed=False)
            self.tick(REST, armed=False)
            self.until(lambda: self.fault or self.runs, AHEAD)
            if self.runs and not self.fault:
                self.faults.clear()
                return
        raise AssertionError(self.fault)

    @property
    def runs(self) -> bool:
        """Whether all wheels have the speed that is set."""
        return bool(np.allclose(self.true_speeds(), AHEAD, atol=2.0 * UNIT))

    @property
    def driven(self) -> bool:
        """Whether a motor turns by command."""
        if self.line._thread is None:  # Nobody else lets its time pass.
            self.bus.live(time.monotonic())
        return any(servo.driven for servo in self.bus.servos)

    def true_speeds(self) -> np.ndarray:
        return np.array([servo.speed_rad_per_s for servo in self.bus.servos])

    def close(self) -> None:
        if self.io_ is not None:
            self.io_.close()
        self.line.unplug()


@contextmanager
def bench(
    folder: Path,
    bus: XBus | None = None,
    calibration: ServoCalibration | None = None,
    robot: OmniDescription = KIWI,
) -> Iterator[Bench]:
    servos = XBus([XServo(i) for i in (1, 2, 3)]) if bus is None else bus
    made = Bench(folder, servos, calibration or ServoCalibration(), robot)
    try:
        yield made
    finally:
        made.close()


def test_wheels_turn_at_the_set_speeds_and_are_measured(tmp_path: Path) -> None:
    with bench(tmp_path) as it:
        io: RobotIO = it.connect()
        assert isinstance(io, HasWatchdog)
        assert isinstance(io, HasBattery)
        assert isinstance(io, HasServoTemperature)
        it.drive()
        it.until(lambda: np.allclose(it.speeds, AHEAD, atol=UNIT), AHEAD)
        it.until(lambda: not it.driven, REST)
        assert it.io.battery_v(time.monotonic()) == pytest.approx(11.1)
        assert it.io.servo_c(time.monotonic()) == 35.0
        facts = it.io.hardware()
        assert facts["servos"]["model"] == ["XL430-W250"] * 3
        assert "current_a" not in facts["servos"], "it measures none"
        it.until(lambda: it.io.hardware()["servos"]["load_percent"] == [0.0] * 3)
        assert not it.bus.reserved, "no read covers a reserved register"


def test_models_with_a_current_report_amperes(tmp_path: Path) -> None:
    bus = XBus([XServo(1, 1020, volts=12.0), XServo(2, 1210), XServo(3)])
    with bench(tmp_path, bus) as it:
        with pytest.raises(HardwareError, match=r"servo 1 \(wheel1\): an XM430-W350 turns at 45.8"):
            it.connect()
        bus.servos[0].put(44, 4, 300)
        with pytest.raises(HardwareError, match=r"servo 2 \(wheel2\): an XC330-T181 switches off"):
            it.connect()
    cool = description_of_kind(
        robots.parse_description(TEXT.replace("c = 72.0", "c = 70.0"), "kiwi"), OmniDescription
    )
    for servo in bus.servos:
        servo.restart()
    with bench(tmp_path, bus, robot=cool) as it:
        it.connect()
        it.drive()
        it.until(lambda: it.io.hardware()["servos"]["current_a"] == [0.11, 0.04, None], AHEAD)
        assert it.io.hardware()["servos"]["load_percent"] == [None, None, 4.0]


def test_reversed_wheels_and_other_ids_are_counted_in(tmp_path: Path) -> None:
    calibration = ServoCalibration(reversed=["wheel2"], servo_id={"wheel1": 7})
    bus = XBus([XServo(7), XServo(2), XServo(3)])
    with bench(tmp_path, bus, calibration) as it:
        it.connect()
        it.until(lambda: not it.fault, armed=False)
        there = AHEAD * [1, -1, 1]
        it.until(lambda: np.allclose(it.true_speeds(), there, atol=2 * UNIT), AHEAD)
        it.until(lambda: np.allclose(it.speeds, AHEAD, atol=UNIT), AHEAD)


def _hot(it: Bench) -> None:
    it.bus.servos[1].temperature_c = 67.5


def _shut_down(it: Bench) -> None:
    it.bus.servos[1].temperature_c = 73.0


def _limp(it: Bench) -> None:
    it.bus.servos[1].write(64, b"\x00")


def _restarted(it: Bench) -> None:
    it.bus.servos[1].restart()


def _dead(it: Bench) -> None:
    it.bus.servos[1].dead = True


def _unpowered(it: Bench) -> None:
    for servo in it.bus.servos:
        servo.set_power(False)


def _stopped_answering(it: Bench) -> None:
    it.bus.silent = True


def _jammed(it: Bench) -> None:
    it.bus.servos[0].jammed = True


def _unplugged(it: Bench) -> None:
    it.line.unplug()


def _other_watchdog(it: Bench) -> None:
    it.bus.servos[1].put(98, 1, 0)


def _empty(it: Bench) -> None:
    for servo in it.bus.servos:
        servo.volts = 9.0


def _mend(it: Bench) -> None:
    it.bus.silent = False
    for servo in it.bus.servos:
        servo.temperature_c, servo.volts = 35.0, 11.1
        servo.dead = servo.jammed = False
        if servo.memory[70] or not servo.powered:
            servo.set_power(False)
        servo.set_power(True)
    if it.line._thread is None:
        it.line.plug_in()


@pytest.mark.parametrize(
    ("harm", "codes"),
    [
        (_hot, {Code.SERVO_TOO_HOT}),
        (_shut_down, {Code.SERVO_ERROR}),
        (_limp, {Code.SERVO_LIMP}),
        (_restarted, {Code.SERVO_LIMP, Code.SERVOS_RESTARTED}),
        (_dead, {Code.SERVOS_SILENT}),
        (_unpowered, {Code.ALL_SERVOS_SILENT, Code.DEVICE_SILENT}),
        (_stopped_answering, {Code.ALL_SERVOS_SILENT, Code.DEVICE_SILENT}),
        (_jammed, {Code.WHEEL_STUCK}),
        (_unplugged, {Code.DEVICE_DISCONNECTED}),
        (_other_watchdog, {Code.SERVOS_RESTARTED}),
        (_empty, {Code.BATTERY_EMPTY}),
    ],
)
def test_a_fault_stops_all_wheels_and_only_a_new_arming_turns_them(
    tmp_path: Path, harm: Callable[[Bench], None], codes: set[Code]
) -> None:
    with bench(tmp_path) as it:
        it.connect()
        it.drive()
        harm(it)
        # The node keeps commanding: the bridge stops the wheels by itself.
        it.until(lambda: it.faults and it.faults[-1].code in codes and not it.driven, AHEAD)
        _mend(it)
        it.for_s(0.6, AHEAD)
        assert not it.driven, "mended, and nothing turns"
        it.drive()


def test_words_of_nobody_stop_the_wheels(tmp_path: Path) -> None:
    """A node that repeats one command with the same heartbeat."""
    with bench(tmp_path) as it:
        it.connect()
        for _ in range(TRIES):  # A busy machine is another fault at times.
            it.drive()
            it.until(lambda: it.faults and not it.driven, AHEAD, beats=False)
            if it.faults[-1].code == Code.HEARTBEAT_LOST:
                break
        assert it.faults[-1].code == Code.HEARTBEAT_LOST
        it.for_s(0.3, AHEAD)
        assert not it.driven


def test_a_node_that_hangs_stops_the_wheels_though_the_bus_goes_on(tmp_path: Path) -> None:
    """Reads feed the watchdogs, so it is the bridge that sends zero."""
    with bench(tmp_path) as it:
        it.connect()
        it.drive()
        cycles = it.io.hardware()["servo_link"]["cycles"]
        wait_until(lambda: not it.driven, "stopped")
        assert not any(servo.expired for servo in it.bus.servos)
        assert it.io.hardware()["servo_link"]["cycles"] > cycles
        it.for_s(0.3, AHEAD)
        assert not it.driven
        assert it.faults[-1].code == Code.NODE_HANGS


def test_the_bus_watchdog_stops_wheels_and_its_end_brings_no_old_speed_back(
    tmp_path: Path,
) -> None:
    with bench(tmp_path) as it:
        it.connect()
        it.drive()
        it.io._thread._device.cycle = lambda _transport: True  # type: ignore[method-assign]

        def expired() -> bool:
            it.bus.live(time.monotonic())
            return all(servo.expired for servo in it.bus.servos)

        wait_until(expired, "no packet")
        assert all(servo.goal for servo in it.bus.servos), "the old speed is still in the register"
        angles = [servo.angle_rad for servo in it.bus.servos]
        del it.io._thread._device.cycle
        it.until(lambda: it.faults and it.faults[-1].code == Code.WATCHDOG_EXPIRED, AHEAD)
        it.until(lambda: not it.fault, armed=False)
        it.for_s(0.3, REST)
        after = [servo.angle_rad for servo in it.bus.servos]
        assert np.allclose(after, angles, atol=1e-3), "cleared, and nothing has turned"
        assert all(not servo.goal and servo.torque for servo in it.bus.servos)
        it.drive()


def test_a_servo_that_would_turn_at_its_old_goal_shows_why_torque_is_off_meanwhile() -> None:
    """The simulated servo is the worst case: cleared with torque, it turns again."""
    servo = XServo(1)
    bus = XBus([servo])
    bus.answer(protocol2.write(1, 98, b"\x0a") + protocol2.write(1, 64, b"\x01"), 1.0)
    bus.answer(protocol2.write(1, GOAL_VELOCITY, GOAL.pack(100)), 1.1)
    bus.live(1.4)
    assert servo.expired
    assert servo.speed_rad_per_s == 0.0
    bus.answer(protocol2.write(1, 98, b"\x00"), 1.5)
    bus.live(1.6)
    assert servo.speed_rad_per_s > 1.0


def test_power_that_goes_with_the_line_is_named_as_a_reset_of_the_adapter(tmp_path: Path) -> None:
    with bench(tmp_path) as it:
        it.connect()
        it.drive()
        it.line.unplug()
        it.until(lambda: it.faults and it.faults[-1].code == Code.DEVICE_DISCONNECTED, AHEAD)
        it.line.plug_in()
        it.until(lambda: not it.fault, armed=False)
        told = it.io.hardware()["warnings"]
        assert not any("OpenRB-150" in text for text in told), "a U2D2 leaves them their power"
        it.line.unplug()
        for servo in it.bus.servos:
            servo.restart()
        it.until(lambda: it.fault, armed=False)
        it.line.plug_in()
        it.until(lambda: not it.fault, armed=False)
        assert "OpenRB-150" in it.io.hardware()["warnings"][0]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda s: setattr(s[2], "id", 9), r"servo 3 \(wheel3\) does not answer .* id 3 and"),
        (lambda s: setattr(s[0], "dead", True), r"servo 1 \(wheel1\) does not answer"),
        (lambda s: s[1].put(11, 1, 3), r"operating mode \(register 11\) is 3, and must be 1"),
        (lambda s: s[1].put(108, 4, 20), r"profile acceleration \(register 108\) is 20"),
        (lambda s: s[1].put(10, 1, 1), r"drive mode \(register 10\) is 1, and must be 0"),
        (lambda s: s[1].put(0, 2, 311), r"servo 2 \(wheel2\): model 311 is not one of XL430-W250"),
        (lambda s: s[1].put(44, 4, 200), r"turns at 45.8 rpm at most"),
    ],
)
def test_a_servo_that_does_not_fit_is_named_at_the_start(
    tmp_path: Path, change: Callable[[list[XServo]], None], words: str
) -> None:
    servos = [XServo(i) for i in (1, 2, 3)]
    change(servos)
    with bench(tmp_path, XBus(servos)) as it, pytest.raises(HardwareError, match=words):
        it.connect()
    assert not any(servo.driven for servo in servos)


def test_a_calibration_of_gimbals_is_refused(tmp_path: Path) -> None:
    calibration = ServoCalibration(neutral_step={"wheel1": 2000})
    with (
        bench(tmp_path, calibration=calibration) as it,
        pytest.raises(HardwareError, match=r"no \[neutral_step\]"),
    ):
        it.connect()


@pytest.mark.parametrize("model", WHEEL_MODELS.values(), ids=lambda model: model.servo.name)
def test_a_servo_as_delivered_differs_in_its_mode_only(model: object) -> None:
    servo = XServo(1, model.servo.number)  # type: ignore[attr-defined]
    servo.put(11, 1, 3)
    wrong = [
        setting.name
        for setting in model.servo.settings  # type: ignore[attr-defined]
        if not setting.allows(setting.value(servo.read(setting.address, setting.size)))
    ]
    assert wrong == ["operating mode"]


def test_closed_the_wheels_stand(tmp_path: Path) -> None:
    with bench(tmp_path) as it:
        it.connect()
        it.drive()
        it.io.close()
        wait_until(lambda: not it.driven, "at rest")
