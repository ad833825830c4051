"""Consistency of the estimates on plants that share no code with the simulation.

A row is a robot, a manoeuvre, sensors and undeclared machine properties. Its cells are the mean
normalized squared error (three if the covariance is right) and the fraction of the robots within
the region that should contain 95 % of them.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np

from research.open_loop import (
    CONSTANT,
    GYRO,
    JOINTS,
    MOUNTED,
    PERIOD_S,
    Case,
    Drive,
    collected,
    drive,
    squared_errors,
)
from tests.independent.built import Undeclared
from tests.independent.rollers import RollerPlant, SpherePlant, turned
from tests.independent.singularity import SingularityPlant
from tsd_twin import robots
from tsd_twin.control.state_estimator import StateEstimator
from tsd_twin.lie import SE2
from tsd_twin.motion.twist_limiter import TwistLimiter
from tsd_twin.robots import OmniDescription, SingularityDescription, SphereDescription

__all__ = ["CONSTANT", "GYRO", "JOINTS", "MOUNTED", "Cell", "Row", "plant_of", "run_row"]

PLANTS: dict[type, Callable[..., Any]] = {
    SingularityDescription: SingularityPlant,
    OmniDescription: RollerPlant,
    SphereDescription: SpherePlant,
}
WITHIN_95 = 7.815
"""95 % quantile of the normalized squared error of three numbers."""


def plant_of(robot: Any, count: int, seed: int, undeclared: Undeclared | None = None) -> Any:
    """Robots built from a description, with individual errors."""
    return PLANTS[type(robot)](robot, count, seed, undeclared=undeclared)


AS_DECLARED = Undeclared()


@dataclass(frozen=True, slots=True)
class Row:
    """One row of the table."""

    robot: str
    manoeuvre: str
    odometry: str = JOINTS
    camera: str = ""
    errors: float = 1.0
    undeclared: Undeclared = AS_DECLARED
    declared: dict[str, Any] = field(default_factory=dict, hash=False)
    """Tables of the description to replace, by name."""
    robots: int = 40
    first: int = 9000
    """Seed of the first robot: 9000 and up are not tuned on."""
    times_s: tuple[float, ...] = (2.0, 5.0, 20.0)


@dataclass(frozen=True, slots=True)
class Cell:
    """Result at one time."""

    nees: float
    share: float
    heading_share: float


class _Planar:
    """Adapts a plant to the simulation interface of the research programs."""

    def __init__(self, plant: Any) -> None:
        self._plant = plant
        self.joints = np.zeros((plant.robots, 1))
        self.advance, self.command, self.measure = plant.advance, plant.command, plant.measure

    @property
    def pose(self) -> SE2:
        return SE2(self._plant.pose.copy())


@dataclass(frozen=True, slots=True)
class _Case(Case):
    changes: tuple[tuple[str, Any], ...] = ()

    @property
    def described(self) -> Any:
        robot = Case.described.fget(self)
        return msgspec.structs.replace(robot, **dict(self.changes))


def run_row(row: Row) -> list[Cell]:
    """Drive all robots of a row."""
    return run_rows([row])[0]


def run_rows(rows: Sequence[Row]) -> list[list[Cell]]:
    """Drive the robots of rows that differ only in camera and use of the gyro."""
    if isinstance(robots.load_robot(rows[0].robot), SphereDescription):
        return [_sphere(row) for row in rows]
    cases = [
        _Case(
            row.robot, row.manoeuvre, row.errors, row.odometry, row.camera, "independent",
            row.robots, row.first, row.times_s, changes=tuple(row.declared.items()),
        )
        for row in rows
    ]  # fmt: skip
    made = Drive(tuple(cases), rows[0].first, (rows[0].robots,))
    results = drive(made, functools.partial(_made, rows[0].undeclared))
    found = collected(cases, [made], [results])
    return [
        [
            Cell(float(nees.mean()), float((nees < WITHIN_95).mean()), float(within.mean()))
            for nees, within in zip(result.nees, result.within, strict=True)
        ]
        for result in found
    ]


def _made(undeclared: Undeclared, driven: Drive, robot: Any) -> Any:
    return _Planar(plant_of(robot, driven.batch[0], driven.first, undeclared))


# The sphere.

SPHERE_TWISTS: dict[str, Callable[[float], tuple[float, float, float]]] = {
    "spin": lambda _t: (0.0, 0.0, 1.5),
    "roll": lambda _t: (1.2, 0.6, 0.0),
    "wander": lambda t: (np.cos(0.5 * t), np.sin(0.9 * t), np.cos(0.3 * t + 1.0)),
    "reversals": lambda t: (1.5 if t % 1.0 < 0.5 else -1.5, 0.5, 0.0),
}


def _sphere(row: Row) -> list[Cell]:
    robot: Any = robots.load_robot(row.robot)
    kinematics = robot.kinematics()
    plant = plant_of(robot, row.robots, row.first, row.undeclared)
    estimators = [StateEstimator(robot) for _ in range(row.robots)]
    twist = SPHERE_TWISTS[row.manoeuvre]
    ends = {round(t_s / PERIOD_S) for t_s in row.times_s}
    limiter, driven = TwistLimiter(kinematics, robot.limits), np.zeros(3)
    setpoint, cells = np.zeros(plant.count), []
    for i in range(max(ends) + 1):
        if i > 0:
            plant.advance(PERIOD_S)
        for estimator, measured in zip(estimators, plant.measure(), strict=True):
            estimator.advance((i + 1) * PERIOD_S, measured, setpoint, PERIOD_S)
        if i in ends:
            estimates = np.array([each.pose.as_matrix() for each in estimators])
            errors = turned(plant.turn @ estimates.transpose(0, 2, 1))
            stated = np.array([each.odometry(0).pose_covariance for each in estimators])
            nees = squared_errors(errors, stated + 1e-10 * np.eye(3))
            half = np.sqrt(stated[:, 2, 2])
            within = np.abs(errors[:, 2]) < 1.49 * half
            cells.append(Cell(float(nees.mean()), float((nees < WITHIN_95).mean()), within.mean()))
        driven = limiter.approach(driven, limiter.cap(np.array(twist(i * PERIOD_S))), PERIOD_S)
        setpoint = kinematics.inverse(driven)
        plant.command(setpoint)
    return cells
