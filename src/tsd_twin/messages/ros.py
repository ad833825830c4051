"""CDR encoding of ROS 2 messages on the bus: TwistStamped, JointState, Odometry.

Only this module imports rosbags.
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

_LARGEST = 4096  # Bytes; our messages have fewer than 800.
_COMMANDS_KEPT = 16
"""Cache size for encoded commands, above the number sent concurrently."""


def make_message(type_name: str, **fields: Any) -> Any:
    """Create a ROS 2 message."""
    return _store().types[type_name](**fields)


def make_header(stamp_ns: int, frame: str) -> Any:
    """Create a `std_msgs/msg/Header`."""
    sec, nanosec = divmod(stamp_ns, 1_000_000_000)
    stamp = make_message("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
    return make_message("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def make_pose(position_m: Iterable[float], wxyz: Iterable[float]) -> Any:
    """Create a `geometry_msgs/msg/Pose`."""
    x, y, z = (float(v) for v in position_m)
    qw, qx, qy, qz = (float(v) for v in wxyz)
    return make_message(
        "geometry_msgs/msg/Pose",
        position=make_message("geometry_msgs/msg/Point", x=x, y=y, z=z),
        orientation=make_message("geometry_msgs/msg/Quaternion", x=qx, y=qy, z=qz, w=qw),
    )


def make_twist(numbers: Iterable[float]) -> Any:
    """Create a `geometry_msgs/msg/Twist` from (vx, vy, vz, wx, wy, wz)."""
    lx, ly, lz, ax, ay, az = (float(v) for v in numbers)
    vector = "geometry_msgs/msg/Vector3"
    return make_message(
        "geometry_msgs/msg/Twist",
        linear=make_message(vector, x=lx, y=ly, z=lz),
        angular=make_message(vector, x=ax, y=ay, z=az),
    )


def stamp_ns(raw: Any) -> int:
    """Return the header stamp of a message in nanoseconds."""
    return raw.header.stamp.sec * 1_000_000_000 + raw.header.stamp.nanosec


def encode_cdr(message: Any) -> bytes:
    """Encode a message as CDR."""
    return bytes(_store().serialize_cdr(message, message.__msgtype__))


def decode_cdr(payload: bytes, type_name: str, largest: int = _LARGEST) -> Any:
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
    """Return a type store for `Trigger`, because rosbags does not define services."""

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
    gid = (Nodetype.ARRAY, (base("uint8"), 16))  # rosbags uses `char`, which changes the hash.
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
    """Return the type store; created lazily because it takes 0.1 s."""
    return get_typestore(Stores.ROS2_JAZZY)


BASE = "base_link"
"""Robot frame: X forward, Y left, Z up, at the height of the wheel centres."""
ODOM = "odom"
"""World frame of the estimate, with its origin where the pose was last set to zero."""

PLANAR = (0, 1, 5)
"""Indices of (vx, vy, omega) in a spatial twist (vx, vy, vz, wx, wy, wz)."""
TURNING = (3, 4, 5)
"""Indices of (wx, wy, wz) of a sphere in a spatial twist."""
_PLANAR_BLOCK, _TURNING_BLOCK = np.ix_(PLANAR, PLANAR), np.ix_(TURNING, TURNING)


@dataclass(frozen=True, slots=True, eq=False)
class TwistStamped:
    """Spatial twist (6,): (vx, vy, vz, wx, wy, wz), m/s and rad/s in `frame`."""

    frame: str
    twist: Array
    stamp_ns: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class JointState:
    """Joint angles and speeds, (n,) each, rad and rad/s; NaN where not applicable."""

    names: Sequence[str]
    position_rad: Array
    velocity_rad_per_s: Array
    stamp_ns: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Odometry:
    """Pose in `odom` and twist in `base_link`, with covariances.

    Planar unless `wxyz` is set. `wxyz` is the orientation of a sphere that turns in place; the
    twist is then its angular velocity, and position and heading are unused.
    """

    xy_heading: Array
    """(3,): metres and radians; the heading is in (-pi, pi] when decoded from the bus."""
    twist: Array
    """(3,): vx, vy, omega, or wx, wy, wz for a sphere."""
    pose_covariance: Array
    """(3, 3): x, y, heading in `odom`, or small rotations about its axes for a sphere."""
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
        """Create a message from a planar pose or an orientation."""
        xy_heading, wxyz = (
            (pose.xy_heading, None) if isinstance(pose, SE2) else (np.zeros(3), pose.wxyz)
        )
        return Odometry(xy_heading, twist, pose_covariance, twist_covariance, stamp_ns, wxyz)

    def wrapped(self) -> Odometry:
        """Return the message with its heading in (-pi, pi], as when decoded from the bus."""
        return replace(self, xy_heading=wrapped_heading(self.xy_heading))


def encode_twist(message: TwistStamped) -> bytes:
    """Encode a `geometry_msgs/msg/TwistStamped` as CDR."""
    return _twist_cdr(message.frame, np.asarray(message.twist, float).tobytes(), message.stamp_ns)


@functools.lru_cache(maxsize=_COMMANDS_KEPT)
def _twist_cdr(frame: str, twist: bytes, stamp_ns: int) -> bytes:
    # Cached, because motions repeat their command at 50 Hz.
    header = make_header(stamp_ns, frame)
    numbers = make_twist(np.frombuffer(twist))
    return encode_cdr(make_message("geometry_msgs/msg/TwistStamped", header=header, twist=numbers))


def decode_twist(payload: bytes) -> TwistStamped:
    """Decode a twist from CDR; values may be NaN.

    Raises:
        MessageError: If it is not a `geometry_msgs/msg/TwistStamped` (`shape`).
    """
    raw = decode_cdr(payload, "geometry_msgs/msg/TwistStamped")
    linear, angular = raw.twist.linear, raw.twist.angular
    return TwistStamped(
        frame=raw.header.frame_id,
        twist=np.array([linear.x, linear.y, linear.z, angular.x, angular.y, angular.z]),
        stamp_ns=stamp_ns(raw),
    )


def encode_joints(message: JointState) -> bytes:
    """Encode a `sensor_msgs/msg/JointState` as CDR."""
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
    """Decode joints from CDR.

    Raises:
        MessageError: If it is not a `sensor_msgs/msg/JointState` (`shape`).
    """
    raw = decode_cdr(payload, "sensor_msgs/msg/JointState")
    if not len(raw.name) == len(raw.position) == len(raw.velocity):
        raise MessageError("shape", "names, positions and velocities differ in number")
    return JointState(tuple(raw.name), raw.position.copy(), raw.velocity.copy(), stamp_ns(raw))


def wrapped_heading(xy_heading: Array) -> Array:
    """Wrap the heading of (x, y, heading) to (-pi, pi], the range used on every interface."""
    return np.array([xy_heading[0], xy_heading[1], wrap(xy_heading[2])])


def encode_odometry(message: Odometry) -> bytes:
    """Encode a `nav_msgs/msg/Odometry` as CDR."""
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
    """Decode planar odometry from CDR, with the heading in (-pi, pi].

    With `turning`, decode the orientation and angular velocity of a sphere.

    Raises:
        MessageError: If it is not a `nav_msgs/msg/Odometry` (`shape`).
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
    """Create the type store and all codecs; otherwise the first use takes 0.1 s."""
    three, square = np.zeros(3), np.zeros((3, 3))
    decode_twist(encode_twist(TwistStamped(BASE, np.zeros(6))))
    decode_joints(encode_joints(JointState(("joint",), np.zeros(1), np.zeros(1))))
    decode_odometry(encode_odometry(Odometry(three, three, square, square)))


def _spatial(covariance: Array, rows: tuple[int, int, int]) -> Array:
    """Embed a (3, 3) covariance in a row-major (36,) spatial one."""
    spatial = np.zeros((6, 6))
    spatial[np.ix_(rows, rows)] = covariance
    return spatial.reshape(36)
