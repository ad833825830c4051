"""Servos at the PC itself, in virtual time; the board drives the speed controllers only."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from firmware.simulator.mx64 import Mx64
from tests.hardware.test_mega import AHEAD, REST, ROBOT
from tests.hardware.wired_machines import Wires
from tests.support.pty_devices import PretendBoard, ServoChain
from tsd_twin.hardware import servo_line, u2d2
from tsd_twin.hardware.arduino_mega import ArduinoMegaIO
from tsd_twin.hardware.dynamixel.servo_models import MODELS, ServoSetting
from tsd_twin.hardware.joints import ServoCalibration
from tsd_twin.hardware.robot_io import HasServoTemperature, HasWatchdog, RobotIO
from tsd_twin.hardware.serial_transport import HardwareError
from tsd_twin.hardware.u2d2 import U2D2IO
from tsd_twin.messages.codes import Code, Reason, Value, because
from tsd_twin.safety import Heartbeat
from tsd_twin.simulation import Motors

pytestmark = pytest.mark.computes

ANGLES = [0, 1, 3, 4, 6, 7]
GIMBALS = [f"module{i}_{angle}" for i in (1, 2, 3) for angle in ("alpha", "beta")]
LOSSES = 12
LONGEST_S, SILENT_BUS_S = 5.0, 0.21
"""Longest wait, and a silence just longer than the bus watchdogs allow."""


class Bench:
    """A robot with two serial lines, written to in the way the node does."""

    def __init__(self, wires: Wires, chain: ServoChain, calibration: ServoCalibration) -> None:
        self.board, self.chain = PretendBoard(), chain
        self.wires = wires
        wires.clock.machines.append(chain.live)
        wires.plug_in("board", self.board.answer)
        wires.plug_in("servos", chain.answer)
        self.robot: U2D2IO | None = None
        self.measured = np.full(9, np.nan)
        self._calibration = calibration
        self._words = 0

    def connect(self) -> U2D2IO:
        """Connect to both lines."""
        motors = Motors.of(ROBOT)
        board = ArduinoMegaIO(ROBOT, "board", motors, self._calibration, servos=False)
        self.robot = U2D2IO(ROBOT, board, "servos", motors, self._calibration)
        return self.io

    @property
    def io(self) -> U2D2IO:
        assert self.robot is not None
        return self.robot

    @property
    def fault(self) -> Reason | None:
        return self.io.fault(time.monotonic())

    @property
    def code(self) -> str:
        return self.fault.code if self.fault else ""

    def has(self, code: Code, **params: Value) -> bool:
        return self.fault == because(code, **params)

    def until(
        self,
        condition: Callable[[], object],
        setpoint: np.ndarray = REST,
        *,
        disarmed: bool = False,
    ) -> None:
        end_s = time.monotonic() + LONGEST_S
        while not condition():
            assert time.monotonic() < end_s, (self.fault, self.io.hardware())
            self._words += 1
            now_s = time.monotonic()
            measured = self.io.read(now_s)
            self.measured = self.measured if measured is None else measured
            self.io.set_heartbeat(Heartbeat(not (self.fault or disarmed), self._words))
            self.io.write(setpoint, now_s)
            time.sleep(0.005)

    def close(self) -> None:
        if self.robot is not None:
            self.robot.close()


@contextmanager
def bench(
    wires: Wires, chain: ServoChain | None = None, calibration: ServoCalibration | None = None
) -> Iterator[Bench]:
    made = Bench(wires, chain or ServoChain(), calibration or ServoCalibration())
    try:
        yield made
    finally:
        made.close()


def test_servos_are_set_up_once_and_follow_the_set_point(wires: Wires) -> None:
    with bench(wires) as it:
        io: RobotIO = it.connect()
        assert isinstance(io, HasWatchdog)
        assert it.board.setups[0].servos_expected == 0
        for servo in range(6):
            assert it.chain.register(servo, servo_line.RETURN_DELAY) == 0
            assert it.chain.register(servo, servo_line.TORQUE_ENABLE) == 1
        there = np.round(AHEAD[ANGLES] * 4096 / (2 * np.pi)) * 2 * np.pi / 4096
        it.until(lambda: np.allclose(it.measured[ANGLES], there, atol=2e-3), AHEAD)
        assert not any(it.board.commands[-1].goal), "the board has no servos"
        assert min(it.board.commands[-1].throttle) > 2000
        assert not it.chain.bus.reserved, "no read covers a reserved register"
        facts = it.io.hardware()
        assert facts["kind"] == "u2d2"
        assert facts["servos"]["voltage_v"] == [12.0] * 6
        assert facts["servo_link"]["round_trip_ms"] > 0.0


def test_turned_servos_and_other_neutrals_are_counted_in(wires: Wires) -> None:
    calibration = ServoCalibration({"module1_alpha": 2100}, ["module1_alpha", "module2_beta"])
    with bench(wires, calibration=calibration) as it:
        it.connect()
        plain = np.round(AHEAD[ANGLES] * 4096 / (2 * np.pi)).astype(int)
        signs, neutrals = np.array([-1, 1, 1, -1, 1, 1]), np.array([2100, *[2048] * 5])
        goals = (neutrals + signs * plain).tolist()
        it.until(lambda: it.chain.goals() == goals, AHEAD)
        there = plain * 2 * np.pi / 4096
        it.until(lambda: np.allclose(it.measured[ANGLES], there, atol=2e-3), AHEAD)


@pytest.mark.parametrize(
    ("calibration", "steps", "servos"),
    [
        (ServoCalibration({"module1_beta": 248}), 0, "2 (module1_beta)"),
        (None, 130, "1 (module1_alpha), 2 (module1_beta), 3 (module2_alpha), 4"),
    ],
    ids=["typo", "hanging gimbals"],
)
def test_a_servo_far_from_its_neutral_position_gets_no_torque(
    wires: Wires, calibration: ServoCalibration | None, steps: int, servos: str
) -> None:
    with bench(wires, ServoChain(steps=steps), calibration) as it:
        # One holds, as after a bridge that was killed.
        it.chain.servos[1].write(u2d2.GOAL_POSITION, u2d2.GOAL.pack(2048 + steps))
        it.chain.servos[1].write(servo_line.TORQUE_ENABLE, b"\x01")
        it.connect()
        it.until(lambda: it.code == Code.SERVO_FAR, AHEAD)
        assert it.fault.params["servos"].startswith(servos)
        end_s = time.monotonic() + 0.3
        it.until(lambda: time.monotonic() > end_s, AHEAD)
        assert it.chain.servos[1].position == 2048 + steps
        assert not it.chain.servos[1].torque
        assert it.board.commands[-1].arm == 0


def test_gimbals_that_nobody_drives_approach_slowly(wires: Wires) -> None:
    with bench(wires, ServoChain(steps=90)) as it:
        began_s, seen = time.monotonic(), set[int]()
        it.connect()
        assert it.chain.goals()[0] >= 2048 + 90 - 1

        def upright() -> bool:
            seen.add(it.chain.servos[0].position)
            return abs(it.chain.servos[0].position - 2048) <= 1

        it.until(upright, disarmed=True)
        assert time.monotonic() - began_s > 90 / 334
        assert len(seen) > 10


def test_a_gimbal_that_is_turned_upright_by_hand_gets_torque(wires: Wires) -> None:
    with bench(wires, ServoChain(steps=130)) as it:
        it.connect()
        it.until(lambda: it.code == Code.SERVO_FAR)
        it.chain.angles[:] = 0.0
        it.until(lambda: not it.fault)
        assert all(servo.torque for servo in it.chain.servos)


def test_servos_have_the_ids_of_the_calibration(wires: Wires) -> None:
    ids = dict(zip(GIMBALS, (17, 6, 252, 1, 3, 200), strict=True))
    calibration = ServoCalibration(servo_id=ids)
    with bench(wires, ServoChain(ids=tuple(ids.values())), calibration) as it:
        it.connect()
        assert it.board.setups[0].servo_id == tuple(ids.values()), "the board has the same"
        there = np.round(AHEAD[ANGLES] * 4096 / (2 * np.pi)).astype(int)
        it.until(lambda: it.chain.goals() == (2048 + there).tolist(), AHEAD)
        it.until(
            lambda: np.allclose(it.measured[ANGLES], there * 2 * np.pi / 4096, atol=2e-3), AHEAD
        )
        it.chain.servos[2].fault = True
        it.until(lambda: it.has(Code.SERVO_ERROR, servos="3 (module2_alpha)"))
        it.chain.servos[2].fault = False
        it.chain.servos[5].switch_off()
        it.until(lambda: it.has(Code.SERVO_LIMP, servos="6 (module3_beta)"))
        it.until(lambda: it.chain.servos[5].torque)


def test_the_watchdog_of_the_bus_stops_servos_without_requests(wires: Wires) -> None:
    with bench(wires) as it:
        it.connect()
        it.until(lambda: it.measured[0] > 0.02, AHEAD)
        assert it.chain.register(0, servo_line.BUS_WATCHDOG) == 10
        wires.clock.advance(SILENT_BUS_S)
        assert it.fault, "noticed"
        assert it.chain.tripped()
        there = [servo.position for servo in it.chain.servos]
        # The bridge continues: the watchdog is cleared first.
        it.until(lambda: not it.chain.tripped() and not it.fault)
        it.until(lambda: it.chain.goals() == [2048] * 6)
        assert there != [2048] * 6


def test_a_servo_that_dies_is_named_and_not_measured(wires: Wires) -> None:
    with bench(wires) as it:
        it.connect()
        it.until(lambda: not it.fault)
        it.chain.servos[3].dead = True
        it.until(lambda: it.has(Code.SERVOS_SILENT, servos="4 (module2_beta)"))
        it.until(lambda: np.isnan(it.measured[4]))
        assert np.isfinite(it.measured[[0, 1, 3, 6, 7]]).all()
        it.chain.servos[3].dead = False
        it.until(lambda: not it.fault)


def test_a_servo_with_a_hardware_error_is_named(wires: Wires) -> None:
    with bench(wires) as it:
        it.connect()
        it.chain.servos[5].fault = True
        it.until(lambda: it.has(Code.SERVO_ERROR, servos="6 (module3_beta)"))
        it.chain.servos[5].fault = False
        it.until(lambda: not it.fault)


def test_a_hot_servo_is_told_to_the_node_and_stops_the_wheels(wires: Wires) -> None:
    with bench(wires) as it:
        it.connect()
        it.until(lambda: it.board.commands[-1].arm == 1)
        assert isinstance(it.io, HasServoTemperature)
        it.chain.servos[3].temperature_c = 74
        it.until(lambda: it.io.servo_c(time.monotonic()) == 74.0)
        assert not it.fault
        it.chain.servos[3].temperature_c = 75
        it.until(lambda: it.has(Code.SERVO_TOO_HOT, servos="4 (module2_beta)", limit_c=75))
        it.until(lambda: it.board.commands[-1].arm == 0)
        it.chain.servos[3].temperature_c = 60
        it.until(lambda: not it.fault)


def test_an_adapter_that_is_unplugged_shuts_off_the_wheels_and_comes_back(wires: Wires) -> None:
    with bench(wires) as it:
        it.connect()
        it.until(lambda: it.board.commands[-1].arm == 1 and it.measured[0] > 0.02, AHEAD)
        wires.unplug("servos")
        it.until(lambda: it.fault and it.fault.code == Code.DEVICE_DISCONNECTED)
        it.until(lambda: it.board.commands[-1].arm == 0)
        wires.plug_in("servos", it.chain.answer)
        it.until(lambda: not it.fault)


@pytest.mark.parametrize(
    ("protocols", "dead", "words"),
    [
        ((2, 2, 1, 2, 2, 2), None, r"servo 3 \(module2_alpha\) speaks Protocol 1.0"),
        (
            (2,) * 6,
            1,
            r"servo 2 \(module1_beta\) does not answer at .* at 1000000 Bd: has it power, id 2 and",
        ),
    ],
)
def test_a_servo_that_cannot_be_used_is_named_at_the_start(
    wires: Wires, protocols: tuple[int, ...], dead: int | None, words: str
) -> None:
    chain = ServoChain(protocols)
    if dead is not None:
        chain.servos[dead].dead = True
    with bench(wires, chain) as it, pytest.raises(HardwareError, match=words):
        it.connect()


@pytest.mark.parametrize("setting", MODELS[311].settings, ids=lambda setting: setting.name)
def test_a_servo_with_another_setting_is_refused_and_left_as_it_is(
    wires: Wires, setting: ServoSetting
) -> None:
    chain = ServoChain()
    wrong = -5 if setting.size == 4 else 1
    chain.servos[4].set_register(setting.address, setting.size, wrong)
    sentence = (
        f"servo 5 (module3_alpha): {setting.name} (register {setting.address}) is {wrong}, "
        f"and must be {setting.wanted}; set it with Dynamixel Wizard"
    )
    with bench(wires, chain) as it:
        if setting.address in (servo_line.RETURN_DELAY, servo_line.BUS_WATCHDOG):
            it.connect()
            return
        with pytest.raises(HardwareError, match=re.escape(sentence)):
            it.connect()
        assert setting.value(chain.servos[4].read(setting.address, setting.size)) == wrong
        assert chain.register(4, servo_line.TORQUE_ENABLE) == 0


def test_a_servo_of_another_model_is_refused(wires: Wires) -> None:
    chain = ServoChain()
    chain.servos[1].set_register(0, 2, 1060)
    with bench(wires, chain) as it:
        with pytest.raises(HardwareError, match=r"servo 2 \(module1_beta\): model 1060 is not one"):
            it.connect()
        assert chain.register(1, servo_line.TORQUE_ENABLE) == 0


def _torque_lost_s(it: Bench, servo: Mx64, lose: Callable[[], None], wait_s: float) -> float:
    """Switch a servo off while armed; return how long the wheels ran on."""
    it.until(lambda: not it.fault and it.board.commands[-1].arm == 1, AHEAD)
    lose_s, faults = time.monotonic() + wait_s, [None]
    it.until(lambda: time.monotonic() > lose_s, AHEAD)
    lost_s = time.monotonic()
    lose()

    def off() -> bool:
        faults[0] = faults[0] or it.fault
        return it.board.commands[-1].arm == 0

    it.until(off, AHEAD)
    off_s = time.monotonic()
    it.until(lambda: servo.torque, AHEAD)
    assert faults[0] is not None
    assert faults[0].code == Code.SERVO_LIMP
    return off_s - lost_s


def test_torque_that_is_lost_while_armed_is_a_fault_within_a_tenth_of_a_second(
    wires: Wires,
) -> None:
    random = np.random.default_rng(7)
    with bench(wires) as it:
        it.connect()
        for i in range(LOSSES):
            servo = it.chain.servos[i % 6]
            lose = (servo.switch_off, servo.restart)[i % 2]
            assert _torque_lost_s(it, servo, lose, random.uniform(0.05, 0.1)) < 0.1


def test_closed_the_wheels_are_off_and_the_gimbals_go_to_neutral(wires: Wires) -> None:
    with bench(wires) as it:
        it.connect()
        it.until(lambda: it.board.commands[-1].arm == 1 and it.measured[0] > 0.02, AHEAD)
        it.io.close()
        assert it.board.commands[-1].arm == 0
        assert it.chain.goals() == [2048] * 6
        assert it.chain.register(0, servo_line.BUS_WATCHDOG) == 0
