"""Interface between adapters and ROS middleware, and pose validation (pure)."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tsd_twin.adapters.cmd_vel import TWIST_STAMPED
from tsd_twin.adapters.ros.arrivals import Origin
from tsd_twin.adapters.ros_messages import RosMessage
from tsd_twin.adapters.ros_topics import CMD_VEL, PUBLISHED, READ, SERVICES, RosNames, RosTopic
from tsd_twin.messages.cdr import ODOM
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.pose import PoseStamped
from tsd_twin.messages.ros_types import decode_cdr, stamp_ns

NODE = "tsd_ros"
"""Node name of each robot, in its namespace."""


@dataclass(frozen=True, slots=True)
class Endpoints:
    """Node name, topics and services."""

    node: str
    published: tuple[RosTopic, ...]
    read: tuple[RosTopic, ...]
    services: tuple[str, ...] = ()


ADAPTER = Endpoints(NODE, PUBLISHED, READ, SERVICES)
"""Endpoints of a bus robot shown as a ROS node."""


@dataclass(frozen=True, slots=True)
class Received:
    """Received message of a topic."""

    row: RosTopic
    type_name: str
    payload: bytes
    origin: Origin
    arrived_s: float


class Inbox:
    """Separate bounded queue per topic, so that no topic replaces messages of another."""

    def __init__(self, sizes: Mapping[RosTopic, int]) -> None:
        self._waiting = {row.name: deque[Received](maxlen=size) for row, size in sizes.items()}

    def put(self, received: Received) -> None:
        """Add a message, dropping the oldest one of its topic if the queue is full."""
        self._waiting[received.row.name].append(received)

    def take(self, rows: Iterable[RosTopic]) -> list[Received]:
        """Remove and return the messages of these topics, one topic after the other."""
        queues = [self._waiting[row.name] for row in rows]
        return [queue.popleft() for queue in queues for _ in range(len(queue))]


class PortCallbacks(Protocol):
    """Receiver of ROS messages and calls, called on middleware threads."""

    def on_message(self, row: RosTopic, type_name: str, payload: bytes, origin: Origin) -> None:
        """Handle a message of a subscribed topic."""
        ...

    def on_unreadable(self, name: str, reason: str) -> None:
        """Handle an invalid message or request."""
        ...

    def on_call(self, service: str, answer: Callable[[bool, str], None]) -> None:
        """Handle a service call; call `answer` once, on any thread."""
        ...


class RosPort(Protocol):
    """Node for a robot with all its topics and services."""

    def wants(self, topic: str) -> bool:
        """Return whether a topic has a subscriber."""
        ...

    def publish(self, message: RosMessage) -> None:
        """Publish a message; not thread-safe."""
        ...

    def publishers(self, topic: str) -> list[str]:
        """Return the names of other nodes publishing `odom`, one per publisher."""
        ...

    def subscribers(self, topic: str) -> list[str]:
        """Return the names of other nodes reading `cmd_vel`, one per subscriber."""
        ...

    def close(self) -> None:
        """Leave the graph."""
        ...


OpenPort = Callable[[RosNames, PortCallbacks | None], RosPort]
"""Opens the port of a robot; without inputs it is read-only. May raise TwinError."""


def types_of(row: RosTopic) -> tuple[str, ...]:
    """Return the accepted message types of a topic."""
    return (row.type, TWIST_STAMPED) if row is CMD_VEL else (row.type,)


UNKNOWN_PUBLISHER = b""
"""Publisher id of messages where the middleware does not identify one of several."""
_UNIT = 0.01
"""Tolerance on the length of a quaternion."""


def decode_pose_input(payload: bytes, type_name: str, odom: str) -> PoseStamped:
    """Decode a `geometry_msgs/msg/PoseWithCovarianceStamped` in the frame named `odom`.

    Raises:
        MessageError: If the message is invalid, in another frame or not a pose.
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
