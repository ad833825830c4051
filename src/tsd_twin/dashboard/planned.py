"""A way that is ready to be driven, and what it is timed to."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np

from tsd_twin.dashboard.link import RobotLink
from tsd_twin.dashboard.protocol import Plan
from tsd_twin.drives import Drive
from tsd_twin.errors import PathError
from tsd_twin.lie import SE2, Array, wrap
from tsd_twin.motion.errand import Errand
from tsd_twin.motion.trajectory import Trajectory, plan
from tsd_twin.robots.robot import Limits

_SPEED_SHARE = 0.9
_SHARE = 0.7
"""Of the limits of speed, and of the others, that the timing uses: the rest is for correction."""
_CELLS = 250
_SHORTEST_CELL_M = 0.01
_LOOK_M = 0.05
"""A hand that was dragged less has not said where to look."""
_MOVED_M, _MOVED_RAD = 0.03, 0.05
"""A robot that is further from the start of its way has been moved since it was planned."""


@dataclass(frozen=True, slots=True, eq=False)
class Planned:
    """A way from where the robot stands, timed to the limits."""

    number: int
    start: SE2
    limits: Limits
    trajectory: Trajectory

    def holds(self, pose: SE2, limits: Limits) -> bool:
        """Return whether it still begins where the robot is, and is timed to the same limits."""
        off = pose.xy_heading - self.start.xy_heading
        stands = bool(np.hypot(off[0], off[1]) < _MOVED_M) and abs(wrap(off[2])) < _MOVED_RAD
        return bool(stands) and limits == self.limits


def errand_of(wish: Plan, points: Array) -> Errand:
    """Return what is wished, with the places (n, 2) on the floor that were meant.

    Raises:
        PathError: there are none.
    """
    if not len(points):
        raise PathError("that is not on the floor")
    heading = wish.heading
    if wish.kind == "to":
        if len(points) > 1 and np.hypot(*(ahead := points[1] - points[0])) > _LOOK_M:
            heading = float(np.arctan2(ahead[1], ahead[0]))
        points = points[:1]
    return Errand(points, heading)


def limits_in_force(link: RobotLink, level: int) -> Limits:
    """Return what the robot allows now, at a speed level in percent."""
    limits, status = link.robot.limits, link.snapshot.status
    speed, turn = limits.speed_mps, limits.turn_rate_rad_per_s
    if status is not None and status.limits.speed_mps > 0.0:
        speed = min(speed, status.limits.speed_mps)
    if status is not None and status.limits.turn_rate_rad_per_s > 0.0:
        turn = min(turn, status.limits.turn_rate_rad_per_s)
    share = 0.01 * level
    return msgspec.structs.replace(
        limits, speed_mps=share * speed, turn_rate_rad_per_s=share * turn
    )


def timed(errand: Errand, start: SE2, drive: Drive[SE2], limits: Limits) -> Trajectory:
    """Return the way of an errand, timed within `limits`; takes some 50 ms.

    Raises:
        PathError: there is none.
    """
    route = errand.route(start)
    turn = _SPEED_SHARE * limits.turn_rate_rad_per_s
    return plan(
        route,
        drive,
        msgspec.structs.replace(limits, turn_rate_rad_per_s=turn),
        share=_SHARE,
        speed_mps=_SPEED_SHARE * limits.speed_mps,
        cell_m=max(_SHORTEST_CELL_M, route.length_m / _CELLS),
    )
