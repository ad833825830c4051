"""Services of a robot: lease, arm, disarm, reset, set_pose, speed and stop."""

from __future__ import annotations

import numpy as np

from tsd_twin.control.state_estimator import StateEstimator
from tsd_twin.control.wheel_spin import WheelSpeedController
from tsd_twin.lie import SE2, SO3
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.services import (
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
from tsd_twin.safety import SafetySupervisor


class ServiceHandler:
    """Decodes and dispatches service requests; every request gets a reply."""

    def __init__(
        self,
        supervisor: SafetySupervisor,
        wheel_speed: WheelSpeedController,
        estimator: StateEstimator,
    ) -> None:
        self._supervisor = supervisor
        self._wheel_speed = wheel_speed
        self._estimator = estimator

    def serve(self, service: Service, payload: bytes, now_s: float) -> LeaseReply | Reply:
        """Process a request and return the reply; malformed requests are refused."""
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
                    planar = self._estimator.kinematics.pose_type is SE2
                    kind = SetPoseRequest if planar else SetOrientationRequest
                    return self._set_pose(decode_request(payload, kind), now_s)
                case Service.SPEED:
                    return self._choose_speed(decode_request(payload, SpeedRequest), now_s)
                case Service.STOP:
                    return self.stop(payload, now_s)
                case Service.DESC:
                    return Reply.refused(because(Code.NOT_SERVED))
        except MessageError as error:
            refusal = self._refused(service, error.why, now_s)
            if service is Service.LEASE:
                return LeaseReply(False, reason=refusal.reason, ok=False, why=refusal.why)
            return refusal

    def stop(self, payload: bytes, now_s: float) -> Reply:
        """Latch a stop; any payload is accepted, even a malformed one."""
        try:
            request = decode_request(payload, StopRequest)
        except MessageError:
            request = StopRequest()
        return self._supervisor.stop(request, now_s)

    def refusals(self, now_s: float) -> Refusals:
        """Return the status part with the requests that would be refused now."""
        supervisor, lease = self._supervisor, self._supervisor.lease_in_force(now_s)
        lease_hex = lease.id.hex() if lease else ""
        return Refusals.of(
            {
                "lease": supervisor.lease_refusal(None, now_s),
                "no_lease": supervisor.holder_refusal("", now_s),
                "arm": supervisor.arm_refusal(lease_hex, now_s),
                "disarm": supervisor.holder_refusal(lease_hex, now_s),
                "reset": supervisor.reset_refusal(lease_hex, now_s),
                "drive": supervisor.drive_refusal(lease_hex, now_s),
                "set_pose": self._set_pose_refusal(lease_hex, now_s),
                "speed": self._speed_refusal(lease_hex, now_s),
            }
        )

    def _set_pose_refusal(self, lease_hex: str, now_s: float) -> Reason | None:
        if refusal := self._supervisor.holder_refusal(lease_hex, now_s):
            return refusal
        if self._supervisor.mode in (Mode.DRIVING, Mode.STOPPING):
            # Otherwise a command in world axes would turn with the heading.
            return because(Code.AT_REST_ONLY)
        return None

    def _speed_refusal(self, lease_hex: str, now_s: float) -> Reason | None:
        supervisor = self._supervisor
        return (
            supervisor.holder_refusal(lease_hex, now_s)
            or supervisor.latched_refusal
            or self._wheel_speed.refusal
        )

    def _set_pose(self, request: SetPoseRequest | SetOrientationRequest, now_s: float) -> Reply:
        pose = _requested_pose(request)
        if refusal := self._set_pose_refusal(request.lease, now_s):
            return self._refused(Service.SET_POSE, refusal, now_s)
        if pose is None:
            unusable = because(Code.NOT_FINITE, quantity="pose")
            return self._refused(Service.SET_POSE, unusable, now_s)
        self._estimator.set_pose(pose)
        return Reply(True)

    def _choose_speed(self, request: SpeedRequest, now_s: float) -> Reply:
        lease_hex = request.lease
        refusal = self._speed_refusal(lease_hex, now_s) or self._wheel_speed.choose(
            request.cruise_speed_rpm, bytes.fromhex(lease_hex)
        )
        if refusal is not None:
            return self._refused(Service.SPEED, refusal, now_s)
        return Reply(True)

    def _refused(self, service: Service, why: Reason, now_s: float) -> Reply:
        return self._supervisor.refuse(service.removeprefix("srv/"), why, now_s)


def _requested_pose(request: SetPoseRequest | SetOrientationRequest) -> SE2 | SO3 | None:
    """Return the pose; None for a pose that is not finite or cannot be normalized."""
    if isinstance(request, SetPoseRequest):
        pose = np.array([request.x_m, request.y_m, request.heading_rad])
        return SE2(pose) if np.isfinite(pose).all() else None
    x, y, z, w = request.xyzw
    wxyz = np.array([w, x, y, z])
    largest = float(np.max(np.abs(wxyz)))
    if not (np.isfinite(wxyz).all() and largest > 0.0):
        return None
    wxyz /= largest  # Scale first, so that no square overflows or underflows.
    return SO3(wxyz / np.linalg.norm(wxyz))
