"""Studies by robot kind, for the Student tab, with figures of the papers as data series."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsd_twin.dashboard.sessions import student_equations as equations
from tsd_twin.dashboard.sessions.student_equations import ATLAS_PAPER, OMNI_PAPER, THESIS, short
from tsd_twin.dashboard.wire.student import Equation, PaperCurve, PaperFigure, StudentWheel
from tsd_twin.errors import RobotFileError
from tsd_twin.kinematics import TwistSolution
from tsd_twin.kinematics.row_effect import row_effect
from tsd_twin.lie import Array
from tsd_twin.robots import (
    RPM,
    OmniDescription,
    RobotDescription,
    SingularityDescription,
    SphereDescription,
)

_STEPS = 61
_PERIOD = 20
"""Every so many points of the sphere's motion are sent."""
_SPEED_MPS = 1.0


def gimbal_figures(robot: SingularityDescription) -> list[PaperFigure]:
    """Return speed against tilt, and the motor speeds of Tables 1 and 2."""
    drive = robot.kinematics()
    tilts: Array = np.linspace(0.0, drive.max_tilt_rad, _STEPS)
    rim_mps = drive.wheel_radius_m * drive.spin_rad_per_s
    label = f"{drive.spin_rad_per_s / RPM:.0f} rpm"
    signal, rpm = np.array(robot.motor.signal), np.array(robot.motor.speed_rpm)
    turning = (rpm > 0.0).all(axis=0)
    motors: list[PaperCurve] = []
    for i, measured in enumerate(rpm):
        motors.append(_curve(f"motor {i + 1}", signal, measured, points=True))
        for name, used in (("all rows", turning | True), ("working range", turning)):
            line = _line(signal[used], measured[used], signal)
            motors.append(_curve(f"motor {i + 1}, {name}", signal, line))
    return [
        PaperFigure(
            "speed_by_tilt",
            THESIS,
            "",
            "tilt",
            "°",
            "speed",
            "m/s",
            [_curve(label, np.degrees(tilts), rim_mps * np.sin(tilts))],
        ),
        PaperFigure(
            "motor_speeds", THESIS, "Tables 1, 2", "signal", "", "wheel speed", "rpm", motors
        ),
    ]


def roller_figures(robot: OmniDescription) -> list[PaperFigure]:
    """Return the wheel speeds for driving at 1 m/s in every direction."""
    drive = robot.kinematics()
    angles: Array = np.linspace(-np.pi, np.pi, 2 * _STEPS - 1)
    twists = _SPEED_MPS * np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=-1)
    speeds = twists @ drive.speeds_from_twist.T / RPM
    curves = [
        _curve(name, np.degrees(angles), speed)
        for name, speed in zip(drive.actuators, speeds.T, strict=True)
    ]
    return [
        PaperFigure(
            "wheel_speeds_by_direction",
            OMNI_PAPER,
            "Eq. 4",
            "direction",
            "°",
            "wheel speed at 1 m/s",
            "rpm",
            curves,
        )
    ]


def sphere_figures(robot: SphereDescription) -> list[PaperFigure]:
    """Return the error of the ideal kinematics for the inputs of Table 1."""
    effect = row_effect(robot.kinematics())
    t_s = effect.t_s[::_PERIOD]
    angle = _curve("angle", t_s, np.degrees(effect.angle_rad[::_PERIOD]))
    share = _curve("magnitude", t_s, 100.0 * effect.share[::_PERIOD])
    return [
        PaperFigure("row_angle", ATLAS_PAPER, "Fig. 7", "time", "s", "angle", "°", [angle]),
        PaperFigure("row_magnitude", ATLAS_PAPER, "Fig. 7", "time", "s", "magnitude", "%", [share]),
    ]


def _line(x: Array, y: Array, at: Array) -> Array:
    """Return the least-squares line through points (n,), at other places (m,)."""
    dx = x - x.mean()
    return y.mean() + (dx @ y) / (dx @ dx) * (at - x.mean())


def _curve(label: str, x: Array, y: Array, *, points: bool = False) -> PaperCurve:
    return PaperCurve(label, [short(one) for one in x], [short(one) for one in y], points)


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
    equations.gimbal_wheels,
    equations.gimbal_equations,
    gimbal_figures,
)
ROLLER_STUDY = DriveStudy(
    (RPM,), equations.roller_wheels, equations.roller_equations, roller_figures
)
SPHERE_STUDY = DriveStudy(
    (RPM,), equations.sphere_wheels, equations.sphere_equations, sphere_figures
)
