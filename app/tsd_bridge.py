"""`tsd-bridge`: robot node of a real robot, driven through its controller board or its servos."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from tsd_twin.cli import flags, node_program, program
from tsd_twin.hardware.robot_io import RobotIO
from tsd_twin.robots import (
    OmniDescription,
    RobotDescription,
    SingularityDescription,
    description_of_kind,
)
from tsd_twin.simulation import Motors

with program.requires("tsd-bridge", "bridge"):
    from tsd_twin.hardware.arduino_mega import BAUD, ArduinoMegaIO
    from tsd_twin.hardware.commissioning.check import check
    from tsd_twin.hardware.commissioning.leaving import leave_on_signals
    from tsd_twin.hardware.commissioning.walk import Commissioned
    from tsd_twin.hardware.dynamixel_wheels import DynamixelWheelsIO
    from tsd_twin.hardware.joints import ServoCalibration
    from tsd_twin.hardware.receiver_setup import set_up_receiver
    from tsd_twin.hardware.serial_ports import serial_ports
    from tsd_twin.hardware.serial_transport import HardwareError
    from tsd_twin.hardware.u2d2 import U2D2IO

if TYPE_CHECKING:
    from tsd_twin.hardware.can_wheels import CanWheelsIO


PARSER = program.parser(
    "tsd-bridge",
    "A machine on the bus, driven through its controller board or its servos.",
    [
        "tsd-bridge --list                          what serial ports there are",
        "tsd-bridge --port /dev/ttyACM0             the triple singularity drive",
        "tsd-bridge --port /dev/serial/by-id/usb-Arduino_...-if00 --calibration mine.toml",
        "tsd-bridge --port /dev/ttyACM0 --servos /dev/ttyUSB0",
        "tsd-bridge --servos /dev/ttyUSB0 --can socketcan:can0 --calibration mine.toml",
        "tsd-bridge --robot my_kiwi.toml --servos /dev/ttyUSB0     wheels are Dynamixel X servos",
        "tsd-bridge --port /dev/ttyACM0 --calibration mine.toml --setup   learn the radio control",
        "tsd-bridge --port /dev/ttyACM0 --calibration mine.toml --check sheet.json",
        "tsd-bridge --port socket://192.168.1.7:4004   a board behind ser2net or socat",
        "tsd-bridge --port /dev/ttyACM0 --join https://lab.example:7448 --code 7K3M-9Q2X-HT4W-0B8N",
        "                                           joins a router with a code of tsd-certs",
    ],
)


def joints(robot: RobotDescription, args: argparse.Namespace) -> RobotIO:
    """Return the connected hardware interface."""
    if args.check:
        if args.setup:
            raise HardwareError("--check and --setup are two programs: use one at a time")
        leave_on_signals()
        receiver = _calibration(args).receiver is not None
        passed = check(
            robot, _kind(robot, args), Path(args.check), lambda: _connected(robot, args),
            receiver=receiver,
        )  # fmt: skip
        sys.exit(0 if passed else 1)
    return _connected(robot, args)


def _kind(robot: RobotDescription, args: argparse.Namespace) -> str:
    """Return the kind of machine, for the steps of `--check`."""
    if isinstance(robot, OmniDescription):
        return "can" if args.can else "dynamixel_wheels"
    if args.can:
        return "u2d2+can"
    return "u2d2" if args.servos else "mega"


def _connected(robot: RobotDescription, args: argparse.Namespace) -> Commissioned:
    if isinstance(robot, OmniDescription):
        return _omni(robot, args)
    calibration = _calibration(args)
    if args.can:
        return _with_can(description_of_kind(robot, SingularityDescription), args, calibration)
    if not args.port:
        raise HardwareError("--port is missing: 'tsd-bridge --list' shows what ports there are")
    if args.setup:
        if not args.calibration:
            raise HardwareError("--setup needs --calibration FILE, which it writes to")
        set_up_receiver(args.port, args.baud, Path(args.calibration))
        sys.exit(0)
    machine = description_of_kind(robot, SingularityDescription)
    motors = Motors.of(machine)
    board = ArduinoMegaIO(
        machine, args.port, motors, calibration, servos=not args.servos, baud=args.baud
    )
    if args.servos:
        return U2D2IO(machine, board, args.servos, motors, calibration)
    return board


def _calibration(args: argparse.Namespace) -> ServoCalibration:
    if args.setup or not args.calibration:  # The set-up writes the file.
        return ServoCalibration()
    return ServoCalibration.read(args.calibration)


def _omni(robot: OmniDescription, args: argparse.Namespace) -> Commissioned:
    """Return the interface of a robot whose wheels are servos, or have motor controllers on CAN."""
    if args.port or bool(args.servos) == bool(args.can):
        raise HardwareError(
            f"{robot.name} has no controller board: instead of --port, use --servos PORT for "
            "wheels that are Dynamixel X servos on a U2D2 or an OpenRB-150, or --can for motor "
            "controllers"
        )
    calibration = _calibration(args)
    if args.can:
        return _can_wheels(robot, args, calibration)
    return DynamixelWheelsIO(robot, args.servos, calibration)


def _with_can(
    robot: SingularityDescription, args: argparse.Namespace, calibration: ServoCalibration
) -> Commissioned:
    """Return the interface of a robot with gimbals on a U2D2 and wheels on CAN."""
    if args.port or not args.servos:
        raise HardwareError(
            "--can has the wheels: use --servos PORT for the gimbals, and no --port"
        )
    wheels = _can_wheels(robot, args, calibration)
    return U2D2IO(robot, wheels, args.servos, Motors.of(robot), calibration)


def _can_wheels(
    robot: RobotDescription, args: argparse.Namespace, calibration: ServoCalibration
) -> CanWheelsIO:
    with program.requires("tsd-bridge --can", "can"):
        from tsd_twin.hardware.can_wheels import CanWheelsIO
    if calibration.motor_controllers is None:
        raise HardwareError(
            "--can needs --calibration FILE with [motor_controllers]: kind and ids of the wheels"
        )
    return CanWheelsIO(robot, args.can, calibration.motor_controllers)


class _List(argparse.Action):
    """Prints the ports and exits, like `--version`."""

    def __call__(self, *_: object) -> None:
        print("\n".join(serial_ports()) or "no serial ports: is the board plugged in?")
        sys.exit(0)


def main() -> None:
    """Parse the flags and run."""
    PARSER.add_argument("--list", action=_List, nargs=0, help="show the serial ports and end")
    text = "device, or a URL of pyserial, of the controller board"
    flags.add(PARSER, "--port", text, metavar="PORT")
    text = (
        "of a U2D2 with the servos, when they are not connected to the board; of a U2D2 or "
        "OpenRB-150 with the wheels of an omni robot"
    )
    flags.add(PARSER, "--servos", text, metavar="PORT")
    text = (
        "interface:channel of the wheels' motor controllers, VESC or moteus, such as socketcan:can0"
    )
    flags.add(PARSER, "--can", text, metavar="BUS")
    text = "of the board, as it was flashed"
    flags.add(PARSER, "--baud", text, flags.whole(1200, 4_000_000), BAUD)
    text = "TOML: neutral steps, turned servos, radio control, pulses"
    flags.add(PARSER, "--calibration", text, metavar="FILE")
    text = (
        "learn the radio control, ask for the pulses of the speed controllers, write both "
        "into the file and end"
    )
    PARSER.add_argument("--setup", action="store_true", help=text)
    text = (
        "walk through commissioning, save each result in the sheet FILE, print it and end; the "
        "same FILE continues"
    )
    flags.add(PARSER, "--check", text, metavar="FILE")
    node_program.serve(PARSER, joints)


if __name__ == "__main__":
    main()
