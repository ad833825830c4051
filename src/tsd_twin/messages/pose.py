"""Pose messages: `PoseStamped`, the format of `sensor/pose`."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tsd_twin.lie import SE2, Array
from tsd_twin.messages.cdr import ODOM, wrapped_heading
from tsd_twin.messages.cdr_codec import CdrReader, CdrWriter
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.topics import Sample

_LENGTH_OFF = 1e-3
"""Tolerance on quaternion length, above rounding errors."""
_UPRIGHT = math.cos(math.radians(30.0))
"""Maximum tilt of a robot on a floor."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseStamped:
    """Spatial pose in `frame`, at `stamp_ns` of the robot's wall clock."""

    frame: str
    position_m: Array
    """(3,)."""
    wxyz: Array
    """(4,)."""
    stamp_ns: int

    @staticmethod
    def planar(pose: SE2, stamp_ns: int) -> PoseStamped:
        """Return the message for a planar pose in `odom`."""
        x, y, heading = pose.xy_heading.tolist()
        turn = [math.cos(0.5 * heading), 0.0, 0.0, math.sin(0.5 * heading)]
        return PoseStamped(ODOM, np.array([x, y, 0.0]), np.array(turn), stamp_ns)


def encode_pose(message: PoseStamped) -> bytes:
    """Encode a pose as CDR."""
    w, x, y, z = message.wxyz
    cdr = CdrWriter()
    cdr.header(message.stamp_ns, message.frame)
    cdr.doubles([*message.position_m, x, y, z, w])
    return cdr.payload()


def decode_pose(payload: bytes) -> PoseStamped:
    """Decode a pose from CDR; values may be NaN.

    Raises:
        MessageError: If it is not a `geometry_msgs/msg/PoseStamped` (`shape`).
    """
    cdr = CdrReader(payload, "geometry_msgs/msg/PoseStamped")
    stamp_ns, frame = cdr.header()
    pose = cdr.doubles(7)
    cdr.end()
    return PoseStamped(frame, position_m=pose[:3], wxyz=pose[[6, 3, 4, 5]], stamp_ns=stamp_ns)


def decode_pose_measurement(sample: Sample) -> tuple[SE2, int]:
    """Decode a sample of `twin/<robot>/sensor/pose`; return the planar pose and its stamp.

    The heading is in (-pi, pi]; height and small tilt are ignored.

    Raises:
        MessageError: With reason `key`, `shape`, `frame`, `nonfinite` or `quaternion`.
    """
    if not sample.is_put or "*" in sample.key:
        raise MessageError("key", f"{sample.key} is not the key of one robot")
    message = decode_pose(sample.payload)
    if message.frame != ODOM:
        raise MessageError("frame", f"frame_id must be {ODOM}")
    if not (np.isfinite(message.position_m).all() and np.isfinite(message.wxyz).all()):
        raise MessageError("nonfinite", "a pose must be finite numbers")
    w, x, y, z = message.wxyz.tolist()
    # Squares would overflow, but hypot does not.
    if abs(math.hypot(w, x, y, z) - 1.0) > _LENGTH_OFF:
        raise MessageError("quaternion", "the length of a quaternion must be one")
    if 1.0 - 2.0 * (x * x + y * y) < _UPRIGHT:
        raise MessageError("quaternion", "a robot on a floor stands upright")
    heading = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    x_m, y_m, _ = message.position_m
    return SE2(wrapped_heading(np.array([x_m, y_m, heading]))), message.stamp_ns
