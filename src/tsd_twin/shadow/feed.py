"""Messages of a robot put together by the period they belong to, for its shadow twin."""

from __future__ import annotations

from typing import Any

from tsd_twin.messages.status import Status
from tsd_twin.messages.topics import JOINTS, ODOM, SETPOINT
from tsd_twin.shadow.twin import ShadowTwin

_KEPT = 8
"""Periods that wait for a message that is still to come."""


class ShadowFeed:
    """Puts the messages of a period together, which come one by one, and hands them to a twin.

    Set-points between two periods of the other streams, and periods that lack a message, are left
    out.
    """

    def __init__(self, twin: ShadowTwin) -> None:
        self.twin = twin
        self.status: Status | None = None
        """Newest status."""
        self._waiting: dict[int, dict[str, Any]] = {}

    def add(self, stream: str, message: Any, robot_ns: int) -> None:
        """Take a `JointState` of `joints` or `setpoint`, or an `Odometry` of `odom`.

        `robot_ns` is the robot's monotonic clock when it was sent: equal for those of a period.
        """
        parts = self._waiting.setdefault(robot_ns, {})
        parts[stream] = message
        if len(parts) == len(STREAMS):
            for each in [each for each in self._waiting if each <= robot_ns]:
                del self._waiting[each]
            self.twin.advance(
                robot_ns, parts["joints"], parts["setpoint"], parts["odom"], self.status
            )
        elif len(self._waiting) > 2 * _KEPT:
            del self._waiting[min(self._waiting)]


STREAMS = {"joints": JOINTS, "setpoint": SETPOINT, "odom": ODOM}
"""Topics that a twin is fed with, beside the status."""
