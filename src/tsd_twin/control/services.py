"""Services of a robot: lease, arm, disarm, reset, set_pose, speed, stop; and pose codecs for each
pose type.
"""

from __future__ import annotations

from typing import Any, Generic, Protocol

import numpy as np

from tsd_twin.control.state_estimator import StateEstimator
from tsd_twin.control.wheel_speed import WheelSpeedController
from tsd_twin.errors import MessageError
from tsd_twin.kinematics.base import PoseT
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages.requests import (
    HolderRequest,
    LeaseReply,
    LeaseRequest,
    Reply,
    SetOrientationRequest,
    SetPoseRequest,
    SpeedRequest,
    StopRequest,
    decode_request,
)
from tsd_twin.messages.status import Refusals
from tsd_twin.messages.topics import Service
from tsd_twin.safety import Mode, SafetySupervisor


class PoseCodec(Protocol, Generic[PoseT]):
    """Decoder of poses for one pose type, and rotation of twists from `odom` to `base_link`."""

    def request_type(self) -> type[SetPoseRequest] | type[SetOrientationRequest]:
        """Request type of `srv/set_pose`."""
        ...

    def decode(self, request: Any) -> PoseT | None:
        """Requested pose; None when it is not finite or not a valid pose."""
        ...

    def to_base_frame(self, pose: PoseT, twist: Array) -> Array:
        """Return `twist` (3,), given in the axes of `odom`, in those of `base_link`."""
        ...


class PlanarPoseCodec:
    """Planar poses: x, y, heading."""

    def request_type(self) -> type[SetPoseRequest]:
        """Request with x, y and heading."""
        return SetPoseRequest

    def decode(self, request: SetPoseRequest) -> SE2 | None:
        """Planar pose, when it is finite."""
        pose = np.array([request.x_m, request.y_m, request.heading_rad])
        return SE2(pose) if np.isfinite(pose).all() else None

    def to_base_frame(self, pose: SE2, twist: Array) -> Array:
        """Turn by minus the heading: Eq. 1 of Carothers."""
        turned = twist.copy()
        turned[:2] = pose.inverse().rotate(twist[:2])
        return turned


class OrientationCodec:
    """Orientations of a sphere on a fixed base."""

    def request_type(self) -> type[SetOrientationRequest]:
        """Request with a quaternion."""
        return SetOrientationRequest

    def decode(self, request: SetOrientationRequest) -> SO3 | None:
        """Orientation, when the four numbers can be made a unit quaternion."""
        x, y, z, w = request.xyzw
        wxyz = np.array([w, x, y, z])
        largest = float(np.max(np.abs(wxyz)))
        if not (np.isfinite(wxyz).all() and largest > 0.0):
            return None
        wxyz /= largest  # First, so that no square overflows or vanishes.
        return SO3(wxyz / np.linalg.norm(wxyz))

    def to_base_frame(self, pose: SO3, twist: Array) -> Array:  # noqa: ARG002  The shape.
        """Twist unchanged: the base is fixed in the world."""
        return twist


POSE_CODECS: dict[type[Any], PoseCodec[Any]] = {SE2: PlanarPoseCodec(), SO3: OrientationCodec()}
"""Pose codec for each pose type."""


class ServiceHandler:
    """Decodes service requests and dispatches them; every request gets a reply."""

    def __init__(
        self,
        supervisor: SafetySupervisor,
        wheel_speed: WheelSpeedController,
        estimator: StateEstimator,
        pose_codec: PoseCodec[Any],
    ) -> None:
        self._supervisor = supervisor
        self._wheel_speed = wheel_speed
        self._estimator = estimator
        self._pose_codec = pose_codec

    def serve(self, service: Service, payload: bytes, now_s: float) -> LeaseReply | Reply:
        """Reply to a request; a malformed request gets a refusal."""
        try:
            match service:
                case Service.LEASE:
                    return self._supervisor.lease(decode_request(payload, LeaseRequest), now_s)
                case Service.ARM | Service.DISARM | Service.RESET:
                    supervisor = self._supervisor
                    ask = {
                        Service.ARM: supervisor.arm,
                        Service.DISARM: supervisor.disarm,
                        Service.RESET: supervisor.reset,
                    }[service]
                    return ask(decode_request(payload, HolderRequest).lease, now_s)
                case Service.SET_POSE:
                    return self._set_pose(
                        decode_request(payload, self._pose_codec.request_type()), now_s
                    )
                case Service.SPEED:
                    return self._choose_speed(decode_request(payload, SpeedRequest), now_s)
                case Service.STOP:
                    return self.stop(payload, now_s)
                case Service.DESC:
                    return Reply(False, "the node answers this")
        except MessageError as error:
            refusal = self._refused(service, str(error), now_s)
            if service is Service.LEASE:
                return LeaseReply(False, reason=refusal.reason, ok=False)
            return refusal

    def stop(self, payload: bytes, now_s: float) -> Reply:
        """Latch a stop; every payload is accepted, also a malformed one."""
        try:
            request = decode_request(payload, StopRequest)
        except MessageError:
            request = StopRequest()
        return self._supervisor.stop(request, now_s)

    def refusals(self, now_s: float) -> Refusals:
        """Part of the status that shows which requests would be refused now."""
        supervisor, lease = self._supervisor, self._supervisor.lease_in_force(now_s)
        lease_hex = lease.id.hex() if lease else ""
        return Refusals(
            lease=supervisor.lease_refusal(None, now_s) or None,
            without_lease=supervisor.holder_refusal("", now_s),
            arm=supervisor.arm_refusal(lease_hex, now_s) or None,
            disarm=supervisor.holder_refusal(lease_hex, now_s) or None,
            reset=supervisor.reset_refusal(lease_hex, now_s) or None,
            drive=supervisor.drive_refusal(lease_hex, now_s) or None,
            set_pose=self._set_pose_refusal(lease_hex, now_s) or None,
            speed=self._speed_refusal(lease_hex, now_s) or None,
        )

    def _set_pose_refusal(self, lease_hex: str, now_s: float) -> str:
        if refusal := self._supervisor.holder_refusal(lease_hex, now_s):
            return refusal
        if self._supervisor.mode in (Mode.DRIVING, Mode.STOPPING):
            # A command in the world's axes would turn with the heading.
            return "the pose can be set at rest only"
        return ""

    def _speed_refusal(self, lease_hex: str, now_s: float) -> str:
        supervisor = self._supervisor
        return (
            supervisor.holder_refusal(lease_hex, now_s)
            or supervisor.latched_refusal
            or self._wheel_speed.refusal
        )

    def _set_pose(self, request: SetPoseRequest | SetOrientationRequest, now_s: float) -> Reply:
        pose = self._pose_codec.decode(request)
        if refusal := self._set_pose_refusal(request.lease, now_s):
            return self._refused(Service.SET_POSE, refusal, now_s)
        if pose is None:
            return self._refused(Service.SET_POSE, "a pose must be finite numbers", now_s)
        self._estimator.set_pose(pose)
        return Reply(True)

    def _choose_speed(self, request: SpeedRequest, now_s: float) -> Reply:
        lease_hex = request.lease
        refusal = self._speed_refusal(lease_hex, now_s) or self._wheel_speed.choose(
            request.cruise_speed_rpm, bytes.fromhex(lease_hex)
        )
        if refusal:
            return self._supervisor.refuse("change the drive speed", refusal, now_s)
        return Reply(True)

    def _refused(self, service: Service, reason: str, now_s: float) -> Reply:
        return self._supervisor.refuse(service.removeprefix("srv/"), reason, now_s)
