"""Port to ROS: what an adapter needs of a middleware, and checks of what arrives. Pure.

A message carries the time of its publisher's clock. The smallest difference to the time of arrival
is that of the fastest message: how much later than that one comes, for so long it has waited.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tsd_twin.errors import MessageError
from tsd_twin.interop.cmd_vel import PAUSE_S, TWIST_STAMPED
from tsd_twin.interop.mapping import (
    CMD_VEL,
    PUBLISHED,
    READ,
    SERVICES,
    RosMessage,
    RosNames,
    RosTopic,
)
from tsd_twin.messages.requests import PoseStamped
from tsd_twin.messages.ros import ODOM, decode_cdr, stamp_ns

NODE = "tsd_ros"
"""Name of the node of each robot, in the namespace of the robot."""


@dataclass(frozen=True, slots=True)
class Endpoints:
    """Name of a node, its topics and services."""

    node: str
    published: tuple[RosTopic, ...]
    read: tuple[RosTopic, ...]
    services: tuple[str, ...] = ()


ADAPTER = Endpoints(NODE, PUBLISHED, READ, SERVICES)
"""A robot on the bus as a node of ROS."""


class Inputs(Protocol):
    """Receiver of what comes from ROS; called on threads of the middleware."""

    def on_message(self, row: RosTopic, type_name: str, payload: bytes, origin: Origin) -> None:
        """Take a message of a topic that is read."""
        ...

    def on_unreadable(self, row: RosTopic, reason: str) -> None:
        """Take note of a message that is none."""
        ...

    def on_call(self, service: str, answer: Callable[[bool, str], None]) -> None:
        """Carry out a service; `answer` may be called later, on any thread, once."""
        ...


class RosPort(Protocol):
    """Node of one robot, with all its topics and services."""

    def wants(self, topic: str) -> bool:
        """Return whether a topic has a subscriber."""
        ...

    def publish(self, message: RosMessage) -> None:
        """Publish a message; one thread at a time."""
        ...

    def close(self) -> None:
        """Leave the graph."""
        ...


OpenPort = Callable[[RosNames, Inputs | None], RosPort]
"""Opens the port of a robot; without inputs, nothing can be driven. May raise a TwinError."""


def types_of(row: RosTopic) -> tuple[str, ...]:
    """Return the types that are read on a topic."""
    return (row.type, TWIST_STAMPED) if row is CMD_VEL else (row.type,)


MOST_PUBLISHERS = 64
"""Publishers whose clocks are known at once; the one that was silent longest is forgotten."""
DRIFT = 1e-3
"""Seconds in a second that two clocks may drift apart."""
UNTOLD = b""
"""Publisher of a message where the middleware does not say which one of several it was."""
_UNIT = 0.01
"""How far the length of a quaternion may be from one."""


@dataclass(frozen=True, slots=True)
class Origin:
    """Where and when a message was published."""

    publisher: bytes
    sequence: int
    source_ns: int
    """Wall clock of the publisher."""


@dataclass(slots=True)
class _Clock:
    offset_s: float
    """Of the fastest message: monotonic clock here less wall clock there."""
    sequence: int
    at_s: float


class Arrivals:
    """Clocks and sequence numbers of all publishers of a topic."""

    def __init__(self) -> None:
        self._clocks: dict[bytes, _Clock] = {}

    def sent_after_s(self, origin: Origin, now_s: float) -> float | None:
        """Return when a message was sent, on the clock of `now_s`, its arrival.

        The time is that of the fastest message so far, at most: a message that took longer gets an
        earlier time. None for a message that came twice, or after a newer one.
        """
        offset_s = now_s - 1e-9 * origin.source_ns
        clock = self._clocks.pop(origin.publisher, None)
        if clock is None:
            while len(self._clocks) >= MOST_PUBLISHERS:
                del self._clocks[next(iter(self._clocks))]
            clock = _Clock(offset_s, origin.sequence - 1, now_s)
        self._clocks[origin.publisher] = clock  # The newest is the last.
        if origin.sequence <= clock.sequence:
            return None
        drifted_s = clock.offset_s + DRIFT * (now_s - clock.at_s)
        clock.offset_s, clock.sequence, clock.at_s = (
            min(offset_s, drifted_s),
            origin.sequence,
            now_s,
        )
        return 1e-9 * origin.source_ns + clock.offset_s


class OnePublisher:
    """Turn of one publisher of `cmd_vel`: twists of others move nothing until it pauses.

    A publisher that was refused has to pause as well, so that a stick that is held on does not
    begin to count.
    """

    def __init__(self) -> None:
        self._publisher, self._moved_s = b"", -math.inf
        self._refused: dict[bytes, float] = {}

    def admits(self, publisher: bytes, moves: bool, now_s: float) -> bool:
        """Note a twist, other than zero if it `moves`; return whether it counts."""
        taken = publisher != self._publisher and now_s - self._moved_s < PAUSE_S
        if not moves:
            return not taken
        recent = {each: at_s for each, at_s in self._refused.items() if now_s - at_s < PAUSE_S}
        if taken or publisher in recent:
            while len(recent) >= MOST_PUBLISHERS:
                del recent[next(iter(recent))]
            self._refused = {**recent, publisher: now_s}
            return False
        self._refused, self._publisher, self._moved_s = recent, publisher, now_s
        return True


def decode_pose_input(payload: bytes, type_name: str, odom: str) -> PoseStamped:
    """Pose in a `geometry_msgs/msg/PoseWithCovarianceStamped`; `odom` is the name of that frame.

    Raises:
        MessageError: it is none, in another frame, or has numbers that are no pose.
    """
    raw = decode_cdr(payload, type_name)
    at, turn = raw.pose.pose.position, raw.pose.pose.orientation
    if raw.header.frame_id not in ("", odom):
        frame = raw.header.frame_id[:100]
        raise MessageError("frame", f"a pose in the frame '{frame}' is ignored: use {odom}")
    numbers = (at.x, at.y, at.z, turn.w, turn.x, turn.y, turn.z)
    if not all(map(math.isfinite, numbers)):
        raise MessageError("nonfinite", "a pose has a number that is not finite: it is ignored")
    if abs(math.hypot(*numbers[3:]) - 1.0) > _UNIT:
        raise MessageError("quaternion", "a pose has no unit quaternion: it is ignored")
    return PoseStamped(ODOM, np.array(numbers[:3]), np.array(numbers[3:]), stamp_ns(raw))
