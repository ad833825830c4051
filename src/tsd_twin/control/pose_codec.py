"""Poses of requests and of `sensor/pose`, by the pose type of a robot."""

from __future__ import annotations

from typing import Any, Generic, Protocol

import numpy as np

from tsd_twin.kinematics.base import PoseT
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages.services import SetOrientationRequest, SetPoseRequest


class PoseCodec(Protocol, Generic[PoseT]):
    """Pose decoder for a pose type, and twist rotation from `odom` to `base_link`."""

    def request_type(self) -> type[SetPoseRequest] | type[SetOrientationRequest]:
        """Return the request type of `srv/set_pose`."""
        ...

    def decode(self, request: Any) -> PoseT | None:
        """Return the requested pose; None for non-finite or invalid values."""
        ...

    def to_base_frame(self, pose: PoseT, twist: Array) -> Array:
        """Rotate a twist (3,) from `odom` axes into `base_link` axes."""
        ...


class PlanarPoseCodec:
    """Planar poses (x, y, heading)."""

    def request_type(self) -> type[SetPoseRequest]:
        """Return the request type with x, y and heading."""
        return SetPoseRequest

    def decode(self, request: SetPoseRequest) -> SE2 | None:
        """Return the planar pose; None for non-finite values."""
        pose = np.array([request.x_m, request.y_m, request.heading_rad])
        return SE2(pose) if np.isfinite(pose).all() else None

    def to_base_frame(self, pose: SE2, twist: Array) -> Array:
        """Rotate by minus the heading: Eq. 1 of Carothers."""
        turned = twist.copy()
        turned[:2] = pose.inverse().rotate(twist[:2])
        return turned


class OrientationCodec:
    """Orientations of a sphere on a fixed base."""

    def request_type(self) -> type[SetOrientationRequest]:
        """Return the request type with a quaternion."""
        return SetOrientationRequest

    def decode(self, request: SetOrientationRequest) -> SO3 | None:
        """Return the orientation, or None if it cannot be normalized."""
        x, y, z, w = request.xyzw
        wxyz = np.array([w, x, y, z])
        largest = float(np.max(np.abs(wxyz)))
        if not (np.isfinite(wxyz).all() and largest > 0.0):
            return None
        wxyz /= largest  # Scale first, so that no square overflows or underflows.
        return SO3(wxyz / np.linalg.norm(wxyz))

    def to_base_frame(self, pose: SO3, twist: Array) -> Array:  # noqa: ARG002  Interface.
        """Return the twist unchanged, because the base is fixed in the world."""
        return twist


POSE_CODECS: dict[type[Any], PoseCodec[Any]] = {SE2: PlanarPoseCodec(), SO3: OrientationCodec()}
"""Pose codec by pose type."""
