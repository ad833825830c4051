"""Port to ROS: what an adapter needs of a middleware, for one robot."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from tsd_twin.interop.cmd_vel import TWIST_STAMPED
from tsd_twin.interop.mapping import CMD_VEL, RosMessage, RosNames, RosTopic
from tsd_twin.ros.inputs import Origin

NODE = "tsd_ros"
"""Name of the node of each robot, in the namespace of the robot."""


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
