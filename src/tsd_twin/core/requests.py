"""What operators ask of a robot, but for the commands that move it."""

from __future__ import annotations

from typing import Any

from tsd_twin.authority import LATCHED, Authority, Mode
from tsd_twin.core.estimator import Estimator
from tsd_twin.core.gearbox import Gearbox
from tsd_twin.core.spaces import Space
from tsd_twin.errors import MessageError
from tsd_twin.messages.service import (
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
from tsd_twin.topics import Service


class Requests:
    """Reads requests, and has those answered whom they are for: never silence."""

    def __init__(
        self, authority: Authority, gearbox: Gearbox, estimator: Estimator, space: Space[Any]
    ) -> None:
        self._authority = authority
        self._gearbox = gearbox
        self._estimator = estimator
        self._space = space

    def serve(self, service: Service, payload: bytes, now_s: float) -> LeaseReply | Reply:
        """Return the answer to a request, also to one that cannot be read: never silence."""
        try:
            match service:
                case Service.LEASE:
                    return self._authority.lease(decode_request(payload, LeaseRequest), now_s)
                case Service.ARM | Service.DISARM | Service.RESET:
                    authority = self._authority
                    ask = {
                        Service.ARM: authority.arm,
                        Service.DISARM: authority.disarm,
                        Service.RESET: authority.reset,
                    }[service]
                    return ask(decode_request(payload, HolderRequest).lease, now_s)
                case Service.SET_POSE:
                    return self._set_pose(decode_request(payload, self._space.request()), now_s)
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
        """Stop and latch, whatever the payload is: a stop needs nothing to count."""
        try:
            request = decode_request(payload, StopRequest)
        except MessageError:
            request = StopRequest()
        return self._authority.stop(request, now_s)

    def _set_pose(self, request: SetPoseRequest | SetOrientationRequest, now_s: float) -> Reply:
        pose = self._space.asked(request)
        if not self._authority.holds(request.lease, now_s):
            return self._refused(Service.SET_POSE, "take control first", now_s)
        if pose is None:
            return self._refused(Service.SET_POSE, "a pose must be finite numbers", now_s)
        if self._authority.mode in (Mode.DRIVING, Mode.STOPPING):
            # A command in the world's axes would turn with the heading.
            return self._refused(Service.SET_POSE, "the pose can be set at rest only", now_s)
        self._estimator.set_pose(pose)
        return Reply(True)

    def _choose_speed(self, request: SpeedRequest, now_s: float) -> Reply:
        authority, lease = self._authority, request.lease
        if not authority.holds(lease, now_s):
            refusal = "take control first"
        elif authority.mode in LATCHED:
            refusal = f"the robot is {authority.mode}: reset first"
        else:
            refusal = self._gearbox.choose(request.cruise_speed_rpm, bytes.fromhex(lease))
        if refusal:
            return authority.refuse("change the drive speed", refusal, now_s)
        return Reply(True)

    def _refused(self, service: Service, reason: str, now_s: float) -> Reply:
        return self._authority.refuse(service.removeprefix("srv/"), reason, now_s)
