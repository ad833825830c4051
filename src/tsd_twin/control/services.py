"""Robot services (lease, arm, disarm, reset, set_pose, stop, speed) and wheel-speed control."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Generic, Protocol

import numpy as np

from tsd_twin.control.state_estimator import StateEstimator
from tsd_twin.errors import MessageError
from tsd_twin.kinematics import JointKind, Kinematics
from tsd_twin.kinematics.base import PoseT
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.errors import rejection
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
from tsd_twin.messages.status import Refusals, WheelSpeedStatus
from tsd_twin.messages.topics import Service
from tsd_twin.robots import RPM, RobotDescription, WheelSpeedRange
from tsd_twin.safety import Mode, SafetySupervisor

_REST = np.zeros(3)
_SAME = 1e-9
"""Relative tolerance for comparing wheel speeds."""


class WheelSpeedController:
    """Ramps the wheel speed to the requested one and adapts the kinematics.

    The ground speed of a wheel is r_w w sin(tilt) at wheel speed w. Motors lag behind their
    setpoint, so the tilt uses the wheel speed that the motor model predicts for when the gimbals
    reach it. This keeps the ground speed constant while the wheel speed changes. Without a
    wheel-speed range, the kinematics never change.

    A requested speed persists until the wheels are switched off or, at rest, until its operator
    loses the lease. The default from the description then applies again.
    """

    def __init__(self, robot: RobotDescription) -> None:
        self.kinematics: Kinematics[Any] = robot.kinematics()
        """Kinematics at the current wheel speed."""
        self._range, self._law = robot.wheel_speed_range, robot.spin_up()
        self._lag_s = robot.lag_s
        self._deceleration_mps2 = robot.limits.deceleration_mps2
        self._wheels = np.flatnonzero(
            [j.kind is JointKind.VELOCITY for j in self.kinematics.joints]
        )
        self._mean_ratio = float(self._range.kinematics.spin_ratio.mean()) if self._range else 1.0
        usual = self._range.kinematics.spin_rad_per_s if self._range else 0.0
        self._usual = self._requested = self._commanded = self._at = usual
        self._chosen_by: bytes | None = None
        self._was_armed = False
        self._solution = (self.kinematics, b"", np.zeros(0))
        """Latest kinematics, twist and joints (n,) of `inverse`, cached because they repeat at rest
        and in steady motion."""

    @property
    def refusal(self) -> Reason | None:
        """Reason why no wheel speed can be set, or None."""
        return because(Code.NO_WHEEL_SPEED) if self._range is None else None

    def choose(self, spin_rpm: float, lease: bytes) -> Reason | None:
        """Set the wheel speed for the holder of `lease`; return why it is refused, or None."""
        if self._range is None:
            return self.refusal
        if not self._range.allows(spin_rpm * RPM):
            return because(
                Code.WHEEL_SPEED_REFUSED,
                least_rpm=self._range.least_rad_per_s / RPM,
                most_rpm=self._range.most_rad_per_s / RPM,
            )
        self._requested, self._chosen_by = spin_rpm * RPM, lease
        return None

    def advance(
        self,
        dt_s: float,
        lease: bytes | None,
        spin_after: Callable[[Array, float], float],
        *,
        armed: bool,
        ramps: bool,
    ) -> bool:
        """Advance the ramp by `dt_s`; return whether the kinematics changed.

        `lease` is the active one or None. `armed` means that the wheels may spin, and `ramps` that
        the robot may drive, so the speed must not jump. `spin_after(speeds, dt_s)` predicts the
        mean wheel speed for setpoints (m,).
        """
        if self._range is None:
            return False
        if not armed and (self._was_armed or lease != self._chosen_by):
            self._requested, self._chosen_by = self._usual, None
        self._was_armed = armed
        if not ramps:
            self._commanded = self._requested
            return self._update_wheel_speed(self._commanded)
        if self._commanded != self._requested:
            self._ramp(self._range, dt_s)
        mean = spin_after(self._commanded * self._range.kinematics.spin_ratio, self._lag_s)
        return self._update_wheel_speed(mean / self._mean_ratio)

    def inverse(self, twist: Array) -> Array:
        """Return the joints (n,) for a twist (3,)."""
        if not any(twist.tolist()):
            twist = _REST  # A negative zero would miss the cache.
        kinematics, asked, joints = self._solution
        if kinematics is not self.kinematics or asked != twist.tobytes():
            joints = self.kinematics.inverse(twist)
            self._solution = (self.kinematics, twist.tobytes(), joints)
        joints = joints.copy()
        if self._range is not None:
            joints[self._wheels] = self._commanded * self._range.kinematics.spin_ratio
        return joints

    def status(self, spin_rad_per_s: float) -> WheelSpeedStatus | None:
        """Return the wheel-speed part of the status for a mean speed of `spin_rad_per_s`."""
        if self._range is None:
            return None
        spin = spin_rad_per_s / self._mean_ratio
        return WheelSpeedStatus(round(self._requested / RPM, 1), round(spin / RPM, 1))

    def _ramp(self, speed_range: WheelSpeedRange, dt_s: float) -> None:
        law, error = self._law, self._requested - self._commanded
        rate = speed_range.rate_rad_per_s2(
            self._commanded, law.up_s if error > 0.0 else law.down_s, self._deceleration_mps2
        )
        step = rate * dt_s
        # Reach it exactly, because half a rotation below the minimum speed is out of range.
        self._commanded = (
            self._requested if abs(error) <= step else self._commanded + math.copysign(step, error)
        )

    def _update_wheel_speed(self, spin: float) -> bool:
        assert self._range is not None  # noqa: S101  Checked by callers.
        spin = min(max(spin, self._range.least_rad_per_s), self._range.most_rad_per_s)
        if abs(spin - self._at) <= _SAME * spin:
            return False
        self._at = spin
        self.kinematics = self._range.kinematics.with_spin(spin)
        return True


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


class ServiceHandler:
    """Decodes and dispatches service requests; every request gets a reply."""

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
                    return self._set_pose(
                        decode_request(payload, self._pose_codec.request_type()), now_s
                    )
                case Service.SPEED:
                    return self._choose_speed(decode_request(payload, SpeedRequest), now_s)
                case Service.STOP:
                    return self.stop(payload, now_s)
                case Service.DESC:
                    return Reply.refused(because(Code.NOT_SERVED))
        except MessageError as error:
            refusal = self._refused(service, rejection(error), now_s)
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
                "without_lease": supervisor.holder_refusal("", now_s),
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
        pose = self._pose_codec.decode(request)
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
