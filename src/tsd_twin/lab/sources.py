"""Causes of error on the open-loop square, each with its size and where that is from."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from tsd_twin.lab import motors
from tsd_twin.lab.open_square import Errors
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityRobot

Draw: TypeAlias = Callable[[SingularityRobot, np.random.Generator, int], Errors]


@dataclass(frozen=True, slots=True)
class Source:
    """A cause of error: its name, its size with where that is from, and dice for it."""

    name: str
    size: str
    draw: Draw


def _nothing(robot: SingularityRobot, runs: int) -> Errors:
    return Errors(np.zeros((runs, robot.drive.modules)), np.zeros((runs, 2 * robot.drive.modules)))


def _alike(given: Callable[[SingularityRobot], dict[str, float]]) -> Draw:
    """Return what is the same for all robots of one description."""
    return lambda robot, _random, runs: replace(_nothing(robot, runs), **given(robot))


def _zero(robot: SingularityRobot, random: np.random.Generator, runs: int) -> Errors:
    none, sigma = _nothing(robot, runs), np.radians(robot.errors.zero_deg)
    return replace(none, zero_rad=sigma * random.standard_normal(none.zero_rad.shape))


def _spin(robot: SingularityRobot, random: np.random.Generator, runs: int) -> Errors:
    none = _nothing(robot, runs)
    share = robot.noise.spin_share * random.standard_normal(none.spin_share.shape)
    return replace(none, spin_share=share)


def _line(robot: SingularityRobot, _random: np.random.Generator, runs: int) -> Errors:
    none = _nothing(robot, runs)
    return replace(none, spin_share=none.spin_share + spin_by_line(robot))


def _sag(robot: SingularityRobot, random: np.random.Generator, runs: int) -> Errors:
    none = _nothing(robot, runs)
    share = robot.errors.battery_share * random.standard_normal((runs, 1))
    return replace(none, spin_share=none.spin_share + share)


def _layers(robot: SingularityRobot, random: np.random.Generator, runs: int) -> Errors:
    none = _nothing(robot, runs)
    phase = random.uniform(0.0, 2.0 * np.pi, none.spin_share.shape)
    return replace(none, layer_m=robot.errors.layer_m, phase_rad=phase)


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
    Source(
        "lag of the servos", "[servo]: 32 per s, 63 rpm (MX-64)", _alike(lambda _: {"lag": 1.0})
    ),
    Source(
        "lag, and play",
        "[errors]: 0.33 deg (Robotis e-Manual)",
        _alike(lambda robot: {"lag": 1.0, "backlash_rad": math.radians(robot.errors.backlash_deg)}),
    ),
    Source(
        "dead band",
        "[errors]: 0.044 deg, half a step",
        _alike(lambda robot: {"dead_band_rad": math.radians(robot.errors.dead_band_deg)}),
    ),
    Source(
        "steps of the servos",
        "[servo]: 4,096 a turn (MX-64)",
        _alike(lambda robot: {"step_rad": 2.0 * np.pi / robot.servo.steps_per_turn}),
    ),
    Source(
        "delay of the bus",
        "[errors]: 5 ms (as modelled for the bridge)",
        _alike(lambda robot: {"delay_s": robot.errors.delay_s}),
    ),
    Source("spin of each wheel", "[noise]: 1 %", _spin),
    Source("battery", "[errors]: 3 %, all wheels alike (assumed)", _sag),
    Source("gimbal zero", "[errors]: creeps an inch in 30 s (thesis)", _zero),
    Source("printed layers", "[errors]: 0.2 mm", _layers),
    Source("slip on the floor", "[floor]: friction 0.8 (assumed)", _alike(lambda _: {"slip": 1.0})),
)
