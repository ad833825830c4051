"""Simulated robot that a caller steps through virtual time."""

from __future__ import annotations

import itertools

import msgspec
import numpy as np

from tsd_twin.client.protocol import ControlProtocol
from tsd_twin.client.virtual import PERIOD_S
from tsd_twin.control import RobotController
from tsd_twin.control.state_estimator import VOLT_STEP
from tsd_twin.errors import TwinError
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.cdr import BASE, Odometry
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.services import (
    HolderRequest,
    LeaseReply,
    LeaseRequest,
    Reply,
    SetPoseRequest,
    SpeedRequest,
)
from tsd_twin.messages.status import LoopStatus, RobotStatus
from tsd_twin.messages.topics import Sample, Service, twist_key
from tsd_twin.robots import RobotDescription
from tsd_twin.simulation import SimRobot

_STATUS_EVERY = 5
"""Status every 5 periods (20 Hz)."""

_LAB = "lab"
_ARMING_S = 60.0
_ANY_M = 1000.0


class VirtualRobot:
    """Robot controller and simulator in virtual time, driven by twists, without a bus.

    The rules of the real robot apply: arming, limits, command gate. Poses are relative to a mark,
    set where the robot became ready. A simulation that was used before continues from `start_s`.

    Raises:
        TwinError: If the robot does not become ready, or turns a sphere although `on_floor`.
    """

    def __init__(
        self,
        robot: RobotDescription,
        simulated: SimRobot,
        start_s: float = 0.0,
        *,
        on_floor: bool = True,
    ) -> None:
        ids = itertools.count(1)
        # The lease need not cap the speed, because virtual links cannot fail.
        limits = msgspec.structs.replace(robot.limits, stop_allowance_m=_ANY_M)
        robot = msgspec.structs.replace(robot, limits=limits).with_delay(simulated.delay_s)
        self.controller = RobotController(robot, lambda: next(ids).to_bytes(16, "big"))
        self.simulated = simulated
        self.now_s = start_s
        self.speed_scale_sigma = 1.0
        """True wheel speed relative to the controller's; commands are divided by it."""
        self._periods = itertools.count()
        self._status_seq = 0
        self._mark = SE2.identity()
        self._step(None)
        if on_floor:
            self._true_pose()
        self._protocol = ControlProtocol(robot.name, robot, _LAB)
        self._lease = self._acquire()
        self._arm()
        if on_floor:
            self.mark()

    def mark(self) -> None:
        """Set the mark to the current true pose and the estimate to zero."""
        self._mark = self._true_pose()
        self._call_service(Service.SET_POSE, SetPoseRequest(self._lease, 0.0, 0.0, 0.0))

    def choose_drive_speed(self, spin_rpm: float) -> None:
        """Set the speed of continuously spinning wheels."""
        self._call_service(Service.SPEED, SpeedRequest(self._lease, float(spin_rpm)))

    def drive(self, twist: Array) -> None:
        """Run one control period with the command `twist` (3,) in the body frame."""
        self._step(twist / self.speed_scale_sigma)

    def coast(self) -> None:
        """Run one control period without a command, as after the loss of a link."""
        self._step(None)

    @property
    def truth(self) -> SE2:
        """True pose relative to the mark."""
        return self._mark.inverse() @ self._true_pose()

    @property
    def true_twist(self) -> Array:
        """(3,): true twist in the body frame."""
        return self.simulated.truth(self.now_s).twist

    def odometry(self) -> Odometry:
        """Return the robot's odometry relative to the mark."""
        return self.controller.odometry(round(self.now_s * 1e9))

    def status(self) -> RobotStatus:
        """Return the robot status."""
        return self.controller.status(self.now_s, LoopStatus(), {})

    def _true_pose(self) -> SE2:
        pose = self.simulated.truth(self.now_s).pose
        if not isinstance(pose, SE2):
            raise TwinError(
                f"{self.controller.robot.name} turns a sphere in place: it follows no path"
            )
        return pose

    def _arm(self) -> None:
        self._call_service(Service.ARM, HolderRequest(self._lease))
        end_s = self.now_s + _ARMING_S
        while self.controller.supervisor.mode is not Mode.READY:
            self._step(np.zeros(3))
            if self.now_s > end_s:
                raise TwinError(
                    f"the robot does not get ready: {self.controller.supervisor.reason}"
                )

    def _step(self, twist: Array | None) -> None:
        self.now_s += PERIOD_S
        samples = [] if twist is None else [self._sample(twist)]
        mode = self.controller.supervisor.mode
        setpoint = self.controller.step(self.now_s, self.simulated.read(self.now_s), samples)
        self.simulated.write(setpoint, self.now_s)
        # Like the node, send a status at each mode change, because older ones may no longer be
        # echoed.
        if next(self._periods) % _STATUS_EVERY == 0 or self.controller.supervisor.mode is not mode:
            self._status_seq += 1
            self.controller.record_status_sent(self._status_seq, self.now_s)

    def _sample(self, twist: Array) -> Sample:
        self._protocol.status_seq = self._status_seq
        command = self._protocol.command(twist, BASE, self.now_s)
        key = twist_key(self.controller.robot.name, _LAB)
        return Sample(key, command.payload, command.attachment)

    def _acquire(self) -> str:
        request = LeaseRequest(op="acquire", operator=_LAB)
        reply = self._call_service(Service.LEASE, request)
        if isinstance(reply, LeaseReply):
            self._protocol.grant(reply, self.now_s)
        return self._protocol.lease_hex

    def _call_service(self, service: Service, request: msgspec.Struct) -> LeaseReply | Reply:
        reply = self.controller.serve(service, msgspec.json.encode(request), self.now_s)
        if not (reply.ok and getattr(reply, "granted", True)):
            raise TwinError(f"{service.value}: {reply.reason}")
        return reply


def voltage_share(robot: VirtualRobot) -> float:
    """Return the wheel speed relative to nominal voltage, from the voltage reported by servos."""
    nominal_v = robot.controller.robot.battery.nominal_v
    battery_v = robot.simulated.hardware().get("battery_v")
    if not isinstance(battery_v, float):
        return 1.0
    return VOLT_STEP * round(battery_v / VOLT_STEP) / nominal_v
