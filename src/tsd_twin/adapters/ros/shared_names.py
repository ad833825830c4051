"""Fault detection: two robots with the same ROS name in the ROS graph (pure)."""

from __future__ import annotations

import math

from tsd_twin.adapters.ros.port import NODE, RosPort
from tsd_twin.adapters.ros_topics import CMD_VEL, ODOMETRY, RosNames
from tsd_twin.messages.codes import Code, Reason, because

CHECK_S = 0.2
"""Interval between graph queries, which cost several middleware calls."""
READERS = frozenset({NODE, f"{NODE}_stamped"})
"""Nodes that represent a bus robot, identified by the topic they read."""


def shared_name(port: RosPort, names: RosNames, *, is_shown: bool) -> Reason | None:
    """Return a reason if another robot has the same name, or None.

    If the robot `is_shown`, our own port publishes its `odom`; a second publisher then belongs to
    another robot.
    """
    odom, cmd_vel = names.topic(ODOMETRY.name), names.topic(CMD_VEL.name)
    publishers = sorted(port.publishers(odom))
    readers = sorted(READERS.intersection(port.subscribers(cmd_vel)))
    if len(publishers) > (0 if is_shown else 1):
        return because(Code.ROS_NAME_PUBLISHED, topic=odom, node=publishers[-1])
    if readers:
        return because(Code.ROS_NAME_READ, topic=cmd_vel, node=readers[0])
    return None


class NameWatch:
    """Latest result of `shared_name`, refreshed periodically."""

    def __init__(self, port: RosPort, names: RosNames, *, is_shown: bool) -> None:
        self._port, self._names, self._is_shown = port, names, is_shown
        self._checked_s = -math.inf
        self._problem: Reason | None = None

    def problem(self, now_s: float) -> Reason | None:
        """Return the reason that is true now; None if no other robot has the name."""
        if now_s - self._checked_s >= CHECK_S:
            self._checked_s = now_s
            self._problem = shared_name(self._port, self._names, is_shown=self._is_shown)
        return self._problem
