"""With the reported voltage, errors on the independent plant shrink and stay consistent."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import msgspec
import numpy as np

from tests.independent.built import Undeclared
from tests.independent.drive import PERIOD_S, plant_of
from tsd_twin import robots
from tsd_twin.control.state_estimator import StateEstimator
from tsd_twin.lie import SE2
from tsd_twin.motion import TwistLimiter

SPIN_UP = 300
MANOEUVRES: dict[str, Callable[[float], tuple[float, float, float]]] = {
    "straight 0.5 m/s": lambda _t: (0.5, 0.2, 0.0),
    "circle": lambda _t: (0.5, 0.0, 0.6),
    "wander": lambda t: (
        0.6 * math.cos(0.3 * t), 0.6 * math.sin(0.8 * t + 1.0), math.cos(0.7 * t + 2.0)
    ),
}  # fmt: skip
"""Seeds of the table in docs/estimation.md, which uses 24 robots."""


def errors_of(
    manoeuvre: str, count: int, first: int, *, reports: bool, ends: tuple[int, ...]
) -> Iterator[tuple[float, float]]:
    """Yield the mean NEES and the RMS position error after each number of periods.

    The motor table is exact, because no voltage explains its error.
    """
    described: Any = robots.load_robot("tsd")
    errors = msgspec.structs.replace(described.errors, motor_share=0.0)
    robot: Any = msgspec.structs.replace(described, errors=errors)
    kinematics, limiter = robot.kinematics(), TwistLimiter(robot.kinematics(), robot.limits)
    plant = plant_of(robot, count, first, Undeclared())
    stall = np.reshape(plant.stall, (count, -1))[:, 0]
    volts = robot.battery.nominal_v * stall / robot.servo.stall_torque_nm
    estimators = [StateEstimator(robot) for _ in range(count)]
    driven = np.zeros(3)
    setpoint = kinematics.inverse(driven)
    for i in range(SPIN_UP + max(ends) + 1):
        if i > 0:
            plant.advance(PERIOD_S)
        for k, measured in enumerate(plant.measure()):
            reported = round(float(volts[k]), 1) if reports else None
            estimators[k].advance((i + 1) * PERIOD_S, measured, setpoint, PERIOD_S, reported)
            if i == SPIN_UP - 1:
                estimators[k].set_pose(SE2(plant.pose[k].copy()))
        if i - SPIN_UP in ends:
            yield _compared(plant.pose, estimators)
        t_s = max(0, i - SPIN_UP) * PERIOD_S
        wanted = np.array(MANOEUVRES[manoeuvre](t_s)) if i >= SPIN_UP else np.zeros(3)
        driven = limiter.approach(driven, limiter.cap(wanted), PERIOD_S)
        setpoint = kinematics.inverse(driven)
        plant.command(setpoint)


def _compared(poses: np.ndarray, estimators: list[StateEstimator]) -> tuple[float, float]:
    nees, off_m = [], []
    for pose, estimator in zip(poses, estimators, strict=True):
        truth, estimate = SE2(pose.copy()), estimator.odometry(0)
        off = (truth.inverse() @ SE2(estimate.xy_heading)).xy_heading
        off[:2] = truth.rotate(off[:2])
        nees.append(float(off @ np.linalg.solve(estimate.pose_covariance, off)))
        off_m.append(float(np.hypot(*off[:2])))
    return float(np.mean(nees)), float(np.sqrt(np.mean(np.square(off_m))))


def test_reported_voltage_is_nearer_and_covered() -> None:
    (blind,), (known,) = (
        list(errors_of("wander", 12, 9700, reports=each, ends=(400,))) for each in (False, True)
    )
    assert 1.5 < known[0] < 6.0
    assert known[1] < 0.9 * blind[1]
