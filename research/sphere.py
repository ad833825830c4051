"""Consistency of the estimated orientation of simulated spheres that turn in place."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.special import gammaincinv  # pyright: ignore

from research.open_loop import Case, Consistency, squared_errors
from tsd_twin.client.virtual import PERIOD_S
from tsd_twin.control.state_estimator import StateEstimator
from tsd_twin.estimation import REGION_SHARE, heading_region_rad
from tsd_twin.lie import SO3
from tsd_twin.motion import TwistLimiter
from tsd_twin.simulation import simulate

SPHERE_MANOEUVRES: dict[str, Callable[[float], Sequence[float]]] = {
    "spin": lambda _t: (0.0, 0.0, 1.5),
    "roll": lambda _t: (1.2, 0.6, 0.0),
    "wander": lambda t: (math.cos(0.5 * t), math.sin(0.9 * t), math.cos(0.3 * t + 1.0)),
    "reversals": lambda t: (1.5 if t % 1.0 < 0.5 else -1.5, 0.5, 0.0),
}
"""Angular velocities (3,) over time, rad/s."""
_LEAST_RAD = 1e-5
"""Standard deviation added to each component, for singular covariances."""
_WITHIN = 2.0 * float(gammaincinv(1.5, REGION_SHARE))
"""Squared error that `REGION_SHARE` of right estimates of three numbers do not exceed."""


def compare_sphere(case: Case) -> Consistency:
    """Turn the spheres of a case, and compare their estimates with the true orientations.

    A sphere has no drawn region of its position; `inside` is whether the squared error is within
    the bound of `REGION_SHARE` of right estimates.
    """
    robot = case.described
    kinematics: Any = robot.kinematics()
    simulation = simulate(
        robot, (case.seeds,), seed=case.first, noise=1.0, errors=1.0, plant=case.plant
    )
    estimators = [StateEstimator(robot) for _ in range(case.seeds)]
    twist_at, limiter = SPHERE_MANOEUVRES[case.manoeuvre], TwistLimiter(kinematics, robot.limits)
    ends = {round(t_s / PERIOD_S) for t_s in case.times_s}
    driven, setpoint = np.zeros(3), np.zeros(len(kinematics.joints))
    rows: list[tuple[Any, ...]] = []
    for i in range(max(ends) + 1):
        if i > 0:
            simulation.advance(PERIOD_S)
        for estimator, measured in zip(estimators, simulation.measure(), strict=True):
            estimator.advance((i + 1) * PERIOD_S, measured, setpoint, PERIOD_S)
        if i in ends:
            rows.append(_compared(estimators, simulation.pose))
        driven = limiter.approach(driven, limiter.cap(np.array(twist_at(i * PERIOD_S))), PERIOD_S)
        setpoint = kinematics.inverse(driven)
        simulation.command(np.tile(setpoint, (case.seeds, 1)))
    return Consistency(case, *(np.array(each) for each in zip(*rows, strict=True)))


def _compared(estimators: Sequence[StateEstimator], truths: SO3) -> tuple[Any, ...]:
    estimates = SO3(np.array([each.pose.wxyz for each in estimators]))
    errors = (truths @ estimates.inverse()).log()
    stated = np.array([each.odometry(0).pose_covariance for each in estimators])
    nees = squared_errors(errors, stated + _LEAST_RAD**2 * np.eye(3))
    halves = np.array([heading_region_rad(covariance) for covariance in stated])
    return nees, (nees <= _WITHIN).astype(float), (np.abs(errors[:, 2]) <= halves).astype(float)
