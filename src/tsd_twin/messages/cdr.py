"""CDR of ROS 2 messages: the only door to rosbags."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from typing import Any

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from tsd_twin.errors import MessageError

_LARGEST = 4096  # Bytes; ours have fewer than 800. What is larger was not meant for us.


def make(type_name: str, **fields: Any) -> Any:
    """Return a ROS 2 message."""
    return _store().types[type_name](**fields)


def header(stamp_ns: int, frame: str) -> Any:
    """Return a `std_msgs/msg/Header`."""
    sec, nanosec = divmod(stamp_ns, 1_000_000_000)
    stamp = make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
    return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def pose(position_m: Iterable[float], wxyz: Iterable[float]) -> Any:
    """Return a `geometry_msgs/msg/Pose`."""
    x, y, z = (float(v) for v in position_m)
    qw, qx, qy, qz = (float(v) for v in wxyz)
    return make(
        "geometry_msgs/msg/Pose",
        position=make("geometry_msgs/msg/Point", x=x, y=y, z=z),
        orientation=make("geometry_msgs/msg/Quaternion", x=qx, y=qy, z=qz, w=qw),
    )


def twist(numbers: Iterable[float]) -> Any:
    """Return a `geometry_msgs/msg/Twist`; `numbers` are (vx, vy, vz, wx, wy, wz)."""
    lx, ly, lz, ax, ay, az = (float(v) for v in numbers)
    vector = "geometry_msgs/msg/Vector3"
    return make(
        "geometry_msgs/msg/Twist",
        linear=make(vector, x=lx, y=ly, z=lz),
        angular=make(vector, x=ax, y=ay, z=az),
    )


def stamp_ns(raw: Any) -> int:
    """Return the time in the header of a message."""
    return raw.header.stamp.sec * 1_000_000_000 + raw.header.stamp.nanosec


def encode(message: Any) -> bytes:
    """Return the CDR of a message."""
    return bytes(_store().serialize_cdr(message, message.__msgtype__))


def decode(payload: bytes, type_name: str) -> Any:
    """Return the message in a CDR payload.

    Raises:
        MessageError: `shape`, when there is none of this type in it.
    """
    if len(payload) > _LARGEST:
        raise MessageError("shape", f"{len(payload)} bytes are too many for a {type_name}")
    try:
        return _store().deserialize_cdr(payload, type_name)
    except SerdeError as error:
        raise MessageError("shape", f"not a {type_name}: {error}") from error


@functools.cache
def _store() -> Any:
    """Return the type store; made at first use, since it takes a tenth of a second."""
    return get_typestore(Stores.ROS2_JAZZY)
