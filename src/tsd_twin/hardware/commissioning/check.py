"""`tsd-bridge --check`: commissioning of a machine from a terminal."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tsd_twin.hardware.commissioning.sheet import read_sheet
from tsd_twin.hardware.commissioning.steps import steps_for
from tsd_twin.hardware.commissioning.walk import (
    Ask,
    Commissioned,
    Machine,
    Say,
    Walk,
)
from tsd_twin.hardware.receiver_setup import ask_line
from tsd_twin.robots import OmniDescription, RobotDescription, SingularityDescription

SLOW_RAD_PER_S = 1.0
"""Speed of wheels that do not always spin."""


def check(
    robot: RobotDescription,
    kind: str,
    file: Path,
    connect: Callable[[], Commissioned],
    *,
    receiver: bool = False,
    ask: Ask = ask_line,
    say: Say = print,
) -> bool:
    """Walk through the steps, print the sheet, and return whether all passed.

    Args:
        robot: Description of the robot.
        kind: Kind of machine, see `steps_for`.
        file: Sheet, continued if it exists.
        connect: Opens the hardware interface.
        receiver: Whether the calibration has a receiver.
        ask: Shows a question and returns the answer.
        say: Prints a line.

    Raises:
        HardwareError: If the sheet cannot be used, or the input has ended.
    """
    joints = robot.kinematics().joints
    sheet = read_sheet(file, robot.name, kind)
    wheels = kind == "dynamixel_wheels" or kind.endswith("can")
    sensor = robot.wheel_sensor if isinstance(robot, SingularityDescription) else None
    machine = Machine(joints, _slow(robot), wheels or sensor is not None, connect)
    hall = sensor is not None and sensor.kind == "hall"
    steps = steps_for(kind, joints, receiver=receiver, hall_sensors=hall)
    finding = Walk(machine, sheet, file, ask, say).run(steps)
    say(sheet.page())
    if finding is not None:
        say(f"{finding.code}: {finding.sentence()}")
        say(f"Stop here and mend it; the same command continues with {file}.")
    return finding is None


def _slow(robot: RobotDescription) -> float:
    if isinstance(robot, SingularityDescription):
        return robot.wheel_speed_range.least_rad_per_s
    if isinstance(robot, OmniDescription):
        return min(SLOW_RAD_PER_S, robot.kinematics().max_speed_rad_per_s)
    return SLOW_RAD_PER_S
