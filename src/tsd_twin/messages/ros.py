"""CDR encoding of the ROS 2 messages on the bus: TwistStamped, JointState, Odometry.

The only module that imports rosbags.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from tsd_twin.errors import MessageError
from tsd_twin.lie import SE2, SO3, Array, wrap

_LARGEST = 4096  # Bytes; messages of this project have fewer than 800.
_COMMANDS_KEPT = 16
"""Commands whose encoding is kept: more than one process sends at a time."""


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


def decode_cdr(payload: bytes, type_name: str, largest: int = _LARGEST) -> Any:
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


BASE = "base_link"
"""Frame of the robot: X forward, Y left, Z up, at the height of the wheel centres."""
ODOM = "odom"
"""World frame of the estimate: its origin is where the pose was last set to zero."""

PLANAR = (0, 1, 5)
"""Indices of (vx, vy, omega) in a spatial twist (vx, vy, vz, wx, wy, wz)."""
TURNING = (3, 4, 5)
"""Indices of (wx, wy, wz) of a sphere in a spatial twist."""
_PLANAR_BLOCK, _TURNING_BLOCK = np.ix_(PLANAR, PLANAR), np.ix_(TURNING, TURNING)


@dataclass(frozen=True, slots=True, eq=False)
class TwistStamped:
    """A spatial twist: `twist` (6,) = (vx, vy, vz, wx, wy, wz), m/s and rad/s in `frame`."""

    frame: str
    twist: Array
    stamp_ns: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class JointState:
    """Angles and speeds of joints, (n,) each, rad and rad/s; NaN where there is no such value."""

    names: Sequence[str]
    position_rad: Array
    velocity_rad_per_s: Array
    stamp_ns: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Odometry:
    """A pose in `odom` and a twist in `base_link`, with covariances.

    Planar, unless `wxyz` is given: then it is the orientation of a sphere that turns in place, the
    twist its angular velocity, and position and heading mean nothing.
    """

    xy_heading: Array
    """(3,): metres and radians; as decoded from the bus, the heading is in (-pi, pi]."""
    twist: Array
    """(3,): vx, vy, omega; of a sphere wx, wy, wz."""
    pose_covariance: Array
    """(3, 3): of x, y, heading, axes of `odom`; of a sphere of small turns about those axes."""
    twist_covariance: Array
    """(3, 3)."""
    stamp_ns: int = 0
    wxyz: Array | None = None
    """(4,): unit quaternion."""

    @staticmethod
    def of(
        pose: SE2 | SO3,
        twist: Array,
        pose_covariance: Array,
        twist_covariance: Array,
        stamp_ns: int = 0,
    ) -> Odometry:
        """Message for a planar pose or an orientation."""
        xy_heading, wxyz = (
            (pose.xy_heading, None) if isinstance(pose, SE2) else (np.zeros(3), pose.wxyz)
        )
        return Odometry(xy_heading, twist, pose_covariance, twist_covariance, stamp_ns, wxyz)

    def wrapped(self) -> Odometry:
        """Return this message with its heading in (-pi, pi], as it is decoded from the bus."""
        return replace(self, xy_heading=wrapped_heading(self.xy_heading))


def encode_twist(message: TwistStamped) -> bytes:
    """The CDR of a `geometry_msgs/msg/TwistStamped`."""
    return _twist_cdr(message.frame, np.asarray(message.twist, float).tobytes(), message.stamp_ns)


@functools.lru_cache(maxsize=_COMMANDS_KEPT)
def _twist_cdr(frame: str, twist: bytes, stamp_ns: int) -> bytes:
    # A motion repeats its command at 50 Hz.
    header = make_header(stamp_ns, frame)
    numbers = make_twist(np.frombuffer(twist))
    return encode_cdr(make_message("geometry_msgs/msg/TwistStamped", header=header, twist=numbers))


def decode_twist(payload: bytes) -> TwistStamped:
    """Twist in a CDR payload; numbers may be anything, also NaN.

    Raises:
        MessageError: `shape`, when this is no `geometry_msgs/msg/TwistStamped`.
    """
    raw = decode_cdr(payload, "geometry_msgs/msg/TwistStamped")
    linear, angular = raw.twist.linear, raw.twist.angular
    return TwistStamped(
        frame=raw.header.frame_id,
        twist=np.array([linear.x, linear.y, linear.z, angular.x, angular.y, angular.z]),
        stamp_ns=stamp_ns(raw),
    )


def encode_joints(message: JointState) -> bytes:
    """CDR of a `sensor_msgs/msg/JointState`."""
    return encode_cdr(
        make_message(
            "sensor_msgs/msg/JointState",
            header=make_header(message.stamp_ns, BASE),
            name=list(message.names),
            position=np.asarray(message.position_rad, dtype=np.float64),
            velocity=np.asarray(message.velocity_rad_per_s, dtype=np.float64),
            effort=np.empty(0),
        )
    )


def decode_joints(payload: bytes) -> JointState:
    """Joints in a CDR payload.

    Raises:
        MessageError: `shape`, when this is no `sensor_msgs/msg/JointState`.
    """
    raw = decode_cdr(payload, "sensor_msgs/msg/JointState")
    if not len(raw.name) == len(raw.position) == len(raw.velocity):
        raise MessageError("shape", "names, positions and velocities differ in number")
    return JointState(tuple(raw.name), raw.position.copy(), raw.velocity.copy(), stamp_ns(raw))


def wrapped_heading(xy_heading: Array) -> Array:
    """Return (x, y, heading) with the heading in (-pi, pi], the range on every interface."""
    return np.array([xy_heading[0], xy_heading[1], wrap(xy_heading[2])])


def encode_odometry(message: Odometry) -> bytes:
    """CDR of a `nav_msgs/msg/Odometry`."""
    x, y, heading = (float(v) for v in message.xy_heading)
    if message.wxyz is None:
        rows = PLANAR
        quaternion = (math.cos(heading / 2.0), 0.0, 0.0, math.sin(heading / 2.0))
    else:
        rows, quaternion = TURNING, message.wxyz
    spatial = [0.0] * 6
    for row, value in zip(rows, message.twist, strict=True):
        spatial[row] = float(value)
    return encode_cdr(
        make_message(
            "nav_msgs/msg/Odometry",
            header=make_header(message.stamp_ns, ODOM),
            child_frame_id=BASE,
            pose=make_message(
                "geometry_msgs/msg/PoseWithCovariance",
                pose=make_pose((x, y, 0.0), quaternion),
                covariance=_spatial(message.pose_covariance, rows),
            ),
            twist=make_message(
                "geometry_msgs/msg/TwistWithCovariance",
                twist=make_twist(spatial),
                covariance=_spatial(message.twist_covariance, rows),
            ),
        )
    )


def decode_odometry(payload: bytes, *, turning: bool = False) -> Odometry:
    """Planar part of the odometry in a CDR payload; heading in (-pi, pi].

    With `turning`, return the orientation and the angular velocity of a sphere.

    Raises:
        MessageError: `shape`, when this is no `nav_msgs/msg/Odometry`.
    """
    raw = decode_cdr(payload, "nav_msgs/msg/Odometry")
    position, turn = raw.pose.pose.position, raw.pose.pose.orientation
    linear, angular = raw.twist.twist.linear, raw.twist.twist.angular
    rows = _TURNING_BLOCK if turning else _PLANAR_BLOCK
    twist = [angular.x, angular.y, angular.z] if turning else [linear.x, linear.y, angular.z]
    return Odometry(
        xy_heading=wrapped_heading(
            np.array([position.x, position.y, 2.0 * math.atan2(turn.z, turn.w)])
        ),
        twist=np.array(twist),
        pose_covariance=raw.pose.covariance.reshape(6, 6)[rows],
        twist_covariance=raw.twist.covariance.reshape(6, 6)[rows],
        stamp_ns=stamp_ns(raw),
        wxyz=np.array([turn.w, turn.x, turn.y, turn.z]) if turning else None,
    )


@functools.cache
def warm_up() -> None:
    """Make type store and codecs of all messages, which their first use would wait 0.1 s for."""
    three, square = np.zeros(3), np.zeros((3, 3))
    decode_twist(encode_twist(TwistStamped(BASE, np.zeros(6))))
    decode_joints(encode_joints(JointState(("joint",), np.zeros(1), np.zeros(1))))
    decode_odometry(encode_odometry(Odometry(three, three, square, square)))


def _spatial(covariance: Array, rows: tuple[int, int, int]) -> Array:
    """Row-major (36,) spatial covariance of a (3, 3) one."""
    spatial = np.zeros((6, 6))
    spatial[np.ix_(rows, rows)] = covariance
    return spatial.reshape(36)
