"""Bus topics and services: keys, rates and quality of service."""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass
from enum import StrEnum

from tsd_twin.errors import BusError

_NAME = re.compile(r"[a-z0-9_-]{1,32}")
_RECORDING = "recording-"
"""Instance name prefix of replays."""


class QoS(StrEnum):
    """Quality of service: priority, batching, congestion control and history."""

    REAL_TIME = "real_time"
    """Highest priority, never batched, dropped on congestion."""
    DATA = "data"
    """Dropped on congestion."""
    EVENT = "event"
    """Kept in a history for late joiners."""
    LOG = "log"
    """Lowest priority, for recorders and pictures, so that it does not delay other topics."""


@dataclass(frozen=True, slots=True)
class Sample:
    """Unvalidated bus sample: key, payload and attachment."""

    key: str
    payload: bytes
    attachment: bytes
    is_put: bool = True


@dataclass(frozen=True, slots=True)
class Topic:
    """Topic table row: a stream from or to a robot."""

    path: str
    """Key below `twin/<robot>/`."""
    type: str
    """ROS 2 type of the CDR payload, `json`, or `msgpack`."""
    qos: QoS
    rate_hz: float
    """Rate in Hz while publishing."""

    def key(self, robot: str) -> str:
        """Return the key of this topic for a robot id, or `*` for all robots."""
        return f"twin/{robot if robot == '*' else checked(robot)}/{self.path}"


TWIST = Topic("cmd/*/twist", "geometry_msgs/msg/TwistStamped", QoS.REAL_TIME, 50.0)
STOP = Topic("stop", "json", QoS.REAL_TIME, 10.0)
SENSOR_POSE = Topic("sensor/pose", "geometry_msgs/msg/PoseStamped", QoS.DATA, 24.0)
JOINTS = Topic("state/joints", "sensor_msgs/msg/JointState", QoS.DATA, 50.0)
SETPOINT = Topic("state/setpoint", "sensor_msgs/msg/JointState", QoS.DATA, 50.0)
ODOM = Topic("state/odom", "nav_msgs/msg/Odometry", QoS.DATA, 50.0)
ODOM_ALTERNATIVE = Topic("state/odom_alternative", "nav_msgs/msg/Odometry", QoS.DATA, 50.0)
TRUTH = Topic("state/truth", "nav_msgs/msg/Odometry", QoS.DATA, 50.0)
STATUS = Topic("state/status", "json", QoS.DATA, 20.0)
SUMMARY = Topic("state/summary", "msgpack", QoS.DATA, 2.0)
EVENT = Topic("event/*", "json", QoS.EVENT, 5.0)
INPUTS = Topic("log/inputs", "msgpack", QoS.LOG, 5.0)

TOPICS = (
    TWIST,
    STOP,
    SENSOR_POSE,
    JOINTS,
    SETPOINT,
    ODOM,
    ODOM_ALTERNATIVE,
    TRUTH,
    STATUS,
    SUMMARY,
    EVENT,
    INPUTS,
)


class Service(StrEnum):
    """Services of a robot with JSON replies, below `twin/<robot>/`."""

    LEASE = "srv/lease"
    ARM = "srv/arm"
    DISARM = "srv/disarm"
    RESET = "srv/reset"
    SET_POSE = "srv/set_pose"
    SPEED = "srv/speed"
    STOP = "stop"
    DESC = "desc"

    def key(self, robot: str) -> str:
        """Return the key of this service for a robot id."""
        return f"twin/{checked(robot)}/{self.value}"


def checked(name: str) -> str:
    """Validate a robot or operator id for use in a key, and return it.

    Raises:
        BusError: If it does not match `[a-z0-9_-]{1,32}`.
    """
    if not _NAME.fullmatch(name):
        raise BusError(f"'{name}' cannot be an id: 1 to 32 of a-z, 0-9, _ and - are allowed")
    return name


@functools.lru_cache(maxsize=64)
def twist_key(robot: str, operator: str) -> str:
    """Return the key of velocity commands from `operator` to `robot`."""
    return TWIST.key(robot).replace("*", checked(operator))


def event_key(robot: str, kind: str) -> str:
    """Return the key of an event kind."""
    return EVENT.key(robot).replace("*", checked(kind))


def alive_key(robot: str) -> str:
    """Return the key of a robot's liveliness token, or `*` for all robots."""
    return f"twin/{robot if robot == '*' else checked(robot)}/alive"


def instance_key(robot: str, instance: str) -> str:
    """Return the key of a running node's liveliness token, or `*` for all."""
    name = robot if robot == "*" else checked(robot)
    return f"twin/{name}/instance/{instance if instance == '*' else checked(instance)}"


def recording_key(robot: str, instance: str) -> str:
    """Return the key of a replay's liveliness token."""
    return instance_key(robot, f"{_RECORDING}{instance}")


def is_recording_key(key: str) -> bool:
    """Return whether an instance key belongs to a replay."""
    return key.rsplit("/", 1)[-1].startswith(_RECORDING)


def robot_of(key: str) -> str:
    """Return the robot id in a key.

    Raises:
        BusError: If the key is not below `twin/<robot>/`.
    """
    parts = key.split("/")
    if len(parts) < 3 or parts[0] != "twin":
        raise BusError(f"'{key}' is not below twin/<robot>/")
    return checked(parts[1])
