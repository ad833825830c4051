"""Wheels on a Dynamixel bus, in virtual time, with simulated X servos at its other end."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.hardware.wired_machines import Bench
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

pytestmark = pytest.mark.computes

TEXT = (Path(__file__).parents[2] / "examples" / "kiwi_xl430.toml").read_text(encoding="utf-8")
KIWI = description_of_kind(robots.parse_description(TEXT, "kiwi_xl430"), OmniDescription)
AHEAD, REST = np.array([3.0, -2.0, 1.0]), np.zeros(3)
UNIT = VELOCITY_UNIT_RAD_PER_S
PERIOD_S, LONGEST_S = 0.01, 5.0
WATCHDOG_S = 0.3


class Kiwi:
    """A robot on a servo bus, written to in the way the node does."""

    def __init__(
        self,
        bench: Bench,
        bus: XBus | None = None,
        calibration: ServoCalibration | None = None,
        robot: OmniDescription = KIWI,
    ) -> None:
        self.bench, self.clock = bench, bench.clock
        self.bus = bus or XBus([XServo(i) for i in (1, 2, 3)])
        self.clock.machines.append(self.bus.live)
        self.plug_in()
        self.io = DynamixelWheelsIO(robot, "servos", calibration)
        self.speeds = np.full(3, np.nan)
        self.faults: list[Reason] = []
        self._beats = 0

    def plug_in(self) -> None:
        self.bench.plug_in("servos", self.bus.answer)

    def unplug(self) -> None:
        self.bench.unplug("servos")

    @property
    def fault(self) -> Reason | None:
        return self.io.fault(self.clock.now_s)

    def tick(self, setpoint: np.ndarray, *, armed: bool, beats: bool = True) -> None:
        """Do what the node does in a period."""
        end_s = self.clock.now_s + PERIOD_S
        self._beats += beats
        measured = self.io.read(self.clock.now_s)
        self.speeds = self.speeds if measured is None else measured
        if (fault := self.fault) is not None:
            self.faults.append(fault)
        self.io.set_heartbeat(Heartbeat(armed, self._beats))
        self.io.write(setpoint, self.clock.now_s)
        self.clock.advance(max(0.0, end_s - self.clock.now_s))

    def until(
        self,
        condition: Callable[[], object],
        setpoint: np.ndarray = REST,
        *,
        armed: bool = True,
        beats: bool = True,
    ) -> None:
        end_s = self.clock.now_s + LONGEST_S
        while not condition():
            assert self.clock.now_s < end_s, (self.fault, self.io.hardware())
            self.tick(setpoint, armed=armed, beats=beats)

    def for_s(self, seconds: float, setpoint: np.ndarray, *, armed: bool = True) -> None:
        end_s = self.clock.now_s + seconds
        self.until(lambda: self.clock.now_s > end_s, setpoint, armed=armed)

    def drive(self) -> None:
        """Disarm, arm and drive ahead."""
        self.until(lambda: not self.fault, armed=False)
        self.tick(REST, armed=False)
        self.faults.clear()
        self.until(lambda: self.runs, AHEAD)
        assert not self.faults

    @property
    def runs(self) -> bool:
        """Whether all wheels have the speed that is set."""
        return bool(np.allclose(self.true_speeds(), AHEAD, atol=2.0 * UNIT))

    @property
    def driven(self) -> bool:
        """Whether a motor turns by command."""
        return any(servo.driven for servo in self.bus.servos)

    def true_speeds(self) -> np.ndarray:
        return np.array([servo.speed_rad_per_s for servo in self.bus.servos])


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    return Bench(monkeypatch)


@pytest.fixture
def it(bench: Bench) -> Kiwi:
    return Kiwi(bench)


def test_wheels_turn_at_the_set_speeds_and_are_measured(it: Kiwi) -> None:
    io: RobotIO = it.io
    assert isinstance(io, HasWatchdog)
    assert isinstance(io, HasBattery)
    assert isinstance(io, HasServoTemperature)
    it.drive()
    it.until(lambda: np.allclose(it.speeds, AHEAD, atol=UNIT), AHEAD)
    it.until(lambda: not it.driven, REST)
    assert it.io.battery_v(it.clock.now_s) == pytest.approx(11.1)
    assert it.io.servo_c(it.clock.now_s) == 35.0
    facts = it.io.hardware()
    assert facts["servos"]["model"] == ["XL430-W250"] * 3
    assert "current_a" not in facts["servos"], "it measures none"
    it.until(lambda: it.io.hardware()["servos"]["load_percent"] == [0.0] * 3)
    assert not it.bus.reserved, "no read covers a reserved register"


def test_models_with_a_current_report_amperes(bench: Bench) -> None:
    bus = XBus([XServo(1, 1020, volts=12.0), XServo(2, 1210), XServo(3)])
    with pytest.raises(HardwareError, match=r"servo 1 \(wheel1\): an XM430-W350 turns at 45.8"):
        Kiwi(bench, bus)
    bus.servos[0].put(44, 4, 300)
    with pytest.raises(HardwareError, match=r"servo 2 \(wheel2\): an XC330-T181 switches off"):
        Kiwi(bench, bus)
    cool = description_of_kind(
        robots.parse_description(TEXT.replace("c = 72.0", "c = 70.0"), "kiwi"), OmniDescription
    )
    for servo in bus.servos:
        servo.restart()
    it = Kiwi(bench, bus, robot=cool)
    it.drive()
    it.until(lambda: it.io.hardware()["servos"]["current_a"] == [0.11, 0.04, None], AHEAD)
    assert it.io.hardware()["servos"]["load_percent"] == [None, None, 4.0]


def test_reversed_wheels_and_other_ids_are_counted_in(bench: Bench) -> None:
    calibration = ServoCalibration(reversed=["wheel2"], servo_id={"wheel1": 7})
    it = Kiwi(bench, XBus([XServo(7), XServo(2), XServo(3)]), calibration)
    it.until(lambda: not it.fault, armed=False)
    there = AHEAD * [1, -1, 1]
    it.until(lambda: np.allclose(it.true_speeds(), there, atol=2 * UNIT), AHEAD)
    it.until(lambda: np.allclose(it.speeds, AHEAD, atol=UNIT), AHEAD)


def _hot(it: Kiwi) -> None:
    it.bus.servos[1].temperature_c = 67.5


def _shut_down(it: Kiwi) -> None:
    it.bus.servos[1].temperature_c = 73.0


def _limp(it: Kiwi) -> None:
    it.bus.servos[1].write(64, b"\x00")


def _restarted(it: Kiwi) -> None:
    it.bus.servos[1].restart()


def _dead(it: Kiwi) -> None:
    it.bus.servos[1].dead = True


def _unpowered(it: Kiwi) -> None:
    for servo in it.bus.servos:
        servo.set_power(False)


def _stopped_answering(it: Kiwi) -> None:
    it.bus.silent = True


def _jammed(it: Kiwi) -> None:
    it.bus.servos[0].jammed = True


def _unplugged(it: Kiwi) -> None:
    it.unplug()


def _other_watchdog(it: Kiwi) -> None:
    it.bus.servos[1].put(98, 1, 0)


def _empty(it: Kiwi) -> None:
    for servo in it.bus.servos:
        servo.volts = 9.0


def _mend(it: Kiwi) -> None:
    it.bus.silent = False
    for servo in it.bus.servos:
        servo.temperature_c, servo.volts = 35.0, 11.1
        servo.dead = servo.jammed = False
        if servo.memory[70] or not servo.powered:
            servo.set_power(False)
        servo.set_power(True)
    if "servos" not in it.bench.ports:
        it.plug_in()


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
    it: Kiwi, harm: Callable[[Kiwi], None], codes: set[Code]
) -> None:
    it.drive()
    harm(it)
    # The node keeps commanding: the bridge stops the wheels automatically.
    it.until(lambda: it.faults and it.faults[-1].code in codes and not it.driven, AHEAD)
    _mend(it)
    it.for_s(0.6, AHEAD)
    assert not it.driven, "mended, and nothing turns"
    it.drive()


def test_a_bus_that_was_silent_for_seconds_is_opened_again(it: Kiwi) -> None:
    it.drive()
    it.bus.silent = True
    it.for_s(3.0, AHEAD)
    assert it.fault is not None
    assert it.fault.code == Code.DEVICE_DISCONNECTED
    _mend(it)
    it.for_s(0.6, AHEAD)
    assert not it.driven
    it.drive()


def test_after_an_unplugging_the_fault_says_why_until_disarmed(it: Kiwi) -> None:
    it.drive()
    it.unplug()
    it.until(lambda: it.fault, AHEAD)
    assert it.fault is not None
    why = it.fault.params["text"]
    it.plug_in()
    it.for_s(0.6, AHEAD)
    assert not it.driven
    assert it.fault is not None
    assert it.fault.code == Code.DEVICE_DISCONNECTED
    assert it.fault.params["text"] == why != ""
    it.drive()


def test_words_of_nobody_stop_the_wheels(it: Kiwi) -> None:
    """A node that repeats one command with the same heartbeat."""
    it.drive()
    it.until(lambda: it.faults and not it.driven, AHEAD, beats=False)
    assert {fault.code for fault in it.faults} == {Code.HEARTBEAT_LOST}
    it.for_s(0.3, AHEAD)
    assert not it.driven


def test_a_node_that_hangs_stops_the_wheels_though_the_bus_goes_on(it: Kiwi) -> None:
    """Reads feed the watchdogs, so it is the bridge that sends zero."""
    it.drive()
    cycles = it.io.hardware()["servo_link"]["cycles"]
    it.bench.idle_for(0.3)
    assert not it.driven
    assert not any(servo.expired for servo in it.bus.servos)
    assert it.io.hardware()["servo_link"]["cycles"] > cycles
    it.for_s(0.3, AHEAD)
    assert not it.driven
    assert it.faults[-1].code == Code.NODE_HANGS


def test_the_bus_watchdog_stops_wheels_and_its_end_brings_no_old_speed_back(it: Kiwi) -> None:
    it.drive()
    it.clock.advance(WATCHDOG_S)
    assert all(servo.expired for servo in it.bus.servos), "no packet"
    assert all(servo.goal for servo in it.bus.servos), "the old speed is still in the register"
    angles = [servo.angle_rad for servo in it.bus.servos]
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


def test_power_that_goes_with_the_line_is_named_as_a_reset_of_the_adapter(it: Kiwi) -> None:
    it.drive()
    it.unplug()
    it.until(lambda: it.faults and it.faults[-1].code == Code.DEVICE_DISCONNECTED, AHEAD)
    it.plug_in()
    it.until(lambda: not it.fault, armed=False)
    told = it.io.hardware()["warnings"]
    assert not any("OpenRB-150" in text for text in told), "a U2D2 leaves them their power"
    it.unplug()
    for servo in it.bus.servos:
        servo.restart()
    it.until(lambda: it.fault, armed=False)
    it.plug_in()
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
    bench: Bench, change: Callable[[list[XServo]], None], words: str
) -> None:
    servos = [XServo(i) for i in (1, 2, 3)]
    change(servos)
    with pytest.raises(HardwareError, match=words):
        Kiwi(bench, XBus(servos))
    assert not any(servo.driven for servo in servos)


def test_a_calibration_of_gimbals_is_refused(bench: Bench) -> None:
    calibration = ServoCalibration(neutral_step={"wheel1": 2000})
    with pytest.raises(HardwareError, match=r"no \[neutral_step\]"):
        Kiwi(bench, calibration=calibration)


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


def test_closed_the_wheels_stand(it: Kiwi) -> None:
    it.drive()
    it.io.close()
    assert not it.driven
