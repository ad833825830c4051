"""Studies by robot kind, for the Student tab: joint values, wheels, equations and figures."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsd_twin.dashboard.sessions import student_equations as equations
from tsd_twin.dashboard.sessions import student_papers as papers
from tsd_twin.dashboard.sessions import student_wheels as wheels
from tsd_twin.dashboard.wire.student import Equation, PaperFigure, StudentWheel
from tsd_twin.errors import RobotFileError
from tsd_twin.kinematics import TwistSolution
from tsd_twin.lie import Array
from tsd_twin.robots import RPM, RobotDescription


@dataclass(frozen=True, slots=True)
class DriveStudy:
    """Functions of a robot kind that the Student tab needs."""

    scales: tuple[float, ...]
    """SI units per number on the page, for each joint of a module or wheel."""
    wheels: Callable[[Any, Array, TwistSolution], list[StudentWheel]]
    """Wheels of a description at joints (n,) and their twist."""
    equations: Callable[[Any, Array, TwistSolution], list[Equation]]
    """Equations of the kinematics at joints (n,) and their twist."""
    papers: Callable[[Any], list[PaperFigure]]
    """Figures of the papers for a description."""

    def joints(self, robot: RobotDescription, numbers: Sequence[Sequence[float]]) -> Array:
        """Return the joint vector (n,) for the numbers of each module or wheel.

        Raises:
            RobotFileError: If their count is not the robot's.
        """
        names, width = robot.kinematics().actuators, len(self.scales)
        if [len(one) for one in numbers] != [width] * len(names):
            counts = ", ".join(str(len(one)) for one in numbers)
            expected = f"{len(names)} times {width}: {names[0]} to {names[-1]}"
            raise RobotFileError(robot.name, f"joints have {counts} numbers", expected)
        return (np.array(numbers) * np.array(self.scales)).ravel()


_DEGREE = math.radians(1.0)
GIMBAL_STUDY = DriveStudy(
    (_DEGREE, _DEGREE, RPM),
    wheels.gimbal_wheels,
    equations.gimbal_equations,
    papers.gimbal_figures,
)
ROLLER_STUDY = DriveStudy(
    (RPM,), wheels.roller_wheels, equations.roller_equations, papers.roller_figures
)
SPHERE_STUDY = DriveStudy(
    (RPM,), wheels.sphere_wheels, equations.sphere_equations, papers.sphere_figures
)
