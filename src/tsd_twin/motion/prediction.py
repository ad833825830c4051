"""Motion prediction that compensates the measured link delay.

The prediction is a forward simulation with the commands in transit.
"""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tsd_twin.kinematics import Kinematics
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.status import CommandStatus
from tsd_twin.motion.twist_limiter import TwistLimiter
from tsd_twin.robots.description import Limits

_MAX_DELAY_S = 5.0
"""Maximum plausible delay."""
_ROUNDING_S = 1e-3
"""Rounding of ages in a status."""
_SENT_KEPT = 256
_MEASURED_KEPT = 5
_MAX_AGE_S = 2.0


class CommandDelay:
    """Delay from sending a command to receiving a state that includes its effect.

    A status names the latest accepted command and its age. This measures the delay to the robot,
    the wait for its next period and the delay back together, without synchronized clocks. Because
    the status comes from the network, implausible values are discarded, and one wrong value in five
    has no effect.
    """

    def __init__(self) -> None:
        self._sent: deque[tuple[int, float]] = deque(maxlen=_SENT_KEPT)
        self._measured: deque[tuple[float, float]] = deque(maxlen=_MEASURED_KEPT)

    def add_sent(self, seq: int, now_s: float) -> None:
        """Record a command sent at `now_s`."""
        self._sent.append((seq, now_s))

    def add_status(self, command: CommandStatus, now_s: float) -> None:
        """Measure the delay with a status received at `now_s`."""
        age_s = command.age_s
        if age_s is None or not 0.0 <= age_s < math.inf:
            return
        for seq, sent_s in reversed(self._sent):
            if seq == command.seq:
                delay_s = now_s - sent_s - age_s
                if -_ROUNDING_S <= delay_s <= _MAX_DELAY_S:
                    self._measured.append((now_s, max(delay_s, 0.0)))
                return

    def median_s(self, now_s: float) -> float | None:
        """Return the median of recent delays, or None without any in the last 2 s."""
        recent = [delay_s for at_s, delay_s in self._measured if now_s - at_s <= _MAX_AGE_S]
        return statistics.median(recent) if recent else None


STEP_S = 0.01
"""Control period of the robot, which approaches a command in steps."""
AT_REST = 0.005
"""Standstill threshold, in m/s and rad/s."""
LONGEST_S = 5.0
"""Maximum horizon; every robot is at rest by then."""


@dataclass(frozen=True, slots=True, eq=False)
class PendingCommand:
    """Command in transit to the robot."""

    after_s: float
    """Arrival time relative to the initial state of the prediction; may be negative."""
    request: Array
    """(3,): the requested twist."""
    heading_rad: float | None = None
    """Heading of the frame of the predicted poses in the axes of the twist; None if the twist is in
    the base frame."""

    def in_base_frame(self, pose: SE2) -> Array:
        """Return the twist (3,) in the base frame of a robot at `pose`."""
        if self.heading_rad is None:
            return self.request
        turn = SE2(np.array([0.0, 0.0, self.heading_rad + float(pose.xy_heading[2])]))
        return np.append(turn.inverse().rotate(self.request[:2]), self.request[2])


class Predictor:
    """Forward simulation of limiter and kinematics; stateless between calls.

    `lag_s` is the first-order time constant of the joints. `step_s` is best the robot's control
    period, but may be longer if an error of 1 cm is acceptable.
    """

    def __init__(
        self,
        kinematics: Kinematics[SE2],
        limits: Limits,
        lag_s: float = 0.0,
        step_s: float = STEP_S,
    ) -> None:
        self._kinematics = kinematics
        self._step_s = step_s
        self._limiter = TwistLimiter(kinematics, limits)
        # Remaining fraction of the difference between setpoint and motion after a step.
        self._remaining = math.exp(-step_s / lag_s) if lag_s > 0.0 else 0.0

    def _states(
        self,
        pose: SE2,
        twist: Array,
        commands: Sequence[PendingCommand],
        share: float,
        measured: Array | None,
    ) -> Iterator[tuple[float, SE2, Array]]:
        """Yield the time, pose and actual twist (3,) of each step; it lags the commanded twist.

        It starts at `pose` with `twist` (3,) commanded to the joints, moving with the twist
        `measured` (3,), or with the commanded one if None. `commands` are in the order of arrival.
        The last one holds forever; without any, the commanded twist stays constant. `share` is the
        fraction of the limits allowed by the lease.
        """
        waiting, step_s = list(commands), self._step_s
        goal = twist = np.asarray(twist, float)
        moving = twist if measured is None else np.asarray(measured, float)
        newest: PendingCommand | None = None
        for step in range(round(LONGEST_S / step_s) + 1):
            after_s = step * step_s
            yield after_s, pose, moving
            before = newest
            while waiting and waiting[0].after_s <= after_s + 1e-9:
                newest = waiting.pop(0)
            if newest is not None and (newest is not before or newest.heading_rad is not None):
                goal = self._limiter.cap(newest.in_base_frame(pose), share)
            if twist is not goal:
                near = self._limiter.approach(twist, goal, step_s)
                twist = goal if np.array_equal(near, goal) else near
            moving = twist + self._remaining * (moving - twist)
            pose = self._kinematics.integrate(pose, moving, step_s)

    def after(
        self,
        ahead_s: float,
        pose: SE2,
        twist: Array,
        commands: Sequence[PendingCommand],
        share: float = 1.0,
        measured: Array | None = None,
    ) -> SE2:
        """Return the pose after `ahead_s`, rounded to a step.

        Args:
            ahead_s: Time from the initial state.
            pose: Initial pose.
            twist: (3,): twist commanded to the joints at that time.
            commands: Commands in transit, in the order of arrival.
            share: Fraction of the limits allowed by the lease.
            measured: (3,): estimated twist at that time; by default, the commanded one.
        """
        for after_s, predicted, _ in self._states(pose, twist, commands, share, measured):
            pose = predicted
            if after_s >= ahead_s - 0.5 * self._step_s:
                break
        return pose

    def until_rest(
        self,
        pose: SE2,
        twist: Array,
        commands: Sequence[PendingCommand],
        share: float = 1.0,
        measured: Array | None = None,
    ) -> list[SE2]:
        """Return the predicted poses until the last command is active and the robot is at rest.

        Arguments are as for `after`.
        """
        path: list[SE2] = []
        last_s = commands[-1].after_s if commands else 0.0
        for after_s, predicted, moving in self._states(pose, twist, commands, share, measured):
            path.append(predicted)
            if after_s > last_s and np.abs(moving).max() < AT_REST:
                break
        return path
