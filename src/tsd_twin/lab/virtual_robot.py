"""A whole robot in virtual time: the core that runs on the machine, and simulated joints."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping

import msgspec
import numpy as np

from tsd_twin.authority import Mode
from tsd_twin.client.protocol import ControlProtocol
from tsd_twin.core import RobotCore
from tsd_twin.errors import TwinError
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.command import Sample
from tsd_twin.messages.ros import BASE, Odometry
from tsd_twin.messages.service import LeaseReply
from tsd_twin.messages.status import LoopStatus, Status
from tsd_twin.robots import Robot
from tsd_twin.sim import SimRobot
from tsd_twin.topics import Service, twist_key

PERIOD_S = 0.01
_OPERATOR = "lab"
_ARMING_S = 60.0
_ANY_M = 1000.0
_NEXT_STATUS = 5
"""Periods from one status to the next."""


class VirtualRobot:
    """Core and simulator, driven by twists as an operator would, without a bus or a clock.

    What holds on the machine holds here: arming, limits, command gate. Poses are those since
    `ready`: the robot is put on its mark then, and told so. A simulation that has been used before
    goes on from `start_s`.

    Raises:
        TwinError: the robot does not move over a floor, or does not get ready.
    """

    def __init__(self, robot: Robot, simulated: SimRobot, start_s: float = 0.0) -> None:
        ids = itertools.count(1)
        # No link can fail in virtual time: the lease need not cap the speed for that.
        limits = msgspec.structs.replace(robot.limits, stop_allowance_m=_ANY_M)
        robot = msgspec.structs.replace(robot, limits=limits)
        self.core = RobotCore(robot, lambda: next(ids).to_bytes(16, "big"))
        self.simulated = simulated
        self.now_s = start_s
        self.spin_share = 1.0
        """Speed of the wheels over what the core takes it for; commands are corrected by it."""
        self._periods = itertools.count()
        self._status_seq = 0
        self._mark = SE2.identity()
        self._tick(None)
        self._on_the_floor()
        self._protocol = ControlProtocol(robot.name, robot, _OPERATOR)
        self._lease = self._acquire()
        self._get_ready()
        self.mark()

    def mark(self) -> None:
        """Take it that the robot is on its mark now, and tell it so."""
        self._mark = self._on_the_floor()
        self._ask(Service.SET_POSE, {"lease": self._lease} | _xyh(0.0, 0.0, 0.0))

    def drive(self, twist: Array) -> None:
        """Let a period pass under the command `twist` (3,), in the body frame."""
        self._tick(twist / self.spin_share)

    @property
    def truth(self) -> SE2:
        """Where the robot really is, seen from its mark."""
        return self._mark.inverse() @ self._on_the_floor()

    @property
    def true_twist(self) -> Array:
        """(3,): how it really moves, in the body frame."""
        return self.simulated.truth(self.now_s).twist

    def odometry(self) -> Odometry:
        """Return what the robot itself makes of its joints, seen from its mark."""
        return self.core.odometry(round(self.now_s * 1e9))

    def status(self) -> Status:
        """Return the status."""
        return self.core.status(self.now_s, LoopStatus(), {})

    def _on_the_floor(self) -> SE2:
        pose = self.simulated.truth(self.now_s).pose
        if not isinstance(pose, SE2):
            raise TwinError(f"{self.core.robot.name} turns a sphere in place: it follows no path")
        return pose

    def _get_ready(self) -> None:
        self._ask(Service.ARM, {"lease": self._lease})
        end_s = self.now_s + _ARMING_S
        while self.core.authority.mode is not Mode.READY:
            self._tick(np.zeros(3))
            if self.now_s > end_s:
                raise TwinError(f"the robot does not get ready: {self.core.authority.reason}")

    def _tick(self, twist: Array | None) -> None:
        self.now_s += PERIOD_S
        samples = [] if twist is None else [self._sample(twist)]
        mode = self.core.authority.mode
        setpoint = self.core.step(self.now_s, self.simulated.read(self.now_s), samples)
        self.simulated.write(setpoint, self.now_s)
        # As the node does: on a change of mode at once, since no older status may be echoed then.
        if next(self._periods) % _NEXT_STATUS == 0 or self.core.authority.mode is not mode:
            self._status_seq += 1
            self.core.note_status_sent(self._status_seq, self.now_s)

    def _sample(self, twist: Array) -> Sample:
        self._protocol.status_seq = self._status_seq
        command = self._protocol.command(twist, BASE, self.now_s)
        key = twist_key(self.core.robot.name, _OPERATOR)
        return Sample(key, command.payload, command.attachment)

    def _acquire(self) -> str:
        reply = self.core.serve(
            Service.LEASE, json.dumps({"op": "acquire", "operator": _OPERATOR}).encode(), self.now_s
        )
        if not isinstance(reply, LeaseReply):
            raise TwinError(f"{Service.LEASE}: {reply.reason}")
        self._protocol.grant(reply, self.now_s)
        return self._protocol.lease_hex

    def _ask(self, service: Service, request: Mapping[str, object]) -> None:
        reply = self.core.serve(service, json.dumps(request).encode(), self.now_s)
        if not (getattr(reply, "ok", True) and getattr(reply, "granted", True)):
            raise TwinError(f"{service.value}: {reply.reason}")


def _xyh(x_m: float, y_m: float, heading_rad: float) -> dict[str, object]:
    return {"x_m": x_m, "y_m": y_m, "heading_rad": heading_rad}
