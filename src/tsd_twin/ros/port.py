"""Port to ROS: interface of an adapter to a middleware, and checks of poses. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tsd_twin.errors import MessageError
from tsd_twin.interop.cmd_vel import TWIST_STAMPED
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
from tsd_twin.messages.ros import ODOM
from tsd_twin.messages.ros_types import decode_cdr, stamp_ns
from tsd_twin.ros.arrivals import Origin

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

    def on_unreadable(self, name: str, reason: str) -> None:
        """Note a message of a topic or a service that cannot be read."""
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

    def publishers(self, topic: str) -> list[str]:
        """Return the names of the other nodes that publish `odom`, one for each publisher."""
        ...

    def subscribers(self, topic: str) -> list[str]:
        """Return the names of the other nodes that read `cmd_vel`, one for each subscriber."""
        ...

    def close(self) -> None:
        """Leave the graph."""
        ...


OpenPort = Callable[[RosNames, Inputs | None], RosPort]
"""Opens the port of a robot; without inputs, nothing can be driven. May raise a TwinError."""


def types_of(row: RosTopic) -> tuple[str, ...]:
    """Return the types that are read on a topic."""
    return (row.type, TWIST_STAMPED) if row is CMD_VEL else (row.type,)


UNTOLD = b""
"""Publisher of a message where the middleware does not say which one of several it was."""
_UNIT = 0.01
"""How far the length of a quaternion may be from one."""


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
