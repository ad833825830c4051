"""Joint rounding of the goals of all gimbal servos to whole encoder steps.

Rounded one by one, the goals of a robot that drives straight ahead add up to a turn. Each goal may
be rounded down or up; the combination nearest to the twist is chosen, and what it displaces the
robot by is made up for by later combinations.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from tsd_twin.lie import Array
from tsd_twin.robots import RobotDescription, SingularityDescription

HORIZON_S = 0.5
"""Time for which a combination is assumed to last."""
MARGIN_M = 2e-3
"""A combination is replaced when another one displaces the wheels less by this length."""
CAP_M = 1e-2
"""Maximum displacement to make up for, so that goals at their limits do not wind it up."""
INTERNAL_SHARE = 0.2
"""Weight of velocities by which wheels only slide against each other, relative to the twist."""
_SAME_M2 = 1e-15
"""Squared displacements this close are equal, so that rounding errors do not decide."""
_ON_STEP = 1e-6
"""Angles this close to a step, in steps, are on it."""
_MAX_FREE = 8
"""Maximum number of servos with both neighbours; the others are rounded to the nearest step."""


class GoalRounding:
    """Rounds the gimbal angles of a robot to servo steps so that its twist changes little.

    Rounding changes the rolling velocity of each wheel by d, and displaces its contact by the sum
    e of all d dt since the robot was last at rest. With the pseudo-inverse of the contact equation
    H, the part P = H pinv(H) of d moves the robot, and the wheels slide against each other by the
    rest. The combination minimizes |P (e + T d)|^2 + s |(1 - P)(e + T d)|^2 for the `HORIZON_S`
    T and the `INTERNAL_SHARE` s. With s = 1 and e = 0, each goal is rounded to its nearest step.
    """

    def __init__(self, robot: SingularityDescription) -> None:
        kinematics, k = robot.kinematics(), robot.drive.modules
        self._step_rad = 2.0 * math.pi / robot.servo.steps_per_turn
        self._offset = robot.actuator_offsets().offset.reshape(k, 3)[:, :2].ravel()
        self._neutral = self._offset / self._step_rad
        moving = kinematics.contact_from_twist.reshape(-1, 3) @ kinematics.twist_from_contacts
        self._weights = moving + math.sqrt(INTERNAL_SHARE) * (np.eye(2 * k) - moving)
        self._radius_m = kinematics.wheel_radius_m
        self._steep = math.cos(kinematics.max_tilt_rad - 2.0 * self._step_rad)
        free = min(2 * k, _MAX_FREE)
        self._other = np.array(list(itertools.product((0.0, 1.0), repeat=free)))
        self._goals: Array | None = None
        self._displaced = np.zeros(2 * k)
        """(2k,): weighted displacement since the robot was last at rest, m."""

    @staticmethod
    def of(robot: RobotDescription) -> GoalRounding | None:
        """Return the rounding for `robot`, or None if its servos round their own goals."""
        if isinstance(robot, SingularityDescription) and robot.servo.joint_rounding:
            return GoalRounding(robot)
        return None

    def reset(self) -> None:
        """Forget goals and displacement, because the robot is at rest."""
        self._goals, self._displaced = None, np.zeros_like(self._displaced)

    def step(self, joints: Array, dt_s: float) -> Array:
        """Return `joints` (3k,) with gimbals at whole steps for the next `dt_s`.

        The spins in `joints` are those for which the gimbals were computed, rad/s.
        """
        gimbals, spins = joints.reshape(-1, 3)[:, :2], joints[2::3]
        exact = (gimbals.ravel() - self._offset) / self._step_rad
        by_step = self._weighted_velocity(gimbals, self._step_rad * self._radius_m * spins)
        goals = self._goals = self._choose(gimbals, exact, by_step)
        displaced = self._displaced + dt_s * (by_step @ (goals - exact))
        self._displaced = displaced * (CAP_M / max(CAP_M, math.sqrt(displaced @ displaced)))
        rounded = joints.copy()
        rounded.reshape(-1, 3)[:, :2] = (goals * self._step_rad + self._offset).reshape(-1, 2)
        return rounded

    def _choose(self, gimbals: Array, exact: Array, by_step: Array) -> Array:
        """Return the goals (2k,) in steps: the present ones unless others are clearly better."""
        kept, kept_m = self._goals, math.inf
        if kept is not None and (abs(kept - exact) < 1.0).all():
            left = self._displaced + HORIZON_S * (by_step @ (kept - exact))
            kept_m = math.sqrt(left @ left)
            if kept_m <= MARGIN_M:
                return kept
        nearest, other = self._neighbours(gimbals, exact)
        free = np.argsort(-abs((exact - nearest) * other), kind="stable")[: self._other.shape[1]]
        left = self._displaced + HORIZON_S * (by_step @ (nearest - exact))
        changes = HORIZON_S * (by_step[:, free] * other[free])
        squares = np.square(left + self._other @ changes.T).sum(axis=1)
        best = int((squares <= squares.min() + _SAME_M2).argmax())
        if kept is not None and kept_m <= math.sqrt(squares[best]) + MARGIN_M:
            return kept
        nearest[free] += self._other[best] * other[free]
        return nearest

    def _weighted_velocity(self, gimbals: Array, rims: Array) -> Array:
        """Return the weighted rolling velocity (2k, 2k) of all contacts per step of each servo.

        `rims` (k,) are the rim speeds times the step, m/s. These are the derivatives of
        `SingularityKinematics.contacts`.
        """
        (sin_a, sin_b), (cos_a, cos_b) = np.sin(gimbals).T, np.cos(gimbals).T
        x, y = self._weights[:, 0::2], self._weights[:, 1::2]
        by_step = np.empty_like(self._weights)
        by_step[:, 0::2] = rims * (cos_a * x + sin_a * sin_b * y)
        by_step[:, 1::2] = -rims * cos_a * cos_b * y
        return by_step

    def _neighbours(self, gimbals: Array, exact: Array) -> tuple[Array, Array]:
        """Return the nearest step (2k,) of each servo, and the way (2k,) to its other neighbour.

        Modules within two steps of the tilt limit are rounded towards upright only.
        """
        nearest = np.rint(exact)
        beyond = exact - nearest
        other = np.sign(beyond) * (abs(beyond) > _ON_STEP)
        steep = np.repeat(np.cos(gimbals).prod(axis=1) <= self._steep, 2)
        if steep.any():
            outward = steep & (abs(nearest + self._neutral) > abs(exact + self._neutral))
            nearest += outward * other
            other[steep] = 0.0
        return nearest, other
