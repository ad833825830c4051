"""Full speed ahead, and stop: the velocity of a robot against the time-optimal profile."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tsd_twin.lab.virtual_robot import PERIOD_S, VirtualRobot
from tsd_twin.lie import Array
from tsd_twin.robots.robot import Limits

_SETTLE_S = 1.0
_LONGEST_S = 120.0


@dataclass(frozen=True, slots=True)
class Dash:
    """The fastest way over a distance from rest to rest: a triangle, or a trapezoid.

    Half-way at the limit of acceleration and half braking (Savnani et al. 2019), with the top speed
    held in between when it is reached.
    """

    distance_m: float
    speed_mps: float
    acceleration_mps2: float
    deceleration_mps2: float

    @staticmethod
    def of(distance_m: float, limits: Limits) -> Dash:
        """Return the dash of a robot with these limits."""
        a, d = limits.acceleration_mps2, limits.deceleration_mps2
        return Dash(distance_m, limits.speed_mps, a, d)

    @property
    def peak_mps(self) -> float:
        """Highest speed: the top speed, or less when there is no time for it."""
        a, d = self.acceleration_mps2, self.deceleration_mps2
        return min(self.speed_mps, math.sqrt(2.0 * self.distance_m * a * d / (a + d)))

    @property
    def is_triangle(self) -> bool:
        """Whether the top speed is not reached."""
        return self.peak_mps < self.speed_mps

    @property
    def brake_at_m(self) -> float:
        """Where braking begins; half-way, when it brakes as hard as it accelerates."""
        return self.distance_m - self.peak_mps**2 / (2.0 * self.deceleration_mps2)

    @property
    def duration_s(self) -> float:
        """From rest to rest."""
        up, down = self.peak_mps / self.acceleration_mps2, self.peak_mps / self.deceleration_mps2
        held_m = self.distance_m - 0.5 * self.peak_mps * (up + down)
        return up + down + held_m / self.peak_mps

    def speed(self, t_s: Array) -> Array:
        """Return the speed at times `t_s` (...), m/s."""
        rising = self.acceleration_mps2 * t_s
        falling = self.deceleration_mps2 * (self.duration_s - t_s)
        return np.clip(np.minimum(rising, falling), 0.0, self.peak_mps)


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """What a robot made of a dash, a row for each period."""

    dash: Dash
    t_s: Array
    distance_m: Array
    speed_mps: Array
    commanded_mps: Array

    @property
    def overshoot_m(self) -> float:
        """How far beyond the end it stopped; negative is short of it."""
        return float(self.distance_m[-1]) - self.dash.distance_m

    def columns(self) -> dict[str, Array]:
        """Return the columns of a table."""
        return {
            "t_s": self.t_s,
            "commanded_mps": self.commanded_mps,
            "true_mps": self.speed_mps,
            "ideal_mps": self.dash.speed(self.t_s),
            "distance_m": self.distance_m,
        }


def dash(robot: VirtualRobot, goal: Dash) -> Run:
    """Give full speed, and none from where braking has to begin, by the robot's own odometry.

    A command takes effect in the period after, so it is given as many ahead.
    """
    full, none = np.array([goal.speed_mps, 0.0, 0.0]), np.zeros(3)
    rows: list[tuple[float, float, float, float]] = []
    braking, left_s = False, _SETTLE_S
    start_s = robot.now_s
    while left_s > 0.0 and robot.now_s - start_s < _LONGEST_S:
        speed = float(robot.true_twist[0])
        rows.append(
            (robot.now_s - start_s, float(robot.truth.xy_heading[0]), speed, robot.core.twist[0])
        )
        odometry = robot.odometry()
        ahead_m = float(odometry.xy_heading[0] + odometry.twist[0] * PERIOD_S)
        braking = braking or ahead_m >= goal.brake_at_m
        robot.drive(none if braking else full)
        if braking and not robot.core.twist.any():
            left_s -= PERIOD_S
    t_s, distance_m, speed_mps, commanded_mps = np.array(rows).T
    return Run(goal, t_s, distance_m, speed_mps, commanded_mps)
