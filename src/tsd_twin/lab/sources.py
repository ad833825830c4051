"""Causes of error on the open-loop square, each with its size and where that is from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tsd_twin.lab import motors
from tsd_twin.lab.open_square import Errors
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityRobot

CREEP_M, CREEP_S = 0.0254, 30.0
"""Gimbals count as zeroed when the robot creeps less than an inch in 30 s (thesis)."""
LAYER_M = 0.0001
"""A layer of a printed wheel, of its radius (assumed)."""
SAG_SHARE = 0.03
"""Of the battery's voltage, at random, all wheels alike (assumed)."""


@dataclass(frozen=True, slots=True)
class Source:
    """A cause of error: its name, its size with where that is from, and dice for it."""

    name: str
    size: str
    draw: Callable[[SingularityRobot, np.random.Generator, int], Errors]


def _nothing(robot: SingularityRobot, runs: int) -> Errors:
    return Errors(np.zeros((runs, robot.drive.modules)), np.zeros((runs, 2 * robot.drive.modules)))


def _lag(robot: SingularityRobot, _random: np.random.Generator, runs: int) -> Errors:
    none = _nothing(robot, runs)
    return Errors(none.spin_share, none.zero_rad, lag=1.0)


def _steps(robot: SingularityRobot, _random: np.random.Generator, runs: int) -> Errors:
    none = _nothing(robot, runs)
    return Errors(none.spin_share, none.zero_rad, step_rad=2.0 * np.pi / robot.servo.steps_per_turn)


def _zero(robot: SingularityRobot, random: np.random.Generator, runs: int) -> Errors:
    none = _nothing(robot, runs)
    rim_mps = robot.drive.wheel_radius_m * robot.kinematics().spin_rad_per_s
    # The robot creeps with the mean of its modules, so each may be off by the root of their number.
    sigma = CREEP_M / CREEP_S / rim_mps * np.sqrt(robot.drive.modules)
    return Errors(none.spin_share, sigma * random.standard_normal(none.zero_rad.shape))


def _spin(robot: SingularityRobot, random: np.random.Generator, runs: int) -> Errors:
    none = _nothing(robot, runs)
    share = robot.noise.spin_share * random.standard_normal(none.spin_share.shape)
    return Errors(share, none.zero_rad)


def _line(robot: SingularityRobot, _random: np.random.Generator, runs: int) -> Errors:
    none = _nothing(robot, runs)
    return Errors(none.spin_share + spin_by_line(robot), none.zero_rad)


def _sag(robot: SingularityRobot, random: np.random.Generator, runs: int) -> Errors:
    none = _nothing(robot, runs)
    return Errors(none.spin_share + SAG_SHARE * random.standard_normal((runs, 1)), none.zero_rad)


def _layers(robot: SingularityRobot, random: np.random.Generator, runs: int) -> Errors:
    none = _nothing(robot, runs)
    share = LAYER_M / robot.drive.wheel_radius_m * random.standard_normal(none.spin_share.shape)
    return Errors(share, none.zero_rad)


def spin_by_line(robot: SingularityRobot) -> Array:
    """Return how much faster (k,), as a share, motors turn than the line of Table 2 lets expect.

    The signal comes from the line through all rows, as in the thesis, the speed from the table.
    """
    signal: Array = np.array(robot.motor.signal)
    rpm: Array = np.array(robot.motor.speed_rpm)
    line = motors.fit(signal, rpm, np.ones(len(signal), dtype=bool))
    wanted = robot.drive.cruise_speed_rpm
    given: Array = (wanted - line.offset) / line.slope
    turns = np.empty(len(rpm))
    for i, row in enumerate(rpm):
        turns[i] = np.interp(given[i], signal, row)
    return turns / wanted - 1.0


LINE = Source("line of Table 2", "spin of each motor by the line, not the table", _line)
"""An error of calibration that need not be: the simulator, and a robot that uses it, has none."""
SOURCES = (
    Source("lag of the servos", "MX-64 in the description: 32 per s, 63 rpm", _lag),
    Source("spin of each wheel", "1 % in the description", _spin),
    Source("battery sag", "3 %, all wheels alike (assumed)", _sag),
    Source("steps of the servos", "4,096 a turn, MX-64", _steps),
    Source("gimbal zero", "creeps an inch in 30 s (thesis)", _zero),
    Source("printed layers", "0.1 mm of the wheel radius (assumed)", _layers),
)
