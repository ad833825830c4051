"""How fast all wheels really spin, and what the floor is like: a turn on the spot under a gyro."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tsd_twin.estimation import Slip
from tsd_twin.lab.rolling import rolled
from tsd_twin.lab.virtual_robot import PERIOD_S, VirtualRobot
from tsd_twin.lie import Array
from tsd_twin.sim import YawGyro

SPIN_LEFT = 0.002
"""Standard deviation of the share that is left unknown, by layers of the wheels most of all."""
_RATE_RAD_PER_S = 2.5
_THERE_AND_BACK_S = 2.5
_REST_S = 0.5


class Turned(NamedTuple):
    """What a turn tells."""

    spin_share: float
    """Speed of the wheels over what it was taken for."""
    later_s: float
    """How much later than reckoned the body follows its wheels."""


def turn(robot: VirtualRobot, gyro: YawGyro, slip: Slip | None) -> Turned:
    """Turn a robot there and back, and compare what its gyro says with what its wheels say.

    The rate swings as a sine: gimbals pass all tilts on the way, so that steps of their servos and
    layers of the wheels even out, and what is off by a constant does so between there and back.
    """
    by_wheels: list[float] = []
    by_gyro: list[float] = []
    for i in range(round((_THERE_AND_BACK_S + _REST_S) / PERIOD_S)):
        t_s = i * PERIOD_S
        wave = float(np.sin(2.0 * np.pi * t_s / _THERE_AND_BACK_S))
        rate = _RATE_RAD_PER_S * wave if t_s < _THERE_AND_BACK_S else 0.0
        robot.drive(np.array([0.0, 0.0, rate]))
        by_wheels.append(float(rolled(robot, slip)[2]))
        by_gyro.append(float(gyro.measure(robot.true_twist[2])))
    # Wheels are heard of late, the gyro at once.
    at_s: Array = PERIOD_S * np.arange(len(by_gyro), dtype=np.float64)
    seen = np.interp(at_s - robot.simulated.delay_s, at_s, by_gyro)
    expected = np.array(by_wheels)
    columns = np.column_stack([expected, -np.gradient(expected, PERIOD_S)])
    share, late = np.linalg.lstsq(columns, seen)[0].tolist()
    return Turned(share, late / share)
