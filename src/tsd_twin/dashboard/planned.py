"""A way that is ready to be driven, and what it is timed to."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import msgspec
import numpy as np

from tsd_twin.dashboard.geared import geared
from tsd_twin.dashboard.link import RobotLink
from tsd_twin.dashboard.protocol import Plan, Route
from tsd_twin.drives import Drive
from tsd_twin.errors import PathError
from tsd_twin.lie import SE2, Array, wrap
from tsd_twin.motion.errand import Errand
from tsd_twin.motion.follower import Step
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


@dataclass(frozen=True, slots=True)
class Terms:
    """What a way is timed to."""

    limits: Limits
    gear_rpm: float | None
    """Of wheels that always spin."""
    drive: Drive[SE2] = field(compare=False)
    """In that gear."""


@dataclass(frozen=True, slots=True, eq=False)
class Planned:
    """A way from where the robot stands, timed to the limits."""

    number: int
    start: SE2
    terms: Terms
    trajectory: Trajectory

    def holds(self, pose: SE2, terms: Terms) -> bool:
        """Return whether it still begins where the robot is, and is timed to the same terms."""
        off = pose.xy_heading - self.start.xy_heading
        stands = bool(np.hypot(off[0], off[1]) < _MOVED_M) and abs(wrap(off[2])) < _MOVED_RAD
        return bool(stands) and terms == self.terms

    def shown(
        self, phase: Literal["planned", "going", "arrived", "ended"], step: Step | None = None
    ) -> Route:
        """Return what a page is told of it, after a step if there was one."""
        return Route(
            number=self.number,
            phase=phase,
            length_m=round(self.trajectory.length_m, 3),
            time_s=round(self.trajectory.duration_s, 2),
            done_m=0.0 if step is None else round(step.done_m, 3),
            off_mm=0.0 if step is None else round(1000.0 * min(step.off_m, 1e3), 1),
            reason="" if step is None else step.reason,
        )


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


def terms_in_force(link: RobotLink, level: int) -> Terms:
    """Return what the robot allows now, at a speed level in percent."""
    limits, snapshot = link.robot.limits, link.snapshot
    status = snapshot.status
    speed, turn = limits.speed_mps, limits.turn_rate_rad_per_s
    if status is not None and status.limits.speed_mps > 0.0:
        speed = min(speed, status.limits.speed_mps)
    if status is not None and status.limits.turn_rate_rad_per_s > 0.0:
        turn = min(turn, status.limits.turn_rate_rad_per_s)
    share = 0.01 * level
    return Terms(
        msgspec.structs.replace(limits, speed_mps=share * speed, turn_rate_rad_per_s=share * turn),
        None if status is None or status.gear is None else status.gear.wanted_rpm,
        geared(link.robot, link.drive, snapshot),
    )


def timed(errand: Errand, start: SE2, terms: Terms) -> Trajectory:
    """Return the way of an errand, timed within the limits; takes some 50 ms.

    Raises:
        PathError: there is none.
    """
    route, limits = errand.route(start), terms.limits
    turn = _SPEED_SHARE * limits.turn_rate_rad_per_s
    return plan(
        route,
        terms.drive,
        msgspec.structs.replace(limits, turn_rate_rad_per_s=turn),
        share=_SHARE,
        speed_mps=_SPEED_SHARE * limits.speed_mps,
        cell_m=max(_SHORTEST_CELL_M, route.length_m / _CELLS),
    )
