"""Driving a robot on the bus with commands, for as long as all is well."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

from tsd_twin import topics
from tsd_twin.errors import TwinError
from tsd_twin.lab.keyboard import Keys
from tsd_twin.lab.operator import Operator
from tsd_twin.lie import Array
from tsd_twin.topics import Urgency

PERIOD_S = 0.02
_SILENT_S = 1.0
"""Twenty statuses; without a fresh one to echo, commands do not count long before that."""


class Driver:
    """Sends twists 50 times a second in the name of an operator who has control.

    Whatever goes wrong is raised, and nothing is sent any more: the robot stops by itself then, and
    the operator disarms it on the way out. So it does when this process is killed.
    """

    def __init__(self, operator: Operator, keys: Keys) -> None:
        self._operator, self._keys = operator, keys
        # After a longer pause the robot has begun to stop, and is not set off again.
        limits, age_s = operator.robot.limits, operator.max_age_s or 0.0
        self._pause_s = limits.command_timeout_s + max(0.0, age_s - limits.max_command_age_s)
        key = topics.twist_key(operator.id, operator.name)
        self._commands = operator.bus.publisher(key, Urgency.REAL_TIME, topics.TWIST.type)
        self._stops: int | None = None

    def drive(self, step: Callable[[float], Array | None]) -> Iterator[None]:
        """Command what `step` says at each time, until that is None; yield after each command.

        Raises:
            TwinError: somebody pressed a key, the robot began to stop by itself, another has
                control, it fell silent, or this process was held up; or whatever `step` raises.
        """
        heard_s = last_s = time.monotonic()
        while True:
            now_s = time.monotonic()
            if now_s - last_s > self._pause_s:
                raise TwinError(f"this program was held up for {now_s - last_s:.1f} s")
            last_s = now_s
            if self._all_is_well():
                heard_s = now_s
            if now_s - heard_s > _SILENT_S:
                raise TwinError(f"{self._operator.id} has said nothing for {_SILENT_S:g} s")
            twist = step(now_s)
            if twist is None:
                return
            self._send(twist)
            yield
            left_s = now_s + PERIOD_S - time.monotonic()
            if self._keys.pressed(max(0.0, left_s)):
                raise TwinError("stopped by a key")

    def _all_is_well(self) -> bool:
        """Return whether there is news of the robot; raise when it is bad."""
        status = self._operator.news()
        if status is None:
            return False
        self._operator.check(status, "ready", "driving")
        self._stops = status.stops if self._stops is None else self._stops
        if status.stops > self._stops:
            raise TwinError(f"{self._operator.id} stopped by itself: {status.stop_reason}")
        return True

    def _send(self, twist: Array) -> None:
        command = self._operator.command(twist)
        self._commands.put(command.payload, command.attachment)
