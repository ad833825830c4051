"""Other robots on the same floor, as obstacles for paths and inside the stop envelope."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from tsd_twin.client.monitor import RobotMonitor
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.cdr import Odometry
from tsd_twin.motion.obstacles import Disc

MARGIN_M = 0.05
"""Distance that a path keeps between two robots, besides the uncertainty of their poses."""
_SIGMAS = 2.45
"""Radius that contains a planar position with 95 % probability, in standard deviations."""
_AHEAD_S, _STILL_MPS = 1.0, 0.02
"""A moving robot is an obstacle also where it will be by then."""


class OtherRobots:
    """Localized robots around one robot: those whose poses a sensor has measured in the same frame.

    Estimates from joints alone drift apart, so they say nothing about the distance of two robots.
    After a sensor's last pose, the covariance grows, and the obstacle with it. A silent robot stays
    where it was.
    """

    def __init__(self, links: Mapping[str, RobotMonitor], reach_m: Callable[[str], float]) -> None:
        """`links` are the robots that a page may watch; `reach_m` returns their radii by id."""
        self._links, self._reach_m = links, reach_m

    def discs(self, link: RobotMonitor) -> list[Disc]:
        """Return the obstacles for paths of a localized robot, or an empty list."""
        if (own := _localized(link)) is None:
            return []
        own_m = self._reach_m(link.id) + _uncertainty_m(own)
        return [
            Disc(robot, place, own_m + self._reach_m(robot) + _uncertainty_m(odom) + MARGIN_M)
            for robot, odom in self._around(link)
            for place in _places(odom)
        ]

    def reached_by(self, link: RobotMonitor, envelope: Array | None) -> str | None:
        """Return the robot that a stop envelope (n, 2), in the frame of `link`, overlaps most."""
        if envelope is None or (own := _localized(link)) is None:
            return None
        outline = SE2(own.xy_heading).transform(envelope)
        gaps = [
            (_distance_m(outline, odom.xy_heading[:2]) - self._reach_m(robot), robot)
            for robot, odom in self._around(link)
        ]
        gap_m, robot = min(gaps, default=(0.0, ""))
        return robot if gap_m < 0.0 else None

    def _around(self, link: RobotMonitor) -> Iterator[tuple[str, Odometry]]:
        for other in self._links.values():
            if other.id != link.id and not other.is_recording and (odom := _localized(other)):
                yield other.id, odom


def _localized(link: RobotMonitor) -> Odometry | None:
    """Return the estimate of a robot on the floor, if a sensor has measured its pose."""
    status, odom = link.snapshot.status, link.snapshot.odom
    if status is None or odom is None or link.kinematics.pose_type is not SE2:
        return None
    sensor = status.pose_sensor
    known = sensor is not None and sensor.used > 0 and np.isfinite(odom.xy_heading).all()
    return odom if known else None


def _uncertainty_m(odom: Odometry) -> float:
    largest = float(np.linalg.eigvalsh(odom.pose_covariance[:2, :2])[-1])
    return _SIGMAS * math.sqrt(max(0.0, largest))


def _places(odom: Odometry) -> list[tuple[float, float]]:
    """Return the place of a robot, and while it moves also that `_AHEAD_S` later."""
    places = [odom.xy_heading[:2]]
    if np.hypot(*odom.twist[:2]) > _STILL_MPS:
        places.append(SE2(odom.xy_heading).transform(_AHEAD_S * odom.twist[:2]))
    return [(float(x), float(y)) for x, y in places]


def _distance_m(outline: Array, point: Array) -> float:
    """Return the distance of a point from a convex, counter-clockwise outline; negative inside."""
    edges = np.roll(outline, -1, axis=0) - outline
    offset = point - outline
    lengths = np.maximum(np.hypot(*edges.T), 1e-12)
    inside = (edges[:, 0] * offset[:, 1] - edges[:, 1] * offset[:, 0]) / lengths
    if inside.min() > 0.0:
        return -float(inside.min())
    share = np.clip((edges * offset).sum(axis=1) / lengths**2, 0.0, 1.0)
    return float(np.hypot(*(offset - share[:, None] * edges).T).min())
