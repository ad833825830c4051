"""What to command so that a robot drives its tour, by what a camera sees; time is an argument."""

from __future__ import annotations

import math

import numpy as np

from tsd_twin.drives import SingularityDrive
from tsd_twin.errors import TwinError
from tsd_twin.estimation import PoseFilter
from tsd_twin.lab.agreement import Agreement
from tsd_twin.lab.tour import Tour
from tsd_twin.lie import SE2, Array
from tsd_twin.motion import TwistLimiter
from tsd_twin.motion.follower import Follower, Phase
from tsd_twin.robots import SingularityRobot

BLIND_S = 1.5
"""A robot that nobody has seen for so long is stopped; poses may be late by a second."""
_REST_S = 0.3
"""Between one leg and the next, and before the first."""
_MEMORY_S = 2.0
_TRUST = np.diag([0.1, 0.1, 0.5]) ** 2 * 0.1
"""What a second adds to the covariance: wheels that have not been calibrated are off by 0.1 m/s and
0.5 rad/s, for a tenth of a second at a time."""


class Guide:
    """Leads a robot through a tour, closed loop on outside poses, and says when to stop.

    Between poses the robot is reckoned on by the twist that it measures itself. What the robot
    makes of the poses is of no use here: before a calibration it may well not believe them.
    Times are of the robot's clock, that rises.
    """

    def __init__(self, robot: SingularityRobot, tour: Tour) -> None:
        self._tour, self._lag_s = tour, robot.lag_s
        drive = robot.kinematics()
        self._drive: SingularityDrive = drive
        self._limiter = TwistLimiter(drive, tour.limits)
        noise = robot.outside_pose
        sigma = np.array([noise.sigma_m, noise.sigma_m, math.radians(noise.sigma_deg)])
        self._noise = np.diag(np.square(sigma))
        self._filter: PoseFilter | None = None
        self._agreement, self._objection = Agreement(), ""
        self._seen_s = -math.inf
        self._start: SE2 | None = None
        self._legs = iter(tour.legs)
        self._follower: Follower | None = None
        self._done_s = 0.0
        self._rest_until_s: float | None = None
        self.finished = False
        """Whether all legs have been driven, and the robot stands."""
        self.progress = 0.0
        """Share of the tour that is done, 0 to 1."""

    def see(self, pose: SE2, seen_s: float) -> None:
        """Take in an outside pose, and when the robot was there."""
        if self._filter is None:
            self._filter = PoseFilter(
                self._drive, pose, self._noise, now_s=seen_s, memory_s=_MEMORY_S
            )
        else:
            self._filter.fuse_pose(pose, self._noise, seen_s)
        self._objection = self._objection or self._agreement.see(pose, seen_s)
        self._seen_s = max(self._seen_s, min(seen_s, self._filter.now_s))

    def move(self, now_s: float, twist: Array) -> None:
        """Take in the twist (3,), body frame, that the robot measured of itself until `now_s`."""
        self._agreement.move(now_s, twist)
        if self._filter is not None:
            self._filter.advance(now_s, twist, _TRUST)

    def advance(self, now_s: float) -> Array:
        """Return the body twist (3,) to command now.

        Raises:
            TwinError: the robot has to be stopped, and why.
        """
        if self._filter is None or not now_s - self._seen_s <= BLIND_S:
            raise TwinError(f"nobody has seen it for {BLIND_S:g} s")
        if self._objection:
            raise TwinError(self._objection)
        here = self._filter.pose
        if self._start is None:
            self._start = here
        local = self._start.inverse() @ here
        x_m, y_m, _ = local.xy_heading.tolist()
        if not max(abs(x_m), abs(y_m)) <= self._tour.fence_m:
            raise TwinError(
                f"it has left its area: it is {math.hypot(x_m, y_m):.2f} m from where it began"
            )
        if self._rests(now_s):
            return np.zeros(3)
        if self._follower is None:
            return np.zeros(3)
        step = self._follower.advance(now_s, local)
        if step.phase is Phase.LOST:
            raise TwinError(step.reason)
        trajectory = self._follower.trajectory
        share = min(step.done_m / trajectory.length_m, 1.0)
        self.progress = (self._done_s + share * trajectory.duration_s) / self._tour.duration_s
        if step.phase is Phase.ARRIVED:
            self._done_s += trajectory.duration_s
            self._follower, self._rest_until_s = None, None
        return step.twist

    def _rests(self, now_s: float) -> bool:
        """Return whether it stands between legs; begin the next leg when it has stood enough."""
        if self._follower is not None or self.finished:
            return self.finished
        if self._rest_until_s is None:
            self._rest_until_s = now_s + _REST_S
        if now_s < self._rest_until_s:
            return True
        trajectory = next(self._legs, None)
        if trajectory is None:
            self.finished, self.progress = True, 1.0
            return True
        self._follower = Follower(trajectory, self._limiter.cap, lag_s=self._lag_s)
        return False
