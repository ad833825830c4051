"""Paths of a robot on a floor: the goal, the limits in force, and the timed trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from tsd_twin.errors import PathError
from tsd_twin.kinematics import Kinematics
from tsd_twin.lie import SE2
from tsd_twin.motion.routes import NavigationGoal
from tsd_twin.motion.trajectory import Trajectory
from tsd_twin.motion.trajectory import plan as time_parameterize
from tsd_twin.robots.description import Limits

if TYPE_CHECKING:
    from tsd_twin.client.protocol import ControlProtocol

__all__ = ["NavigationGoal", "PlanLimits", "goal_along", "goal_at", "plan"]

_SPEED_SHARE = 0.9
_SHARE = 0.7
"""Of the limits of speed, and of the others, that the plan uses: the rest is for correction."""
_CELLS = 250
_SHORTEST_CELL_M = 0.01


@dataclass(frozen=True, slots=True)
class PlanLimits:
    """Speed and acceleration limits of a planned trajectory."""

    limits: Limits
    kinematics: Kinematics[Any]

    @staticmethod
    def in_force(protocol: ControlProtocol, speed_mps: float | None) -> PlanLimits:
        """Return the limits of the description, lowered by the lease and by `speed_mps`."""
        limits, status = protocol.robot.limits, protocol.status
        speed, turn = limits.speed_mps, limits.turn_rate_rad_per_s
        if status is not None and status.limits.speed_mps > 0.0:
            speed = min(speed, status.limits.speed_mps)
        if status is not None and status.limits.turn_rate_rad_per_s > 0.0:
            turn = min(turn, status.limits.turn_rate_rad_per_s)
        if speed_mps is not None:
            speed = min(speed, speed_mps)
        lowered = msgspec.structs.replace(limits, speed_mps=speed, turn_rate_rad_per_s=turn)
        return PlanLimits(lowered, protocol.kinematics_in_force())


def goal_at(x_m: float, y_m: float, heading_rad: float | None) -> NavigationGoal:
    """Return a place to go to; without a heading, the robot keeps its own."""
    return NavigationGoal(np.array([[x_m, y_m]]), heading_rad)


def goal_along(points: Sequence[Sequence[float]], heading_rad: float | None) -> NavigationGoal:
    """Return a line to follow through `points` of (x, y) in metres.

    Raises:
        PathError: there are no points, or they are not pairs of numbers.
    """
    line = np.asarray(points, dtype=float)
    if line.ndim != 2 or line.shape[1] != 2 or not len(line):
        raise PathError("a path is a list of (x, y) in metres")
    return NavigationGoal(line, heading_rad)


def plan(goal: NavigationGoal, start: SE2, limits: PlanLimits) -> Trajectory:
    """Return the path from `start` to the goal, timed within the limits; takes some 50 ms.

    Raises:
        PathError: there is none.
    """
    route = goal.route(start)
    turn = _SPEED_SHARE * limits.limits.turn_rate_rad_per_s
    return time_parameterize(
        route,
        limits.kinematics,
        msgspec.structs.replace(limits.limits, turn_rate_rad_per_s=turn),
        share=_SHARE,
        speed_mps=_SPEED_SHARE * limits.limits.speed_mps,
        cell_m=max(_SHORTEST_CELL_M, route.length_m / _CELLS),
    )
