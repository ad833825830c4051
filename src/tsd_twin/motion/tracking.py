"""Trajectory tracking: feed-forward plus PID feedback, and execution with abort rules."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from tsd_twin.lie import SE2, Array, wrap
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.motion.trajectory import Reference, Trajectory


@dataclass(frozen=True, slots=True)
class Gains:
    """PID gains for one error; the output is a speed."""

    proportional_per_s: float = 0.0
    integral_per_s2: float = 0.0
    differential: float = 0.0
    integral_limit: float = 0.1
    """Anti-windup limit of the integral part, m/s or rad/s."""


class Pid:
    """PID controllers, one per error component; supports leading batch dimensions."""

    def __init__(self, *gains: Gains) -> None:
        self._p = np.array([g.proportional_per_s for g in gains])
        self._i = np.array([g.integral_per_s2 for g in gains])
        self._d = np.array([g.differential for g in gains])
        self._limit = np.array([g.integral_limit for g in gains])
        self._integral: Array = np.zeros(len(gains))
        self._previous: Array | None = None

    def advance(self, error: Array, dt_s: float) -> Array:
        """Return the correcting speeds (..., k) for `error` (..., k), `dt_s` after the last one."""
        previous = error if self._previous is None or dt_s <= 0.0 else self._previous
        self._previous = np.array(error)
        summed = self._integral + self._i * error * dt_s
        self._integral = np.clip(summed, -self._limit, self._limit)
        slope = (error - previous) / dt_s if dt_s > 0.0 else np.zeros_like(error)
        return self._p * error + self._integral + self._d * slope

    def reset(self) -> None:
        """Reset the integral and derivative parts."""
        self._integral = np.zeros_like(self._p)
        self._previous = None


_POSITION_GAINS = Gains(8.0, 1.0, integral_limit=0.05)
_HEADING_GAINS = Gains(8.0, 1.0, integral_limit=0.2)


class TrackingController:
    """Computes the twist that follows a trajectory, open or closed loop.

    Feed-forward is the reference twist, taken ahead by the actuator lag to compensate it (to first
    order the current twist plus its rate times the lag). That sum itself would jump with the
    acceleration, and the twist limiter would cut the jump. Poses may have leading batch dimensions.
    Twists are not limited here: the trajectory is within the limits, and the control loop limits
    the added correction.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        *,
        lag_s: float = 0.04,
        position: Gains = _POSITION_GAINS,
        heading: Gains = _HEADING_GAINS,
        feed_forward: Callable[[float], Array] | None = None,
    ) -> None:
        """Initialize the controller.

        Args:
            trajectory: Trajectory to follow.
            lag_s: Actuator lag, used as the lead time of the feed-forward.
            position: Gains of the along-track and the cross-track error.
            heading: Gains of the heading error.
            feed_forward: Maps a time to the twist (3,) for a robot without lag. Default: the twist
                of the trajectory.
        """
        self.trajectory = trajectory
        self._lag_s = lag_s
        self._twist_at = feed_forward or self._reference_twist
        self._pid = Pid(position, position, heading)

    def feed_forward(self, t_s: float) -> Array:
        """Return the open-loop body twist (3,) to command at `t_s`."""
        return self._twist_at(t_s + self._lag_s)

    def advance(
        self, t_s: float, pose: SE2, dt_s: float, ahead_s: float = 0.0, gain: float = 1.0
    ) -> Array:
        """Return the body twist (..., 3) to command when the robot is at `pose` (...) at `t_s`.

        `dt_s` is the time since the last call, and `ahead_s` the delay until the command takes
        effect. All gains are multiplied by `gain`.
        """
        reference = self.trajectory.at(t_s)
        error = tracking_errors(reference, pose)
        correction = self._pid.advance(gain * error, dt_s)
        ahead = self.feed_forward(t_s + ahead_s)
        wanted = SE2(reference.pose).rotate(ahead[:2])
        along = SE2(np.array([0.0, 0.0, float(reference.direction)]))
        world = wanted + along.rotate(correction[..., :2])
        out = np.empty(np.shape(pose.xy_heading))
        out[..., :2] = pose.inverse().rotate(world)
        out[..., 2] = ahead[2] + correction[..., 2]
        return out

    def reset(self) -> None:
        """Reset the integral of the errors."""
        self._pid.reset()

    def _reference_twist(self, t_s: float) -> Array:
        return self.trajectory.at(t_s).twist


def tracking_errors(reference: Reference, pose: SE2) -> Array:
    """Return the errors to the reference (..., 3): along-track, cross-track and heading.

    The cross-track error is positive if the path lies to the left of the robot.
    """
    error = reference.pose - pose.xy_heading
    c, s = np.cos(reference.direction), np.sin(reference.direction)
    return np.stack(
        [
            c * error[..., 0] + s * error[..., 1],
            c * error[..., 1] - s * error[..., 0],
            wrap(error[..., 2]),
        ],
        axis=-1,
    )


GOAL_TOLERANCE_M = 0.008
NEAR_RAD = 0.01
"""Goal tolerance once the reference has arrived; a servo step of `tsd` is 16 mm/s."""
SETTLE_S = 1.5
"""Time for the robot to reach the goal tolerance after the reference has arrived."""
TIMEOUT_TOLERANCE_M = 0.05
FAIR_RAD = 0.1
"""Goal tolerance at that timeout."""
MAX_TRACKING_ERROR_M = 0.3
LOST_RAD = 0.6
"""Maximum tracking error; beyond it the robot is blocked, slipping, or was moved."""
STUCK_S = 2.0
_LAG_ALLOWED_M = 0.05
_LAG_RAMP_M = 0.1
"""The reference slows down from a lag of `_LAG_ALLOWED_M`, and stops `_LAG_RAMP_M` beyond that."""
_GAP_S = 0.2
"""Maximum time step between two calls; after a longer pause the robot has begun to stop."""
_GAIN_PER_S = 4.0
_GAIN_TIMES_DELAY = 0.35
"""A loop with delay T does not oscillate or overshoot at gains up to 1 / (e T)."""
_PERIODS_S = 0.06
"""Additional loop delay: one period each of page, robot and camera."""
_LEAD_S = 0.03
"""Time from a command to the middle of its effect without link delay: the latest pose is up to one
period old, and a command takes effect one period later and holds for two."""
MAX_DELAY_S = 1.0
"""Maximum compensated delay; measured delays come from the network."""
_DELAY_RATE = 2.0
"""Maximum rate of change of the delay, which spreads a sudden change over several commands."""
_DELAY_CHANGE_S = 0.05
"""A larger change means that the delay was wrong, and so were the integrated errors."""


class ExecutionPhase(StrEnum):
    """Phase of an execution."""

    GOING = "going"
    ARRIVED = "arrived"
    LOST = "lost"


@dataclass(frozen=True, slots=True, eq=False)
class ExecutionStep:
    """Result of a step: phase, twist to command, progress and errors."""

    phase: ExecutionPhase
    twist: Array
    """(3,): twist to command in the body frame; zero unless the execution is running."""
    done_m: float
    """Arc length of the reference."""
    cross_track_m: float
    """Distance between the robot and the reference."""
    reference_s: float
    """Time of the reference on the trajectory."""
    why: Reason | None = None
    """Reason for the phase `LOST`."""


class TrajectoryExecutor:
    """Closed-loop executor for a trajectory that starts at rest.

    The reference waits for a robot that falls behind, so that the integral does not wind up and
    corners are not cut. Delays are compensated: a pose is compared with the reference at the time
    of the pose, and the gains are as high as the delay allows. The delay may change during
    execution.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        cap: Callable[[Array], Array],
        *,
        lag_s: float = 0.0,
        delay_s: float = 0.0,
        integral_limits: tuple[float, float] = (0.05, 0.2),
    ) -> None:
        """Initialize the executor.

        Args:
            trajectory: Trajectory to follow.
            cap: Scales a twist (3,) to the limits.
            lag_s: Lag of the joints.
            delay_s: Round-trip time of the link.
            integral_limits: Anti-windup limits of position and heading, m/s and rad/s.
        """
        self.trajectory = trajectory
        self._cap = cap
        self._delay_s = _delay(delay_s, 0.0)
        self._tracker = TrackingController(
            trajectory,
            lag_s=lag_s,
            position=Gains(1.0, 0.25, integral_limit=integral_limits[0]),
            heading=Gains(1.0, 0.25, integral_limit=integral_limits[1]),
        )
        self._t_s = 0.0
        self._last_s: float | None = None
        self._stuck_s = 0.0

    def advance(self, now_s: float, pose: SE2, delay_s: float | None = None) -> ExecutionStep:
        """Advance to `now_s`; `pose` is the latest pose reported by the robot.

        `delay_s` is the currently measured round-trip time; None or a non-finite value keeps the
        last.
        """
        if not np.isfinite(pose.xy_heading).all():
            reason = because(Code.POSE_NOT_FINITE)
            lost = ExecutionPhase.LOST
            return ExecutionStep(lost, np.zeros(3), 0.0, math.inf, self._t_s, reason)
        dt_s = 0.0 if self._last_s is None else min(max(now_s - self._last_s, 0.0), _GAP_S)
        self._last_s = now_s
        if delay_s is not None:
            change_s = _delay(delay_s, self._delay_s) - self._delay_s
            self._delay_s += min(max(change_s, -_DELAY_RATE * dt_s), _DELAY_RATE * dt_s)
            if abs(change_s) > _DELAY_CHANGE_S:
                self._tracker.reset()
        seen_s = self._t_s - self._delay_s
        reference = self.trajectory.at(seen_s)
        along, across, turn = (float(part) for part in tracking_errors(reference, pose))
        cross_track_m, heading_error_rad = math.hypot(along, across), abs(turn)
        pace = float(np.clip(1.0 - (cross_track_m - _LAG_ALLOWED_M) / _LAG_RAMP_M, 0.0, 1.0))
        self._stuck_s = self._stuck_s + dt_s if pace < 0.1 else 0.0
        over_s = seen_s - self.trajectory.duration_s
        phase, why = self._phase(over_s, cross_track_m, heading_error_rad)
        twist = np.zeros(3)
        if phase is ExecutionPhase.GOING:
            gain = min(_GAIN_PER_S, _GAIN_TIMES_DELAY / (_PERIODS_S + self._delay_s))
            ahead_s = self._delay_s + _LEAD_S
            twist = self._cap(self._tracker.advance(seen_s, pose, dt_s, ahead_s, gain))
            self._t_s += pace * dt_s
        done_m = float(reference.s_m)
        return ExecutionStep(phase, twist, done_m, cross_track_m, seen_s, why)

    def _phase(
        self, over_s: float, cross_track_m: float, heading_error_rad: float
    ) -> tuple[ExecutionPhase, Reason | None]:
        """Return the phase, and the reason for `LOST`; the reference has arrived for `over_s`."""
        if cross_track_m > MAX_TRACKING_ERROR_M or heading_error_rad > LOST_RAD:
            why = because(Code.OFF_PATH, metres=cross_track_m, deg=math.degrees(heading_error_rad))
            return ExecutionPhase.LOST, why
        if self._stuck_s > STUCK_S:
            return ExecutionPhase.LOST, because(Code.NO_PROGRESS)
        if over_s >= 0.0 and cross_track_m < GOAL_TOLERANCE_M and heading_error_rad < NEAR_RAD:
            return ExecutionPhase.ARRIVED, None
        if not over_s > SETTLE_S:
            return ExecutionPhase.GOING, None
        if cross_track_m < TIMEOUT_TOLERANCE_M and heading_error_rad < FAIR_RAD:
            return ExecutionPhase.ARRIVED, None
        return ExecutionPhase.LOST, because(Code.STAYS_FROM_GOAL, metres=cross_track_m)


def _delay(measured_s: float, otherwise_s: float) -> float:
    """Clamp a measured delay; return `otherwise_s` if it is not finite."""
    return min(max(measured_s, 0.0), MAX_DELAY_S) if math.isfinite(measured_s) else otherwise_s
