"""ROS 2 message types for adapters and recordings: definitions, hashes, arbitrary messages.

Only this module imports rosbags, which clients do not need.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from tsd_twin.messages.cdr_codec import LARGEST
from tsd_twin.messages.errors import MessageError


def make_message(type_name: str, **fields: Any) -> Any:
    """Create a ROS 2 message."""
    return _store().types[type_name](**fields)


def make_header(stamp_ns: int, frame: str) -> Any:
    """Create a `std_msgs/msg/Header`."""
    sec, nanosec = divmod(stamp_ns, 1_000_000_000)
    stamp = make_message("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
    return make_message("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


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
    """Encode a message as CDR."""
    return bytes(_store().serialize_cdr(message, message.__msgtype__))


def decode_cdr(payload: bytes, type_name: str, largest: int = LARGEST) -> Any:
    """Decode a CDR payload of at most `largest` bytes.

    Raises:
        MessageError: If it is not a message of this type (`shape`).
    """
    if len(payload) > largest:
        raise MessageError("shape", f"{len(payload)} bytes are too many for a {type_name}")
    try:
        return _store().deserialize_cdr(payload, type_name)
    except SerdeError as error:
        raise MessageError("shape", f"not a {type_name}: {error}") from error


def definition(type_name: str) -> str:
    """Return the `ros2msg` definition of a ROS 2 type, including nested types.

    Raises:
        KeyError: If the type does not exist.
    """
    return _store().generate_msgdef(type_name, ros_version=2)[0]


TRIGGER = "std_srvs/srv/Trigger"
"""Type of a robot's ROS services."""


@functools.cache
def type_hash(type_name: str) -> str:
    """Return the REP 2011 type hash of a ROS 2 type: `RIHS01_` and 64 digits.

    Raises:
        KeyError: If the type does not exist.
    """
    return (_services() if "/srv/" in type_name else _store()).hash_rihs01(type_name)


def encode_trigger_response(success: bool, message: str) -> bytes:
    """Encode a `std_srvs/srv/Trigger` response as CDR."""
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
