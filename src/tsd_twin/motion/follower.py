"""Driving a trajectory while somebody says so: what to command now, and how it goes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from tsd_twin.lie import SE2, Array
from tsd_twin.motion.pid import Gains
from tsd_twin.motion.tracker import Tracker, TrackerSettings, errors
from tsd_twin.motion.trajectory import Trajectory

NEAR_M = 0.008
NEAR_RAD = 0.01
"""Arrived, when the reference has; a servo step of `tsd` is 16 mm/s, so it cannot be much less."""
SETTLE_S = 1.5
"""Longer than this after the reference nobody waits for the last millimetres."""
FAIR_M = 0.05
FAIR_RAD = 0.1
"""Arrived all the same, when there is no more time."""
LOST_M = 0.3
LOST_RAD = 0.6
"""So far from the reference, the robot does not follow it: it is held, it slips, it was moved."""
STUCK_S = 2.0
_FREE_M = 0.05
_SPAN_M = 0.1
"""From `_FREE_M` behind on, the reference goes slower, and `_SPAN_M` further it waits."""
_GAP_S = 0.2
"""What passes at once between two calls at most: longer, and the robot has begun to stop."""
_GAIN_PER_S = 4.0
_GAIN_TIMES_DELAY = 0.35
"""A loop that answers late by T neither swings nor overshoots with a gain up to 1 / (e T)."""
_PERIODS_S = 0.06
"""How late it is besides: a period of the page, the robot and the picture each."""


class Phase(StrEnum):
    """How it goes."""

    GOING = "going"
    ARRIVED = "arrived"
    LOST = "lost"


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """What comes of one call."""

    phase: Phase
    twist: Array
    """(3,): to command in the body frame; zero unless it is going."""
    done_m: float
    """How far along the path the reference is."""
    off_m: float
    """Between the robot and the reference."""
    off_rad: float
    reason: str = ""
    """Why it is lost."""


class Follower:
    """Follows a trajectory from a robot at rest at its start, closed loop; time is an argument.

    The reference waits for a robot that falls behind, so that nothing winds up and no corner is
    cut. Poses that come late, and commands that arrive late, are reckoned with: a pose is compared
    with where the reference was then, and the gains are as high as the delay allows.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        cap: Callable[[Array], Array],
        *,
        lag_s: float = 0.0,
        delay_s: float = 0.0,
    ) -> None:
        """`cap` scales a twist (3,) to the limits.

        `lag_s` is how late the joints follow, `delay_s` the way to the robot and back.
        """
        gain = min(_GAIN_PER_S, _GAIN_TIMES_DELAY / (_PERIODS_S + delay_s))
        gains = Gains(gain, 0.25 * gain, integral_limit=0.05)
        turning = Gains(gain, 0.25 * gain, integral_limit=0.2)
        self.trajectory = trajectory
        self._cap = cap
        self._delay_s = delay_s
        settings = TrackerSettings(lag_s + delay_s, gains, gains, turning)
        self._tracker = Tracker(trajectory, settings)
        self._t_s = 0.0
        self._last_s: float | None = None
        self._stuck_s = 0.0

    def advance(self, now_s: float, pose: SE2) -> Step:
        """Return what to command at `now_s`, when the robot has last said that it is at `pose`."""
        if not np.isfinite(pose.xy_heading).all():
            return self._step(Phase.LOST, 0.0, math.inf, math.inf, "the pose is no number")
        dt_s = 0.0 if self._last_s is None else min(max(now_s - self._last_s, 0.0), _GAP_S)
        self._last_s = now_s
        seen_s = self._t_s - self._delay_s
        reference = self.trajectory.at(seen_s)
        along, across, turn = (float(part) for part in errors(reference, pose))
        done_m, off_m, off_rad = float(reference.s_m), math.hypot(along, across), abs(turn)
        pace = float(np.clip(1.0 - (off_m - _FREE_M) / _SPAN_M, 0.0, 1.0))
        self._stuck_s = self._stuck_s + dt_s if pace < 0.1 else 0.0
        if off_m > LOST_M or off_rad > LOST_RAD:
            why = f"the robot is {off_m:.2f} m and {math.degrees(off_rad):.0f}° off its path"
            return self._step(Phase.LOST, done_m, off_m, off_rad, why)
        if self._stuck_s > STUCK_S:
            return self._step(Phase.LOST, done_m, off_m, off_rad, "the robot does not get on")
        over_s = seen_s - self.trajectory.duration_s
        if over_s >= 0.0 and off_m < NEAR_M and off_rad < NEAR_RAD:
            return self._step(Phase.ARRIVED, done_m, off_m, off_rad)
        if over_s > SETTLE_S:
            if off_m < FAIR_M and off_rad < FAIR_RAD:
                return self._step(Phase.ARRIVED, done_m, off_m, off_rad)
            why = f"the robot stays {off_m:.2f} m from its goal"
            return self._step(Phase.LOST, done_m, off_m, off_rad, why)
        twist = self._cap(self._tracker.advance(seen_s, pose, dt_s))
        self._t_s += pace * dt_s
        return Step(Phase.GOING, twist, done_m, off_m, off_rad)

    def _step(
        self, phase: Phase, done_m: float, off_m: float, off_rad: float, reason: str = ""
    ) -> Step:
        return Step(phase, np.zeros(3), done_m, off_m, off_rad, reason)
