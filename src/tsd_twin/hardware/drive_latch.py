"""Rules for motors without a controller board: when wheels may turn, and whether they follow. Pure.

With a board, its firmware has the same rules: safety.c.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from enum import Enum, auto

import numpy as np

from tsd_twin.hardware.joints import JointCommand
from tsd_twin.lie import Array
from tsd_twin.messages.codes import Code, Reason, because

HEARTBEAT_TIMEOUT_S = 0.5
"""Maximum time without a new heartbeat while armed, as on the board."""


class _State(Enum):
    LOCKED = auto()
    """No disarmed command has been seen yet."""
    OFF = auto()
    ON = auto()
    LOST = auto()


class DriveLatch:
    """Permission for wheels to turn, from an arming until a trouble or a disarming.

    An armed command counts only after a disarmed one. Whatever ends the permission while armed
    keeps it ended until the robot has been disarmed and armed again.
    """

    def __init__(self) -> None:
        self.lost: Reason | None = None
        """Reason why wheels may not turn although the robot is armed, or None."""
        self._state = _State.LOCKED
        self._counter = 0
        self._beat_s = -math.inf

    def step(self, command: JointCommand, trouble: Reason | None, now_s: float) -> bool:
        """Return whether the command may turn wheels at `now_s`."""
        beat = command.heartbeat
        if not command.in_force(now_s):
            self.lose(because(Code.NODE_HANGS))
            return False
        if not beat.armed:
            self._state, self.lost = _State.OFF, None
            return False
        if self._state is _State.OFF:
            self._state, self._counter, self._beat_s = _State.ON, beat.counter, now_s
        if beat.counter > self._counter:
            self._counter, self._beat_s = beat.counter, now_s
        if trouble is not None:
            self.lose(trouble)
        elif now_s - self._beat_s > HEARTBEAT_TIMEOUT_S:
            self.lose(because(Code.HEARTBEAT_LOST))
        return self._state is _State.ON

    def lose(self, why: Reason) -> None:
        """End the permission; no effect unless wheels may turn."""
        if self._state is _State.ON:
            self._state, self.lost = _State.LOST, why

    def lock(self, why: Reason) -> None:
        """End the permission, and require a disarmed command before the next arming."""
        self.lose(why)
        if self._state is _State.OFF:
            self._state = _State.LOCKED


FOLLOWING_SHARE, FOLLOWING_LEAST = 0.25, 0.1
"""Largest deviation of a wheel speed that is not a fault, relative to the setpoint, and to the top
speed for small setpoints."""
FOLLOWING_S = 0.3
"""Time that a larger deviation must last."""
LAG_S = 0.3
"""Setpoints of this time count, because a wheel follows them later."""


class WheelFollowing:
    """Finds a wheel whose measured speed is not between its recent setpoints."""

    def __init__(self, names: Sequence[str], top_rad_per_s: float) -> None:
        self._names = list(names)
        self._least = FOLLOWING_LEAST * top_rad_per_s
        self._recent: deque[tuple[float, Array]] = deque()
        self._since_s = np.full(len(names), math.inf)

    def reset(self) -> None:
        """Forget everything, as for wheels without drive."""
        self._recent.clear()
        self._since_s[:] = math.inf

    def step(self, wanted: Array, measured: Array, now_s: float) -> Reason | None:
        """Return the reason for a stuck wheel, or None; speeds (n,) in rad/s, NaN if unmeasured."""
        self._recent.append((now_s, wanted.copy()))
        while now_s - self._recent[0][0] > LAG_S:
            self._recent.popleft()
        lately = np.array([speeds for _, speeds in self._recent])
        nearest = np.clip(measured, lately.min(axis=0), lately.max(axis=0))
        tolerance = np.maximum(self._least, FOLLOWING_SHARE * np.abs(nearest))
        off = np.abs(measured - nearest) > tolerance  # False for NaN.
        self._since_s = np.where(off, np.minimum(self._since_s, now_s), math.inf)
        worst = int(np.argmin(self._since_s))
        if now_s - self._since_s[worst] < FOLLOWING_S:
            return None
        return because(
            Code.WHEEL_STUCK,
            wheel=self._names[worst],
            rpm=float(measured[worst]) * 30.0 / math.pi,
            wanted_rpm=float(wanted[worst]) * 30.0 / math.pi,
        )


EMPTY_S = 1.0
"""Time below `battery.stop_v` until the robot stops, as on the board."""


class BatteryWatch:
    """Rules for the battery that a controller board would check."""

    def __init__(self, arm_v: float, stop_v: float) -> None:
        self._arm_v, self._stop_v = arm_v, stop_v
        self._low_s = math.inf

    def step(self, volts: float, now_s: float, *, armed: bool) -> Reason | None:
        """Return the reason not to drive, or None."""
        if volts >= self._stop_v:
            self._low_s = math.inf
        else:
            self._low_s = min(self._low_s, now_s)
        if now_s - self._low_s >= EMPTY_S:
            return because(Code.BATTERY_EMPTY, volts=volts)
        if not armed and volts < self._arm_v:
            return because(Code.BATTERY_TOO_LOW, volts=volts)
        return None
