"""What poses of a robot are to those who talk to it: one class for each space of poses."""

from __future__ import annotations

from typing import Any, Generic, Protocol

import numpy as np

from tsd_twin.drives.drive import PoseT
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages.service import SetOrientationRequest, SetPoseRequest


class Space(Protocol, Generic[PoseT]):
    """How poses come in, and what commands in the axes of the world mean."""

    def request(self) -> type[SetPoseRequest] | type[SetOrientationRequest]:
        """Return what `srv/set_pose` has to carry."""
        ...

    def asked(self, request: Any) -> PoseT | None:
        """Return the pose that such a request asks for; None: it is no pose."""
        ...

    def into_base(self, pose: PoseT, twist: Array) -> Array:
        """Return the twist (3,) in `base_link` that is `twist` in the axes of `odom`."""
        ...


class Floor:
    """Planar poses: x, y, heading."""

    def request(self) -> type[SetPoseRequest]:
        """Return the request with x, y and heading."""
        return SetPoseRequest

    def asked(self, request: SetPoseRequest) -> SE2 | None:
        """Return the planar pose, when it is finite."""
        pose = np.array([request.x_m, request.y_m, request.heading_rad])
        return SE2(pose) if np.isfinite(pose).all() else None

    def into_base(self, pose: SE2, twist: Array) -> Array:
        """Turn by minus the heading: Eq. 1 of Carothers."""
        turned = twist.copy()
        turned[:2] = pose.inverse().rotate(twist[:2])
        return turned


class Ball:
    """Orientations of a sphere in a base that stays where it is."""

    def request(self) -> type[SetOrientationRequest]:
        """Return the request with a quaternion."""
        return SetOrientationRequest

    def asked(self, request: SetOrientationRequest) -> SO3 | None:
        """Return the orientation, when the four numbers can be made a unit quaternion."""
        x, y, z, w = request.xyzw
        wxyz = np.array([w, x, y, z])
        largest = float(np.max(np.abs(wxyz)))
        if not (np.isfinite(wxyz).all() and largest > 0.0):
            return None
        wxyz /= largest  # First, so that no square overflows or vanishes.
        return SO3(wxyz / np.linalg.norm(wxyz))

    def into_base(self, pose: SO3, twist: Array) -> Array:  # noqa: ARG002  The shape.
        """Return the twist as it is: the base stands in the world."""
        return twist


SPACES: dict[type[Any], Space[Any]] = {SE2: Floor(), SO3: Ball()}
"""From the space of poses to what they are on the bus."""
