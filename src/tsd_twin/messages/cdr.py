"""ROS 2 messages on the bus: TwistStamped, JointState, Odometry, and their CDR encoding."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tsd_twin.lie import SE2, SO3, Array, wrap
from tsd_twin.messages.cdr_codec import CdrReader, CdrWriter
from tsd_twin.messages.errors import MessageError

_COMMANDS_KEPT = 16
"""Cache size for encoded commands, above the number sent concurrently."""

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
    cdr = CdrWriter()
    cdr.header(stamp_ns, frame)
    cdr.doubles(np.frombuffer(twist))
    return cdr.payload()


def decode_twist(payload: bytes) -> TwistStamped:
    """Decode a twist from CDR; values may be NaN.

    Raises:
        MessageError: If it is not a `geometry_msgs/msg/TwistStamped` (`shape`).
    """
    cdr = CdrReader(payload, "geometry_msgs/msg/TwistStamped")
    stamp_ns, frame = cdr.header()
    twist = cdr.doubles(6)
    cdr.end()
    return TwistStamped(frame, twist, stamp_ns)


def encode_joints(message: JointState) -> bytes:
    """Encode a `sensor_msgs/msg/JointState` as CDR."""
    cdr = CdrWriter()
    cdr.header(message.stamp_ns, BASE)
    cdr.texts(message.names)
    cdr.double_sequence(message.position_rad)
    cdr.double_sequence(message.velocity_rad_per_s)
    cdr.double_sequence(np.empty(0))  # Effort.
    return cdr.payload()


def decode_joints(payload: bytes) -> JointState:
    """Decode joints from CDR.

    Raises:
        MessageError: If it is not a `sensor_msgs/msg/JointState` (`shape`).
    """
    cdr = CdrReader(payload, "sensor_msgs/msg/JointState")
    stamp_ns, _ = cdr.header()
    names, position, velocity = cdr.texts(), cdr.double_sequence(), cdr.double_sequence()
    cdr.double_sequence()  # Effort.
    cdr.end()
    if not len(names) == len(position) == len(velocity):
        raise MessageError("shape", "names, positions and velocities differ in number")
    return JointState(names, position, velocity, stamp_ns)


def wrapped_heading(xy_heading: Array) -> Array:
    """Wrap the heading of (x, y, heading) to (-pi, pi], the range used on every interface."""
    return np.array([xy_heading[0], xy_heading[1], wrap(xy_heading[2])])


def encode_odometry(message: Odometry) -> bytes:
    """Encode a `nav_msgs/msg/Odometry` as CDR."""
    x, y, heading = (float(v) for v in message.xy_heading)
    if message.wxyz is None:
        rows, w, xyz = PLANAR, math.cos(heading / 2.0), [0.0, 0.0, math.sin(heading / 2.0)]
    else:
        rows, (w, *xyz) = TURNING, message.wxyz.tolist()
    spatial = [0.0] * 6
    for row, value in zip(rows, message.twist, strict=True):
        spatial[row] = float(value)
    cdr = CdrWriter()
    cdr.header(message.stamp_ns, ODOM)
    cdr.text(BASE)
    cdr.doubles([x, y, 0.0, *xyz, w])
    cdr.doubles(_spatial(message.pose_covariance, rows))
    cdr.doubles(spatial)
    cdr.doubles(_spatial(message.twist_covariance, rows))
    return cdr.payload()


def decode_odometry(payload: bytes, *, turning: bool = False) -> Odometry:
    """Decode planar odometry from CDR, with the heading in (-pi, pi].

    With `turning`, decode the orientation and angular velocity of a sphere.

    Raises:
        MessageError: If it is not a `nav_msgs/msg/Odometry` (`shape`).
    """
    cdr = CdrReader(payload, "nav_msgs/msg/Odometry")
    stamp_ns, _ = cdr.header()
    cdr.text()  # Frame of the twist.
    pose, pose_covariance = cdr.doubles(7), cdr.doubles(36)
    twist, twist_covariance = cdr.doubles(6), cdr.doubles(36)
    cdr.end()
    x, y, _, qx, qy, qz, qw = pose.tolist()
    block = _TURNING_BLOCK if turning else _PLANAR_BLOCK
    return Odometry(
        xy_heading=wrapped_heading(np.array([x, y, 2.0 * math.atan2(qz, qw)])),
        twist=twist[list(TURNING if turning else PLANAR)],
        pose_covariance=pose_covariance.reshape(6, 6)[block],
        twist_covariance=twist_covariance.reshape(6, 6)[block],
        stamp_ns=stamp_ns,
        wxyz=np.array([qw, qx, qy, qz]) if turning else None,
    )


def _spatial(covariance: Array, rows: tuple[int, int, int]) -> Array:
    """Embed a (3, 3) covariance in a row-major (36,) spatial one."""
    spatial = np.zeros((6, 6))
    spatial[np.ix_(rows, rows)] = covariance
    return spatial.reshape(36)
