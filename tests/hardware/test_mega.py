"""The joints behind a board, in virtual time, with a board that does as the test says."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator
from contextlib import closing, contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.hardware.wired_machines import Wires
from tests.support.pty_devices import PretendBoard
from tsd_twin import robots
from tsd_twin.hardware.arduino_mega import ArduinoMegaIO
from tsd_twin.hardware.dynamixel.control_table import (
    FW_VERSION,
    BoardCommand,
    BoardIdentity,
    BoardMode,
    ResetCause,
    Setup,
    Trip,
    TripHistory,
)
from tsd_twin.hardware.joints import EscCalibration, Receiver, ServoCalibration
from tsd_twin.hardware.link_health import LIMIT, WINDOW_S
from tsd_twin.hardware.robot_io import HasBattery, HasServoTemperature, HasWatchdog, RobotIO
from tsd_twin.hardware.serial_transport import HardwareError
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.safety import Heartbeat
from tsd_twin.simulation import Motors

pytestmark = pytest.mark.computes

PORT, LONGEST_S = "board", 5.0
ROBOT = robots.description_of_kind(robots.load_robot("tsd"), robots.SingularityDescription)
DRIVE = ROBOT.kinematics()
REST = np.zeros(9)
AHEAD = DRIVE.inverse(np.array([0.5, 0.0, 0.0]))


@contextmanager
def plugged(wires: Wires, board: PretendBoard) -> Generator[None]:
    """Have a pretended board at a port."""
    wires.plug_in(PORT, board.answer)
    yield
    wires.unplug(PORT)


@contextmanager
def connected(
    wires: Wires,
    board: PretendBoard,
    calibration: ServoCalibration | None = None,
    *,
    robot: robots.SingularityDescription = ROBOT,
    servos: bool = True,
) -> Generator[ArduinoMegaIO]:
    with (
        plugged(wires, board),
        closing(ArduinoMegaIO(robot, PORT, Motors.of(robot), calibration, servos=servos)) as io,
    ):
        yield io


def refused(
    wires: Wires,
    board: PretendBoard,
    words: str,
    robot: robots.SingularityDescription = ROBOT,
) -> str:
    """Return the error by which a board is not used."""
    with pytest.raises(HardwareError, match=words) as caught, connected(wires, board, robot=robot):
        pass
    return str(caught.value)


def wait_until(condition: Callable[[], object], what: str) -> None:
    end_s = time.monotonic() + LONGEST_S
    while not condition():
        assert time.monotonic() < end_s, what
        time.sleep(0.002)


def wrong(servo: str, setting: str, register: int, value: int, wanted: str) -> Reason:
    return because(
        Code.SERVO_SETTING,
        servo=servo,
        setting=setting,
        register=register,
        value=value,
        wanted=wanted,
    )


class Bench:
    """A robot with an emulated board, written to in the way the node does."""

    def __init__(self, board: PretendBoard, wires: Wires, robot: ArduinoMegaIO) -> None:
        self.board, self.wires, self.robot = board, wires, robot
        self.words = 0

    def plug_in(self) -> None:
        self.wires.plug_in(PORT, self.board.answer)

    def unplug(self) -> None:
        self.wires.unplug(PORT)

    def write(self, setpoint: np.ndarray = REST, *, armed: bool = False) -> None:
        self.words += 1
        now_s = time.monotonic()
        self.robot.set_heartbeat(Heartbeat(armed, self.words))
        self.robot.write(setpoint, now_s)

    def until(self, condition: Callable[[], object], what: str, **how: object) -> None:
        """Write as the node does until something is the case."""

        def met() -> object:
            self.write(**how)  # type: ignore[arg-type]
            return condition()

        wait_until(met, f"{what}: {self.fault!r} {self.robot.hardware()}")

    @property
    def fault(self) -> Reason | None:
        return self.robot.fault(time.monotonic())

    @property
    def code(self) -> str:
        return self.fault.code if self.fault else ""

    @property
    def told(self) -> BoardCommand:
        return self.board.commands[-1]

    @property
    def armed(self) -> bool:
        return self.robot.hardware().get("board") == "armed" and self.told.arm == 1

    @property
    def broken(self) -> int:
        return self.robot.hardware()["link"]["broken"]

    def arm(self, setpoint: np.ndarray = REST) -> None:
        """Arm, from disarmed."""
        self.until(lambda: not self.fault, "well")

        def armed() -> bool:
            assert not self.fault, self.fault
            return self.armed and (not setpoint.any() or any(self.told.goal))

        self.until(armed, "armed", setpoint=setpoint, armed=True)

    def disarm(self) -> None:
        self.until(lambda: self.told.arm == 0, "disarmed")


@contextmanager
def bench(
    wires: Wires,
    board: PretendBoard | None = None,
    robot: robots.SingularityDescription = ROBOT,
) -> Generator[Bench]:
    board = board or PretendBoard()
    with connected(wires, board, robot=robot) as io:
        yield Bench(board, wires, io)


@pytest.fixture
def it(wires: Wires) -> Generator[Bench]:
    with bench(wires) as made:
        yield made


def test_it_has_the_face_that_the_node_needs(it: Bench) -> None:
    io: RobotIO = it.robot
    assert isinstance(io, HasWatchdog)


def test_the_board_is_set_up_and_told_what_the_joints_shall_do(it: Bench) -> None:
    (setup,) = it.board.setups
    assert (setup.neutral, setup.reverse) == ((2048,) * 6, 0)
    assert (setup.goal_limit, setup.servos_expected) == (341, 63)
    it.arm(AHEAD)
    goals = np.round(AHEAD[[0, 1, 3, 4, 6, 7]] * 4096 / (2 * np.pi))
    assert it.told.goal == tuple(goals)
    assert all(2000 < throttle < 4000 for throttle in it.told.throttle)


def test_what_the_board_measures_is_read_once(it: Bench) -> None:
    it.board.report(position=(100, -100, 0, 1, 2, 3))
    it.until(lambda: it.robot.hardware()["connected"], "news")

    def news() -> bool:
        joints = it.robot.read(time.monotonic())
        return joints is not None and bool(joints[0] == pytest.approx(100 * 2 * np.pi / 4096))

    it.until(news, "measured")
    it.board.silent = True
    wait_until(lambda: it.robot.read(time.monotonic()) is None, "no more news")
    for _ in range(3):
        assert it.robot.read(time.monotonic()) is None


def test_the_heartbeat_is_the_count_of_words_and_nothing_else(it: Bench) -> None:
    it.arm()
    count = len(it.board.commands)
    it.robot.set_heartbeat(Heartbeat(True, 0x12345))
    for _ in range(20):
        it.robot.write(REST, time.monotonic())
        time.sleep(0.01)
    beats = {command.heartbeat for command in it.board.commands[count + 2 :]}
    assert beats == {0x2345}


@pytest.mark.parametrize(
    ("identity", "words"),
    [
        (
            BoardIdentity(table_version=99),
            "control table 99: this program needs model 2014 with table",
        ),
        (BoardIdentity(table_version=5), "control table 5: this program needs"),
        (BoardIdentity(model=312), "is model 312"),
    ],
)
def test_another_board_or_table_is_refused_in_a_sentence(
    wires: Wires, identity: BoardIdentity, words: str
) -> None:
    board = PretendBoard()
    board.identity = identity
    assert "flash the firmware that comes with it" in refused(wires, board, words)
    assert not board.commands


@pytest.mark.parametrize(
    ("item", "value", "named"),
    [
        ("wheel_radius_um", 46000, ("drive.wheel_radius_m", "0.046", "0.04")),
        (
            "pivot_x",
            (1500, -750, -750),
            ("x_m of the modules", "0.15, -0.075, -0.075", "0, -0.1299, 0.1299"),
        ),
        ("pivot_y", (1700, -750, -750), ("y_m of the modules", "0.17, -0.075, -0.075", None)),
        ("cruise_rpm", (2500, 2500, 2000), ("drive.cruise_speed_rpm", "2500, 2500, 2000", None)),
        ("max_tilt", 2500, ("drive.max_tilt_deg", "25", "30")),
        ("servo_steps", 1024, ("servo.steps_per_turn", "1024", "4096")),
        ("speed", 2000, ("limits.speed_mps", "2", "1")),
        ("turn_rate", 1000, ("limits.turn_rate_rad_per_s", "1", "3")),
        ("acceleration", 8000, ("limits.acceleration_mps2", "8", "4")),
        ("angular_acceleration", 500, ("limits.angular_acceleration_rad_per_s2", "5", "20")),
        ("wheel_radius_um", 0, ("drive.wheel_radius_m", "0", "0.04")),
    ],
)
def test_a_board_built_for_another_robot_does_not_arm(
    wires: Wires, item: str, value: Any, named: tuple[str, str, str | None]
) -> None:
    board = PretendBoard()
    board.geometry = replace(board.geometry, **{item: value})
    with bench(wires, board) as it:
        count = len(board.commands)
        fault = it.fault
        assert fault is not None
        assert fault.code == Code.BOARD_GEOMETRY
        assert (fault.params["item"], fault.params["board"]) == named[:2]
        assert named[2] in (None, fault.params["robot"])
        # Even a program that ignores the fault does not arm it.
        it.until(lambda: len(board.commands) > count + 10, "written", armed=True)
        assert not any(command.arm for command in board.commands)
        assert it.fault == fault


def test_a_calibrated_robot_is_still_the_one_that_the_board_was_built_for(wires: Wires) -> None:
    board = PretendBoard()
    board.geometry = replace(
        board.geometry, wheel_radius_um=41000, pivot_y=(1540, -770, -770), max_tilt=2990
    )
    with bench(wires, board) as it:
        assert it.fault is None
        it.arm()


def test_without_servos_at_the_board_its_geometry_does_not_matter(wires: Wires) -> None:
    """Radio control needs all six servos at the board."""
    board = PretendBoard()
    board.geometry = replace(board.geometry, wheel_radius_um=46000)
    with connected(wires, board, servos=False) as robot:
        assert robot.fault(time.monotonic()) is None


def test_the_build_of_the_firmware_is_shown(wires: Wires) -> None:
    board = PretendBoard()
    board.identity = BoardIdentity(build=0x12AB34)
    with bench(wires, board) as it:
        assert it.robot.hardware()["firmware"] == f"{FW_VERSION}, build 0012ab34"


def test_a_board_that_refuses_its_set_up_is_not_used(wires: Wires) -> None:
    board = PretendBoard()
    board.error = 4
    refused(wires, board, "refuses its set-up: error 4")


def test_a_board_with_power_at_its_drive_refuses_another_zero_throttle_and_says_why(
    wires: Wires, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tsd_twin.hardware.controller_board._RUN_DOWN_S", 0.2)
    board = PretendBoard()
    board.error = 7
    refused(wires, board, "error 7; open the contactor: it takes another zero")


def test_receiver_and_pulse_ends_of_the_calibration_are_told_to_the_board(wires: Wires) -> None:
    calibration = ServoCalibration(
        receiver=Receiver(kind="sbus", channels=(2, 1, 4, 3, 16, 6), dead_us=30),
        speed_controllers=EscCalibration((1000.0, 1060.0, 1200.0), (2000.0, 1940.5, 2200.0)),
    )
    board = PretendBoard()
    board.report(throttle_out=(2000, 3000, 4000))
    with connected(wires, board, calibration) as robot:
        assert robot.hardware()["pulse_us"] == [1000.0, 1500.25, 2200.0]
    told = board.setups[0]
    assert (told.receiver_kind, told.receiver_map, told.stick_dead) == (1, 0x5F2301, 30)
    assert (told.pulse_low, told.pulse_high) == ((2000, 2120, 2400), (4000, 3881, 4400))
    # The fastest speed that an operator can select is nearly what all motors reach.
    assert (max(told.throttle_limit), told.throttle_rise) == (4000, 80)


def test_a_board_that_the_radio_control_has_is_met_if_it_knows_its_set_up(
    wires: Wires,
) -> None:
    board = PretendBoard()
    with plugged(wires, board):
        for _ in range(2):
            ArduinoMegaIO(ROBOT, PORT, Motors.of(ROBOT)).close()
        assert len(board.setups) == 1, "told once: it says that it knows"
        board.obeys_arm = False
        board.report(mode=BoardMode.RC)
        robot = ArduinoMegaIO(ROBOT, PORT, Motors.of(ROBOT))
        assert robot.fault(time.monotonic()) == because(Code.RADIO_CONTROL)
        robot.close()
        assert len(board.setups) == 1
        board.error = 7
        with pytest.raises(HardwareError, match="cannot be set up while the radio control has"):
            ArduinoMegaIO(ROBOT, PORT, Motors.of(ROBOT), ServoCalibration({"module1_beta": 9}))


def test_the_thresholds_of_the_battery_are_told_to_the_board_and_warned_of(
    it: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    battery = ROBOT.battery
    written = it.board.setups[0]
    assert written.battery_arm_mv == pytest.approx(1000.0 * battery.arm_v)
    assert written.battery_stop_mv == pytest.approx(1000.0 * battery.stop_v)
    low_v = round(0.5 * (battery.warn_v + battery.arm_v), 1)
    it.board.report(battery_mv=round(1000.0 * low_v))
    it.until(lambda: it.robot.hardware().get("warnings"), "warned")
    assert it.robot.hardware()["warnings"] == [f"the battery is low: below {battery.warn_v:g} V"]
    assert caplog.text.count("the battery is low") == 1
    assert it.fault is None
    it.board.report(battery_mv=round(990.0 * battery.arm_v))
    it.until(lambda: it.fault, "refused")
    assert it.fault == because(Code.BATTERY_TOO_LOW, volts=0.99 * battery.arm_v)
    it.board.report(battery_mv=12500)
    it.until(lambda: not it.fault and not it.robot.hardware()["warnings"], "well")


@pytest.mark.parametrize(
    ("receiver", "pulses", "channels", "warned"),
    [
        (Receiver(), (0,) * 6, "forward, left, turn, speed, kill, manual", False),
        (Receiver(), (1500, 1500, 1500, 1100, 0, 1100), "kill", False),
        (None, (1500, 0, 1500, 1100, 1900, 1100), "left", True),
        (None, (1500, 1500, 1500, 1100, 1900, 1100), "", True),
        (None, (0,) * 6, "", False),
    ],
)
def test_what_is_missing_of_the_radio_control_is_named_before_arming(
    wires: Wires,
    receiver: Receiver | None,
    pulses: tuple[int, ...],
    channels: str,
    warned: bool,
) -> None:
    board = PretendBoard()
    board.report(rc=pulses)
    with connected(wires, board, ServoCalibration(receiver=receiver)) as robot:
        silent = because(Code.RECEIVER_SILENT, channels=channels) if channels else None
        assert robot.fault(time.monotonic()) == silent
        assert ("--setup" in "".join(robot.hardware()["warnings"])) == warned
    assert board.setups[0].receiver_expected == (receiver is not None)
    assert board.setups[0].stick_low == (receiver or Receiver()).low_us


@pytest.mark.parametrize(
    ("telemetry", "fault"),
    [
        (
            {"servo_checked": 0b011111, "wrong_servo": 6, "wrong_register": 11, "wrong_value": 4},
            wrong("6 (module3_beta)", "operating mode", 11, 4, "3"),
        ),
        (
            {"servo_checked": 62, "wrong_servo": 1, "wrong_register": 20, "wrong_value": 2**32 - 7},
            wrong("1 (module1_alpha)", "homing offset", 20, -7, "0"),
        ),
        (
            {
                "servo_protocol": 0,
                "servo_model": (310,) * 6,
                "servo_checked": 62,
                "wrong_servo": 1,
                "wrong_register": 20,
                "wrong_value": 5,
            },
            wrong("1 (module1_alpha)", "multi-turn offset", 20, 5, "0"),
        ),
        (
            {"servo_checked": 62, "wrong_servo": 1, "wrong_register": 0, "wrong_value": 12},
            because(
                Code.SERVO_MODEL,
                servo="1 (module1_alpha)",
                model=12,
                known="MX-64 (310), MX-64(2.0) (311), XM430-W350 (1020), XM430-W210 (1030), "
                "XM540-W270 (1120), XM540-W150 (1130)",
            ),
        ),
        ({"servo_checked": 0b111011}, because(Code.SERVO_UNREAD, servos="3 (module2_alpha)")),
        ({"servo_torque": 0b110111}, because(Code.SERVO_LIMP, servos="4 (module2_beta)")),
        (
            {"servo_torque": 0b111101, "servo_far": 0b000010},
            because(Code.SERVO_FAR, servos="2 (module1_beta)"),
        ),
    ],
)
def test_a_servo_that_is_not_set_or_does_not_hold_is_named(
    it: Bench, telemetry: dict[str, Any], fault: Reason
) -> None:
    it.board.report(**telemetry)
    it.until(lambda: it.fault == fault, "named")


def test_a_gimbal_that_did_not_follow_is_named(it: Bench) -> None:
    it.arm()
    it.board.obeys_arm = False
    it.board.report(mode=BoardMode.DISARMED, trip=Trip.FOLLOWING, servo_stuck=0b000010)
    told = "a gimbal does not follow its goal: it is stuck, or its servo is"
    trip = because(Code.BOARD_TRIP, trip="following")
    fault = because(Code.GIMBALS_STUCK, trip, servos="2 (module1_beta)")
    it.until(lambda: it.fault == fault, "named", armed=True)
    assert it.robot.hardware()["last_trip"] == f"servo 2 (module1_beta): {told}"


def test_the_last_trips_are_told_and_read_again_after_each(wires: Wires) -> None:
    board = PretendBoard()
    board.report(nonce=(300, 1))
    board.history = TripHistory(
        past_trip=(Trip.STOPPED, Trip.BATTERY, 99, *(0,) * 5),
        past_start=(44, 42, 255, *(0,) * 5),
        past_uptime_s=(7, 65535, 1, *(0,) * 5),
        past_lowest=(121, 98, *(0,) * 6),
    )
    with bench(wires, board) as it:
        it.until(lambda: "past_trips" in it.robot.hardware(), "read")
        assert it.robot.hardware()["past_trips"] == {
            "1": "STOP; 7 s after a start, in this power-up; battery down to 12.1 V",
            "2": "the battery is empty; 65535 s after a start, power-up 2 before this one; "
            "battery down to 9.8 V",
            "3": "trip 99; 1 s after a start, power-up 45 before this one",
        }
        board.history = replace(board.history, past_trip=(Trip.KILL,) * 8)
        for _ in range(20):
            it.write()
            time.sleep(0.005)
        assert it.robot.hardware()["past_trips"]["1"].startswith("STOP"), "no trip, no read"
        it.board.report(trips=1)
        it.until(lambda: len(it.robot.hardware()["past_trips"]) == 8, "read again")
        assert it.code == ""


def test_a_stop_that_was_never_seen_to_work_is_asked_for_once(it: Bench) -> None:
    it.board.report(stop_proven=0)
    untested = because(Code.ARMING_OBSTACLE, what="stop_not_proven")
    it.until(lambda: it.fault == untested, "asked for")
    it.board.report(stop_proven=1)
    it.until(lambda: it.fault is None, "seen")


def test_a_stop_reaches_the_board_also_when_the_radio_control_has_the_robot(it: Bench) -> None:
    it.board.obeys_arm = False
    it.board.report(mode=BoardMode.RC)
    it.until(lambda: it.code == Code.RADIO_CONTROL, "taken")

    def written(heartbeat: Heartbeat, arm: int) -> bool:
        it.robot.set_heartbeat(heartbeat)
        it.robot.write(REST, time.monotonic())
        return it.told.arm == arm

    wait_until(lambda: written(Heartbeat(False, 7, latched=True, stopped=True), 2), "stopped")
    wait_until(lambda: written(Heartbeat(False, 8), 0), "released by the reset")


def test_the_node_is_told_the_voltage_of_the_battery(it: Bench) -> None:
    assert isinstance(it.robot, HasBattery)
    it.board.report(battery_mv=11150)
    it.until(lambda: it.robot.battery_v(time.monotonic()) == 11.15, "measured")
    it.unplug()
    it.until(lambda: it.robot.battery_v(time.monotonic()) is None, "not any more")


def test_the_node_is_told_the_hottest_servo_and_75_degrees_are_a_fault(it: Bench) -> None:
    assert isinstance(it.robot, HasServoTemperature)
    it.board.report(temperature=(40, 50, 74, 45, 40, 40))
    it.until(lambda: it.robot.servo_c(time.monotonic()) == 74.0, "measured")
    it.until(lambda: not it.fault, "no fault")
    it.board.report(temperature=(40, 50, 75, 45, 40, 76))
    it.until(
        lambda: (
            it.fault
            == because(Code.SERVO_TOO_HOT, servos="3 (module2_alpha), 6 (module3_beta)", limit_c=75)
        ),
        "named",
    )
    it.unplug()
    it.until(lambda: it.robot.servo_c(time.monotonic()) is None, "not any more")


def test_a_servo_with_the_id_of_the_board_is_not_told_to_flash_firmware(wires: Wires) -> None:
    board = PretendBoard()
    board.identity = BoardIdentity(model=311)
    words = r"is a servo, MX-64\(2.0\), with the id 200"
    assert "flash" not in refused(wires, board, words)


def test_missed_answers_are_counted_for_each_servo(it: Bench) -> None:
    it.until(lambda: it.robot.hardware().get("servos"), "connected")
    it.board.report(servo_missed=(0, 0, 250, 0, 0, 0))
    it.until(lambda: it.robot.hardware()["servos"]["missed"] == [0, 0, 250, 0, 0, 0], "counted")
    it.board.report(servo_missed=(1, 0, 4, 0, 0, 0))
    it.until(lambda: it.robot.hardware()["servos"]["missed"] == [1, 0, 260, 0, 0, 0], "wrapped")


def test_the_commands_carry_the_session_of_the_board(it: Bench) -> None:
    it.arm()
    it.board.report(nonce=(7, 65535))
    it.until(lambda: it.told.session == (7, 65535), "of this session", armed=True)


def test_a_port_at_which_nobody_answers_is_named(
    wires: Wires, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tsd_twin.hardware.controller_board._BOOT_S", 0.2)
    board = PretendBoard()
    board.silent = True
    refused(wires, board, "answers as a controller board at 1000000 Bd")


def test_turned_servos_and_other_neutrals_are_told_to_the_board(wires: Wires) -> None:
    board = PretendBoard()
    calibration = ServoCalibration({"module2_alpha": 2100}, ["module1_beta", "module3_beta"])
    with connected(wires, board, calibration):
        pass
    assert board.setups[0].neutral == (2048, 2048, 2100, 2048, 2048, 2048)
    assert board.setups[0].reverse == 0b100010


def test_a_board_that_trips_is_a_fault_until_the_robot_was_disarmed(it: Bench) -> None:
    it.arm()
    it.board.obeys_arm = False
    it.board.report(mode=0, trip=Trip.HEARTBEAT)
    it.until(lambda: it.fault, "tripped", armed=True)
    assert it.fault == because(Code.BOARD_TRIP, trip="heartbeat")
    it.until(lambda: it.told.arm == 0, "asks no more", armed=True)
    it.board.obeys_arm = True
    count = len(it.board.commands)
    it.until(lambda: len(it.board.commands) > count + 20, "cycles", armed=True)
    assert not any(command.arm for command in it.board.commands[count:])
    it.disarm()
    it.until(lambda: not it.fault, "well again")
    it.arm()


def test_unplugged_it_is_a_fault_and_back_it_is_disarmed(it: Bench) -> None:
    it.arm()
    it.unplug()
    it.until(lambda: it.fault, "gone", armed=True)
    it.until(lambda: it.code == Code.DEVICE_DISCONNECTED, "said so", armed=True)
    assert it.robot.hardware()["connected"] is False
    assert it.robot.read(time.monotonic()) is None
    count = len(it.board.commands)
    it.plug_in()
    it.until(lambda: it.robot.hardware()["connected"], "back", armed=True)
    it.until(lambda: len(it.board.commands) > count + 20, "cycles", armed=True)
    assert not any(command.arm for command in it.board.commands[count:])
    assert it.code == Code.BOARD_LOST
    it.disarm()
    it.arm()


def test_a_board_that_restarts_is_set_up_again_and_stays_disarmed(it: Bench) -> None:
    it.arm()
    count = len(it.board.commands)
    it.board.report(millis=0, resets=1, mode=0)
    it.board.table[Setup.ADDRESS] ^= 1  # It has forgotten, too.
    it.until(lambda: it.code == Code.BOARD_RESTARTED, "noticed", armed=True)
    it.until(lambda: len(it.board.setups) == 2, "set up again", armed=True)
    it.until(lambda: len(it.board.commands) > count + 20, "cycles", armed=True)
    assert not any(command.arm for command in it.board.commands[-15:])


@pytest.mark.parametrize(
    ("cause", "word"),
    [(ResetCause.BROWN_OUT, "brown_out"), (ResetCause.POWER_ON, "power_on")],
)
def test_a_board_that_restarts_says_why(it: Bench, cause: ResetCause, word: str) -> None:
    it.arm()
    it.board.report(millis=0, resets=1, mode=0, reset_cause=int(cause))
    restarted = because(Code.BOARD_RESTARTED, reset=word)
    it.until(lambda: it.fault == restarted, "noticed", armed=True)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"millis": 1500, "reset_cause": int(ResetCause.EXTERNAL)}, "cut RESET-EN"),
        ({"millis": 1500, "reset_cause": 0}, "cut RESET-EN"),
        ({"battery_mv": 300}, "runs with 0.3 V of battery: USB feeds it"),
        ({"millis": 1500, "reset_cause": int(ResetCause.POWER_ON)}, ""),
        ({"millis": 1500, "reset_cause": int(ResetCause.WATCHDOG)}, ""),
        ({"millis": 1500, "reset_cause": int(ResetCause.BROWN_OUT)}, ""),
        ({}, ""),
    ],
)
def test_a_mistake_in_the_wiring_is_recognised_when_it_connects(
    wires: Wires, change: dict[str, int], told: str, caplog: pytest.LogCaptureFixture
) -> None:
    board = PretendBoard()
    board.report(**change)
    with connected(wires, board) as robot:
        wiring = robot.hardware()["warnings"]
    assert len(wiring) == bool(told)
    assert told in "".join(wiring)
    assert told in caplog.text


def test_a_board_that_lost_its_power_with_the_plug_is_recognised(it: Bench) -> None:
    it.arm()
    it.unplug()
    it.until(lambda: it.code == Code.DEVICE_DISCONNECTED, "gone", armed=True)
    it.board.report(millis=10, reset_cause=1, mode=0)
    it.plug_in()
    it.until(lambda: it.robot.hardware()["connected"], "back", armed=True)
    assert "lost its power together with the line" in it.robot.hardware()["warnings"][0]


def test_a_board_that_falls_silent_is_a_fault_within_a_tenth_of_a_second(it: Bench) -> None:
    it.arm()
    it.board.silent = True
    it.until(lambda: it.fault, "silence", armed=True)
    assert it.fault == because(Code.DEVICE_SILENT, device="board", ms=100)
    it.board.silent = False
    it.until(lambda: not it.fault, "hears again", armed=True)


def test_answers_that_come_one_question_late_are_not_taken_for_those_to_this_one(
    it: Bench,
) -> None:
    it.arm()
    before = it.robot.hardware()["link"]
    it.board.late = 2
    it.until(lambda: it.fault, "noticed", armed=True)
    assert it.fault == because(Code.DEVICE_SILENT, device="board", ms=100)
    it.board.late = 0
    it.until(lambda: not it.fault, "hears again", armed=True)
    assert it.robot.hardware()["link"]["missed"] > before["missed"]


def spoil(it: Bench, count: int) -> None:
    """Spoil an answer until `count` have been seen; one that is not read is lost."""
    again_s = -math.inf

    def counted() -> bool:
        nonlocal again_s
        if it.broken < count and time.monotonic() > again_s:
            it.board.spoils, again_s = 1, time.monotonic() + 1.0
        return it.broken >= count

    it.until(counted, "counted", armed=True)


def test_a_broken_answer_now_and_then_is_missed_and_stops_nobody(
    it: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    it.arm()
    caplog.clear()
    missed, broken = it.robot.hardware()["link"]["missed"], it.broken
    for count in range(1, LIMIT):
        spoil(it, broken + count)
        it.until(lambda: it.robot.read(time.monotonic()) is not None, "measured", armed=True)
    assert it.robot.hardware()["link"]["missed"] >= missed + LIMIT - 1
    assert "garbage" not in caplog.text


@pytest.mark.parametrize("kind", ["stray", "spoilt", "misheard"])
def test_garbage_is_a_fault_until_the_line_is_clean_and_nothing_arms_by_itself(
    it: Bench, kind: str, caplog: pytest.LogCaptureFixture
) -> None:
    it.arm(AHEAD)

    def soil() -> None:
        match kind:
            case "stray":
                it.board.stray = bytes(range(1, 200))
            case "spoilt":
                it.board.spoils = 1000
            case _:
                errors = it.board.telemetry.rx_errors + 1
                it.board.report(rx_errors=errors)

    def told() -> bool:
        soil()
        return it.code == Code.LINE_GARBAGE

    it.until(told, "noticed", setpoint=AHEAD, armed=True)
    assert it.fault.params["line"] == "board"
    assert it.fault.params["count"] >= 2
    assert it.fault.params["s"] < 2.0 * WINDOW_S
    it.until(lambda: soil() or it.told.arm == 0, "disarmed", armed=True)
    it.board.stray, it.board.spoils = b"", 0
    it.until(lambda: "over a clean line" in caplog.text, "clean", armed=True)
    count = len(it.board.commands)
    it.until(lambda: len(it.board.commands) > count + 20, "cycles", armed=True)
    assert not any(command.arm for command in it.board.commands[count:])
    it.until(
        lambda: it.code == Code.LINE_GARBAGE, "latched until the robot is disarmed", armed=True
    )
    assert caplog.text.count("garbage on the serial line") == 1, "one message says so"
    it.disarm()
    it.until(lambda: not it.fault, "well")
    it.arm()


def test_garbage_after_a_silence_is_logged_too(it: Bench, caplog: pytest.LogCaptureFixture) -> None:
    it.arm()
    it.board.silent = True
    it.until(lambda: it.code == Code.DEVICE_SILENT, "silence", armed=True)
    it.board.spoils, it.board.silent = 1000, False
    it.until(lambda: "garbage on the serial line" in caplog.text, "logged", armed=True)


def test_a_node_that_hangs_is_not_obeyed_any_more(it: Bench) -> None:
    """The serial thread keeps running, but must not repeat the last set-point."""
    it.arm(AHEAD)
    wait_until(lambda: it.told.arm == 0, "at rest")
    assert it.told.throttle == (2000,) * 3
    assert not any(it.told.goal)
    it.until(lambda: it.code == Code.NODE_HANGS, "said so", armed=True)
    assert it.told.arm == 0


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"mode": int(BoardMode.RC)}, because(Code.RADIO_CONTROL)),
        ({"servo_alive": 0b111011}, because(Code.SERVOS_SILENT, servos="3 (module2_alpha)")),
        ({"drive_on": 0}, because(Code.ARMING_OBSTACLE, what="drive")),
        ({"servo_fault": 0b000001}, because(Code.SERVO_ERROR, servos="1 (module1_alpha)")),
    ],
)
def test_what_is_wrong_below_the_board_is_said(
    it: Bench, change: dict[str, int], fault: Reason
) -> None:
    it.board.obeys_arm = False
    it.until(lambda: not it.fault, "well")
    it.board.report(**change)
    it.until(lambda: it.fault, "noticed")
    assert it.fault == fault


def test_a_servo_that_is_dead_is_not_measured(it: Bench) -> None:
    it.board.report(servo_alive=0b111110, position=(5,) * 6)

    def measured() -> bool:
        joints = it.robot.read(time.monotonic())
        return joints is not None and bool(np.isnan(joints[0]) and joints[1] > 0.0)

    it.until(measured, "measured without it")


def test_the_status_has_figures_of_link_board_and_servos(it: Bench) -> None:
    it.board.report(battery_mv=11870, voltage=(118,) * 6, temperature=(41,) * 6, rx_errors=3)
    it.until(lambda: it.robot.hardware().get("battery_v") == 11.87, "figures")
    facts = it.robot.hardware()
    assert facts["kind"] == "mega"
    assert facts["board"] == "disarmed"
    assert facts["pulse_us"] == [1000.0] * 3
    assert facts["servos"]["temperature_c"] == [41] * 6
    assert facts["servos"]["voltage_v"] == [11.8] * 6
    assert facts["servos"]["alive"] == [True] * 6
    assert facts["counters"]["rx_errors"] == 3
    assert facts["link"]["round_trip_ms"] > 0.0
    assert facts["link"]["missed"] == 0


def test_closed_the_board_is_disarmed(wires: Wires) -> None:
    with bench(wires) as made:
        made.arm(AHEAD)
        made.robot.close()
        assert made.told == BoardCommand()
        made.robot.close()
