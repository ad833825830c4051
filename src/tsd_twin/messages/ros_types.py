"""ROS 2 message types of adapters and recordings: definitions, hashes, messages of any type.

The only module that imports rosbags, which a client does not need.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from tsd_twin.errors import MessageError
from tsd_twin.messages.cdr_codec import LARGEST


def make_message(type_name: str, **fields: Any) -> Any:
    """ROS 2 message."""
    return _store().types[type_name](**fields)


def make_header(stamp_ns: int, frame: str) -> Any:
    """Return a `std_msgs/msg/Header`."""
    sec, nanosec = divmod(stamp_ns, 1_000_000_000)
    stamp = make_message("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
    return make_message("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def make_pose(position_m: Iterable[float], wxyz: Iterable[float]) -> Any:
    """Return a `geometry_msgs/msg/Pose`."""
    x, y, z = (float(v) for v in position_m)
    qw, qx, qy, qz = (float(v) for v in wxyz)
    return make_message(
        "geometry_msgs/msg/Pose",
        position=make_message("geometry_msgs/msg/Point", x=x, y=y, z=z),
        orientation=make_message("geometry_msgs/msg/Quaternion", x=qx, y=qy, z=qz, w=qw),
    )


def make_twist(numbers: Iterable[float]) -> Any:
    """Return a `geometry_msgs/msg/Twist`; `numbers` are (vx, vy, vz, wx, wy, wz)."""
    lx, ly, lz, ax, ay, az = (float(v) for v in numbers)
    vector = "geometry_msgs/msg/Vector3"
    return make_message(
        "geometry_msgs/msg/Twist",
        linear=make_message(vector, x=lx, y=ly, z=lz),
        angular=make_message(vector, x=ax, y=ay, z=az),
    )


def stamp_ns(raw: Any) -> int:
    """Time in the header of a message."""
    return raw.header.stamp.sec * 1_000_000_000 + raw.header.stamp.nanosec


def encode_cdr(message: Any) -> bytes:
    """CDR of a message."""
    return bytes(_store().serialize_cdr(message, message.__msgtype__))


def decode_cdr(payload: bytes, type_name: str, largest: int = LARGEST) -> Any:
    """Message in a CDR payload of at most `largest` bytes.

    Raises:
        MessageError: `shape`, when there is none of this type in it.
    """
    if len(payload) > largest:
        raise MessageError("shape", f"{len(payload)} bytes are too many for a {type_name}")
    try:
        return _store().deserialize_cdr(payload, type_name)
    except SerdeError as error:
        raise MessageError("shape", f"not a {type_name}: {error}") from error


def definition(type_name: str) -> str:
    """Return the definition of a ROS 2 type, with those of all types in it, as `ros2msg`.

    Raises:
        KeyError: there is no such type.
    """
    return _store().generate_msgdef(type_name, ros_version=2)[0]


TRIGGER = "std_srvs/srv/Trigger"
"""Type of the services of a robot in ROS."""


@functools.cache
def type_hash(type_name: str) -> str:
    """Return the hash of the definition of a ROS 2 type by REP 2011, `RIHS01_` and 64 digits.

    Raises:
        KeyError: there is no such type.
    """
    return (_services() if "/srv/" in type_name else _store()).hash_rihs01(type_name)


def encode_trigger_response(success: bool, message: str) -> bytes:
    """CDR of a response of `std_srvs/srv/Trigger`."""
    name = f"{TRIGGER}_Response"
    response = _services().types[name](success=success, message=message)
    return bytes(_services().serialize_cdr(response, name))


@functools.cache
def _services() -> Any:
    """Type store of `Trigger`: rosbags has no definitions of services."""

    def named(name: str) -> Any:
        return Nodetype.NAME, name

    def base(name: str) -> Any:
        return Nodetype.BASE, (name, 0)

    made: Any = get_typestore(Stores.EMPTY)
    info, request, response = (
        "service_msgs/msg/ServiceEventInfo",
        f"{TRIGGER}_Request",
        f"{TRIGGER}_Response",
    )
    time = "builtin_interfaces/msg/Time"
    gid = (Nodetype.ARRAY, (base("uint8"), 16))  # rosbags has it as `char`, another hash.
    fields: dict[str, list[tuple[str, Any]]] = {
        time: [("sec", base("int32")), ("nanosec", base("uint32"))],
        info: [
            ("event_type", base("uint8")),
            ("stamp", named(time)),
            ("client_gid", gid),
            ("sequence_number", base("int64")),
        ],
        request: [],
        response: [("success", base("bool")), ("message", base("string"))],
        f"{TRIGGER}_Event": [
            ("info", named(info)),
            ("request", (Nodetype.SEQUENCE, (named(request), 1))),
            ("response", (Nodetype.SEQUENCE, (named(response), 1))),
        ],
        TRIGGER: [
            ("request_message", named(request)),
            ("response_message", named(response)),
            ("event_message", named(f"{TRIGGER}_Event")),
        ],
    }
    made.register({name: ([], members) for name, members in fields.items()})
    return made


@functools.cache
def _store() -> Any:
    """Type store; made at first use, since it takes a tenth of a second."""
    return get_typestore(Stores.ROS2_JAZZY)
