"""Wiring errors of the machines in docs/wiring.md, and the step that must find each.

`python -m tests.hardware.wiring_errors` prints the table of docs/wiring.md.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from msgspec import structs

from tests.hardware.wired_machines import (
    Bench,
    Person,
    VirtualMotors,
    WatchedMotor,
    WatchedServo,
    WiredMega,
)
from tests.support.pty_devices import ServoChain
from tests.support.x_series import XBus
from tsd_twin.hardware.arduino_mega import ArduinoMegaIO
from tsd_twin.hardware.can_wheels import CanWheelsIO
from tsd_twin.hardware.commissioning.check import check
from tsd_twin.hardware.commissioning.findings import FindingCode
from tsd_twin.hardware.commissioning.sheet import Result, Sheet
from tsd_twin.hardware.commissioning.steps import HandTurn, Step, Swing, Tilt, Turn, steps_for
from tsd_twin.hardware.commissioning.walk import Commissioned
from tsd_twin.hardware.dynamixel_wheels import DynamixelWheelsIO
from tsd_twin.hardware.joints import MotorControllers, Receiver, ServoCalibration
from tsd_twin.hardware.u2d2 import U2D2IO
from tsd_twin.robots import (
    OmniDescription,
    RobotDescription,
    SingularityDescription,
    description_of_kind,
    load_robot,
)
from tsd_twin.robots.singularity_parts import WheelSensor
from tsd_twin.simulation import Motors

TSD = description_of_kind(load_robot("tsd"), SingularityDescription)
KIWI = description_of_kind(load_robot("examples/kiwi_xl430.toml"), OmniDescription)
_IDS = (1, 2, 3, 4, 5, 6)


class Wired:
    """Machine with its wires, and the person who commissions it."""

    robot: RobotDescription = TSD
    kind: str
    plan: str
    receiver = hall_sensors = False
    person: Person

    def steps(self) -> tuple[Step, ...]:
        """Return its steps."""
        joints = self.robot.kinematics().joints
        return steps_for(self.kind, joints, receiver=self.receiver, hall_sensors=self.hall_sensors)

    def begin(self, file: Path, until: str) -> None:
        """Write the sheet of a machine that passed all motions before a step."""
        sheet = Sheet(self.robot.name, self.kind)
        for step in self.steps():
            if step.name == until:
                break
            if isinstance(step, (Tilt, HandTurn, Swing, Turn)):
                sheet.results.append(Result(step.name, "2026-01-01T00:00:00+00:00"))
        sheet.save(file)

    def check(self, file: Path) -> tuple[bool, list[str]]:
        """Walk through the steps; return whether all passed, and the printed lines."""
        said: list[str] = []
        passed = check(
            self.robot,
            self.kind,
            file,
            self.connect,
            receiver=self.receiver,
            ask=self.person.ask,
            say=said.append,
        )
        return passed, said

    def connect(self) -> Commissioned:
        """Open the hardware interface."""
        raise NotImplementedError

    @property
    def driven(self) -> bool:
        """Whether anything is driven."""
        raise NotImplementedError


class MegaMachine(Wired):
    """Mega with servos and ESCs."""

    kind, plan, receiver = "mega", "mega", True

    def __init__(self, bench: Bench) -> None:
        self.board = WiredMega()
        rpm = TSD.wheel_speed_range.least_rad_per_s * 30.0 / math.pi
        self.person = Person(bench, mega=self.board, rpm=rpm)
        bench.ports["board"] = self.board.answer

    def connect(self) -> Commissioned:
        calibration = ServoCalibration(receiver=Receiver())
        robot = description_of_kind(self.robot, SingularityDescription)
        return ArduinoMegaIO(robot, "board", Motors.of(robot), calibration)

    @property
    def driven(self) -> bool:
        return bool(self.board.commands) and self.board.commands[-1].arm == 1

    def telemetry(self, **values: object) -> None:
        """Replace what the board measures."""
        self.board.report(**values)


class MegaWithSensors(MegaMachine):
    """Mega with Hall sensors at its wheels."""

    hall_sensors = True
    robot = structs.replace(TSD, wheel_sensor=WheelSensor(pulses_per_turn=4))

    def __init__(self, bench: Bench) -> None:
        super().__init__(bench)
        self.board.sensor_rpm = self.person.rpm


class Rp2040WithTelemetry(MegaWithSensors):
    """Board with an RP2040 and telemetry wires of the ESCs."""

    hall_sensors = False
    robot = structs.replace(TSD, wheel_sensor=WheelSensor(kind="telemetry", pole_pairs=7))


class BusWheels(Wired):
    """Kiwi with wheels on a Dynamixel bus."""

    kind, plan, robot = "dynamixel_wheels", "bus_wheels", KIWI

    def __init__(self, bench: Bench) -> None:
        self.servos = [WatchedServo(i) for i in (1, 2, 3)]
        self.person = Person(bench, {"Voltage of the battery": "11.1"}, wheels=self.servos)
        bench.ports["servos"] = XBus(list(self.servos)).answer
        bench.watch(self.servos)

    def connect(self) -> Commissioned:
        return DynamixelWheelsIO(KIWI, "servos")

    @property
    def driven(self) -> bool:
        return any(servo.goal for servo in self.servos)


class CanMachine(Wired):
    """Wheels with motor controllers on CAN."""

    wheels: MotorControllers

    def __init__(self, bench: Bench) -> None:
        self.motors = [WatchedMotor(i, self.wheels.kind) for i in self.wheels.ids]
        self.person = Person(bench, {"Voltage of the battery": "24.0"}, wheels=self.motors)
        bench.motors = VirtualMotors(bench.clock, self.motors)
        bench.watch(self.motors)

    def set_motors(self, *motors: int, **values: object) -> None:
        """Set values of motors, from 1."""
        for i in motors:
            for name, value in values.items():
                setattr(self.motors[i - 1], name, value)

    def connect(self) -> Commissioned:
        return CanWheelsIO(self.robot, "virtual:", self.wheels)

    @property
    def driven(self) -> bool:
        return any(motor.driven for motor in self.motors)


class CanWheelsMachine(CanMachine):
    """Kiwi with a moteus at each wheel."""

    kind, plan = "can", "can_wheels"
    robot = description_of_kind(load_robot("kiwi"), OmniDescription)
    wheels = MotorControllers("moteus", [1, 2, 3])


class U2D2Machine(CanMachine):
    """Gimbals on a U2D2, and wheels with VESC."""

    kind, plan = "u2d2+can", "u2d2_can"
    wheels = MotorControllers("vesc", [1, 2, 3])

    def __init__(self, bench: Bench) -> None:
        super().__init__(bench)
        self._bench = bench
        self.set_ids(_IDS)

    def set_ids(self, ids: tuple[int, ...]) -> None:
        """Replace the servos by some with other ids."""
        self.chain = self.person.chain = ServoChain(ids=ids)
        self._bench.ports["servos"] = self.chain.answer

    def set_model(self, servo: int, model: int) -> None:
        """Set the model number of a servo, from 1."""
        self.chain.servos[servo - 1].set_register(0, 2, model)

    def connect(self) -> Commissioned:
        wheels = CanWheelsIO(TSD, "virtual:", self.wheels)
        return U2D2IO(TSD, wheels, "servos", Motors.of(TSD), ServoCalibration())


@dataclass(frozen=True)
class WiringError:
    """Wiring error, and where it must be found."""

    machine: type[Wired]
    what: str
    step: str
    code: FindingCode
    answers: Mapping[str, str] = field(default_factory=dict[str, str])
    """Answers of the person because of it, by part of the question."""
    harm: Callable[[Any], object] = lambda _: None


def _swapped(wheels: list[Any]) -> list[Any]:
    return [wheels[1], wheels[0], *wheels[2:]]


def _of(name: str, /, **values: object) -> Callable[[Any], None]:
    """Return a function that sets values of a part of a machine."""

    def harm(machine: Any) -> None:
        part = getattr(machine, name)
        for key, value in values.items():
            setattr(part, key, value)

    return harm


def _id_1_twice(it: BusWheels) -> None:
    it.servos[1].id = 1
    it.servos[1].put(7, 1, 1)


def _mega(
    what: str,
    step: str,
    code: FindingCode,
    answers: Mapping[str, str] | None = None,
    **values: object,
) -> WiringError:
    return WiringError(MegaMachine, what, step, code, answers or {}, _of("board", **values))


def _measured(what: str, step: str, code: FindingCode, **telemetry: object) -> WiringError:
    return WiringError(MegaMachine, what, step, code, {}, lambda it: it.telemetry(**telemetry))


_Code = FindingCode
ERRORS = (
    _mega("plus and minus touch", "short_circuit", _Code.MEASURED, {"from + to -": "0.4"}),
    _mega("battery reversed", "polarity", _Code.MEASURED, {"at the fuse holder": "-12.4"}),
    _mega("diode of the coil missing", "coil_diode", _Code.MEASURED, {"minus end": "9"}),
    _mega("Zener of the coil reversed", "coil_zener", _Code.MEASURED, {"plus end": "9"}),
    _mega("no precharge resistor", "precharge", _Code.MEASURED, {"precharge button": "1e6"}),
    _mega("regulator for 6 V", "regulator", _Code.MEASURED, {"board's 5 V wire off": "6.1"}),
    _mega("red wire of an ESC plug", "second_supply", _Code.MEASURED, {"5 V pin": "5.0"}),
    _mega("5 V wire of USB", "usb_supply", _Code.NOT_CONFIRMED, {"are all lights": "n"}),
    _mega("no inverter for SBUS", "sbus_level", _Code.MEASURED, {"voltage at D15": "0.3"}),
    _mega("data wires of the board swapped", "connection", _Code.NO_CONNECTION, silent=True),
    _measured("thin supply wire", "board_supply", _Code.BOARD_SUPPLY, supply_mv=4500),
    _mega("contacts welded", "drive_open", _Code.DRIVE_ON, welded=True),
    _mega("A1 before the contactor", "drive_open", _Code.DRIVE_ON, a1_upstream=True),
    _measured("receiver not connected", "receiver", _Code.NO_RECEIVER, rc=(0,) * 6),
    _mega("divider with wrong resistors", "battery", _Code.BATTERY_DIFFERS, divider=0.8),
    _measured("servo 4 without data", "servos", _Code.SERVO_SILENT, servo_alive=0b110111),
    _measured("branch with a bad contact", "servos", _Code.SERVO_SUPPLY,
              voltage=(120, 120, 120, 100, 120, 120)),
    _mega("no pull-up at the servo bus", "line", _Code.LINE_ERRORS, noise=1),
    WiringError(MegaMachine, "RESET-EN not cut", "warnings", _Code.WARNING, {},
                lambda it: it.board.young()),
    _mega("ids 1 and 2 swapped", "tilt_module1_alpha", _Code.JOINT_SWAPPED,
          servo_order=[1, 0, 2, 3, 4, 5]),
    _mega("servo 2 mounted reversed", "tilt_module1_beta", _Code.JOINT_REVERSED,
          servo_signs=[1, -1, 1, 1, 1, 1]),
    _mega("fuse of the drive missing", "start", _Code.DRIVE_OFF, drive_fuse=False),
    _mega("auxiliary contact open", "start", _Code.DRIVE_OFF, no_seal_in=True),
    _mega("start button bridged", "stop_opens", _Code.DRIVE_ON, recloses=True),
    _mega("stop not in the coil circuit", "stop_opens", _Code.DRIVE_ON, ineffective_stop=True),
    _mega("coil before the servos' fuse", "coil_supply", _Code.NOT_CONFIRMED,
          {"Pull the fuse": "n"}),
    _mega("ESC not calibrated", "esc_zero", _Code.NOT_CONFIRMED, {"beep once for zero": "n"}),
    _measured("servo 2 far from upright", "faults", _Code.FAULT, servo_far=2),
    _mega("ESCs 1 and 2 swapped", "turn_module1_wheel", _Code.WHEEL_SWAPPED, esc_order=[1, 0, 2]),
    _mega("two wires of motor 1 swapped", "turn_module1_wheel", _Code.WHEEL_REVERSED,
          esc_signs=[-1, 1, 1]),
    _mega("throttle range too small", "turn_module1_wheel", _Code.WHEEL_SPEED, speed_factor=2.0),
    WiringError(MegaWithSensors, "sensors of wheels 1 and 2 swapped", "sensor_module1_wheel",
                _Code.WHEEL_SENSOR, harm=_of("board", sensor_wheels=[1, 0, 2])),
    WiringError(MegaWithSensors, "wire of sensor 3 off", "sensor_module3_wheel",
                _Code.WHEEL_SENSOR, harm=_of("board", sensor_wheels=[0, 1, None])),
    WiringError(MegaWithSensors, "sensors swapped after their check", "turn_module1_wheel",
                _Code.WHEEL_SENSOR, harm=_of("board", sensor_wheels=[1, 0, 2])),
    WiringError(MegaWithSensors, "ESCs 1 and 2 swapped, with sensors", "turn_module1_wheel",
                _Code.WHEEL_SWAPPED, harm=_of("board", esc_order=[1, 0, 2])),
    WiringError(Rp2040WithTelemetry, "telemetry wires 1 and 2 swapped", "turn_module1_wheel",
                _Code.WHEEL_SENSOR, harm=_of("board", sensor_wheels=[1, 0, 2])),
    WiringError(BusWheels, "plus and minus touch", "short_circuit", _Code.MEASURED,
                {"from + to -": "0.4"}),
    WiringError(BusWheels, "battery reversed", "polarity", _Code.MEASURED,
                {"at the fuse holder": "-11.1"}),
    WiringError(BusWheels, "stop in one branch only", "stop", _Code.NOT_CONFIRMED,
                {"Press the stop: did": "n"}),
    WiringError(BusWheels, "servo 2 without data", "connection", _Code.NO_CONNECTION,
                harm=lambda it: setattr(it.servos[1], "dead", True)),
    WiringError(BusWheels, "two servos with id 1", "connection", _Code.NO_CONNECTION,
                harm=_id_1_twice),
    WiringError(BusWheels, "servo 2 of another model", "connection", _Code.NO_CONNECTION,
                harm=lambda it: it.servos[1].put(0, 2, 311)),
    WiringError(BusWheels, "voltage lost before the servos", "battery", _Code.BATTERY_DIFFERS,
                {"Voltage of the battery": "12.4"}),
    WiringError(BusWheels, "branch with a bad contact", "servos", _Code.SERVO_SUPPLY,
                harm=lambda it: setattr(it.servos[2], "volts", 10.0)),
    WiringError(BusWheels, "ids 1 and 2 swapped", "turn_wheel1", _Code.WHEEL_SWAPPED,
                harm=lambda it: setattr(it.person, "wheels", _swapped(it.servos))),
    WiringError(BusWheels, "servo 2 mounted reversed", "turn_wheel2", _Code.WHEEL_REVERSED,
                harm=_of("person", wheel_signs=(1, -1, 1))),
    WiringError(U2D2Machine, "one terminator", "termination", _Code.MEASURED, {"CAN high": "120"}),
    WiringError(U2D2Machine, "no auxiliary contact", "stop", _Code.NOT_CONFIRMED,
                {"press and release the stop: did": "n"}),
    WiringError(U2D2Machine, "servo 4 without data", "connection", _Code.NO_CONNECTION,
                harm=lambda it: setattr(it.chain.servos[3], "dead", True)),
    WiringError(U2D2Machine, "servo 2 of another model", "connection", _Code.NO_CONNECTION,
                harm=lambda it: it.set_model(2, 1060)),
    WiringError(U2D2Machine, "two servos with id 1", "connection", _Code.NO_CONNECTION,
                harm=lambda it: it.set_ids((1, 1, 3, 4, 5, 6))),
    WiringError(U2D2Machine, "controller 2 without CAN", "connection", _Code.NO_CONNECTION,
                harm=lambda it: it.set_motors(2, mute=True, deaf=True)),
    WiringError(U2D2Machine, "two controllers with id 1", "connection", _Code.NO_CONNECTION,
                harm=lambda it: it.set_motors(2, id=1)),
    WiringError(U2D2Machine, "CAN high and low swapped", "connection", _Code.NO_CONNECTION,
                harm=lambda it: it.set_motors(1, 2, 3, mute=True, deaf=True)),
    WiringError(U2D2Machine, "timeout of controller 1 off", "connection", _Code.NO_CONNECTION,
                harm=lambda it: it.set_motors(1, timeout_s=0.0)),
    WiringError(U2D2Machine, "status of controller 3 off", "connection", _Code.NO_CONNECTION,
                harm=lambda it: it.set_motors(3, status=0)),
    WiringError(U2D2Machine, "branch of servo 5 with a bad contact", "servos", _Code.SERVO_SUPPLY,
                harm=lambda it: setattr(it.chain.servos[4], "volts", 10.5)),
    WiringError(U2D2Machine, "fuse holder of controller 2 bad", "controllers",
                _Code.CONTROLLER_SUPPLY, harm=lambda it: it.set_motors(2, volts=22.0)),
    WiringError(U2D2Machine, "ids 1 and 2 swapped", "tilt_module1_alpha", _Code.JOINT_SWAPPED,
                harm=lambda it: it.set_ids((2, 1, 3, 4, 5, 6))),
    WiringError(U2D2Machine, "servo 1 mounted reversed", "tilt_module1_alpha", _Code.JOINT_REVERSED,
                harm=_of("person", push_sign=-1)),
    WiringError(U2D2Machine, "controllers 1 and 2 swapped", "turn_module1_wheel",
                _Code.WHEEL_SWAPPED,
                harm=lambda it: setattr(it.person, "wheels", _swapped(it.motors))),
    WiringError(U2D2Machine, "two wires of motor 1 swapped", "turn_module1_wheel",
                _Code.WHEEL_REVERSED, harm=_of("person", wheel_signs=(-1, 1, 1))),
    WiringError(U2D2Machine, "pole pairs of motor 1", "turn_module1_wheel", _Code.WHEEL_SPEED,
                harm=lambda it: it.set_motors(1, pole_pairs=14)),
    WiringError(CanWheelsMachine, "plus and minus touch", "short_circuit", _Code.MEASURED,
                {"from + to -": "0.4"}),
    WiringError(CanWheelsMachine, "diode of the coil reversed", "coil_diode", _Code.MEASURED,
                {"minus end": "9"}),
    WiringError(CanWheelsMachine, "no precharge resistor", "precharge", _Code.MEASURED,
                {"precharge button": "1e6"}),
    WiringError(CanWheelsMachine, "three terminators", "termination", _Code.MEASURED,
                {"CAN high": "40"}),
    WiringError(CanWheelsMachine, "no auxiliary contact", "stop", _Code.NOT_CONFIRMED,
                {"press and release the stop: did": "n"}),
    WiringError(CanWheelsMachine, "controller 2 without CAN", "connection", _Code.NO_CONNECTION,
                harm=lambda it: it.set_motors(2, mute=True, deaf=True)),
    WiringError(CanWheelsMachine, "two controllers with id 1", "connection", _Code.NO_CONNECTION,
                harm=lambda it: it.set_motors(2, id=1)),
    WiringError(CanWheelsMachine, "CAN high and low swapped", "connection", _Code.NO_CONNECTION,
                harm=lambda it: it.set_motors(1, 2, 3, mute=True, deaf=True)),
    WiringError(CanWheelsMachine, "voltage lost before the controllers", "battery",
                _Code.BATTERY_DIFFERS, {"Voltage of the battery": "25.1"}),
    WiringError(CanWheelsMachine, "fuse holder of controller 2 bad", "controllers",
                _Code.CONTROLLER_SUPPLY, harm=lambda it: it.set_motors(2, volts=22.0)),
    WiringError(CanWheelsMachine, "magnet of encoder 1 missing", "turn_wheel1", _Code.FAULT,
                harm=lambda it: it.set_motors(1, fault=35)),
    WiringError(CanWheelsMachine, "controllers 1 and 2 swapped", "turn_wheel1",
                _Code.WHEEL_SWAPPED,
                harm=lambda it: setattr(it.person, "wheels", _swapped(it.motors))),
    WiringError(CanWheelsMachine, "motor 2 mounted reversed", "turn_wheel2", _Code.WHEEL_REVERSED,
                harm=_of("person", wheel_signs=(1, -1, 1))),
)  # fmt: skip


def rows() -> list[str]:
    """Return the rows of the table, without its head."""
    return [f"| {it.machine.plan} | {it.what} | `{it.step}` | `{it.code}` |" for it in ERRORS]


if __name__ == "__main__":
    sys.stdout.write("\n".join(rows()) + "\n")
