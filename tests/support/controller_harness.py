"""Robot controller, ideal joints, operators and delayed clients in virtual time, without a bus."""

from __future__ import annotations

import itertools
import json
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np

from tsd_twin import robots
from tsd_twin.client.errors import ClientError
from tsd_twin.client.protocol import ControlProtocol, TwistCommand
from tsd_twin.control import RobotController
from tsd_twin.kinematics import JointKind
from tsd_twin.lie import Array
from tsd_twin.messages.cdr import BASE, TwistStamped, encode_twist
from tsd_twin.messages.commands import encode_attachment
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.services import LeaseReply
from tsd_twin.messages.status import LoopStatus, RobotStatus
from tsd_twin.messages.topics import Sample, Service, twist_key
from tsd_twin.robots import RobotDescription, SingularityDescription
from tsd_twin.simulation import SimRobot

PERIOD_S = 0.01
ROBOT = robots.load_robot("tsd")


def with_exact_setpoints(robot: RobotDescription) -> RobotDescription:
    """Return a robot whose setpoints follow from inverse kinematics, without rounding to steps."""
    if not isinstance(robot, SingularityDescription):
        return robot
    servo = msgspec.structs.replace(robot.servo, joint_rounding=False)
    return msgspec.structs.replace(robot, servo=servo)


@dataclass(slots=True)
class HarnessOperator:
    """Operator with a current or expired lease."""

    name: str
    lease: str
    numbers: itertools.count[int] = field(default_factory=lambda: itertools.count(1))


class ControllerHarness:
    """Robot controller at 100 Hz, with ideal joints or with a simulated robot."""

    def __init__(
        self,
        simulated: SimRobot | None = None,
        start_s: float = 0.0,
        robot: RobotDescription = ROBOT,
    ) -> None:
        ids = itertools.count(1)
        self.controller = RobotController(robot, lambda: next(ids).to_bytes(16, "big"))
        self.simulated = simulated
        self.now_s = start_s
        self.status_seq = 0
        self.status_sent_s: dict[int, float] = {}
        self.inbox: list[Sample] = []
        self.measures = True
        self.battery_v: float | None = None
        self.servo_c: float | None = None
        joints = self.controller.kinematics.joints
        self.wheels = np.array([joint.kind is JointKind.VELOCITY for joint in joints])
        self._ticks = itertools.count()
        self._told = self.mode
        self.setpoint = self.controller.setpoint
        self.tick(0.0)

    @property
    def mode(self) -> Mode:
        return self.controller.supervisor.mode

    @property
    def twist(self) -> Array:
        return self.controller.twist

    @property
    def pose(self) -> Array:
        """Estimated x, y and heading; for a sphere the quaternion, w first."""
        message = self.controller.odometry(0)
        return message.xy_heading if message.wxyz is None else message.wxyz

    def truth(self) -> Array:
        """True x, y and heading."""
        assert self.simulated is not None
        return self.simulated.truth(self.now_s).pose.xy_heading

    def status(self) -> RobotStatus:
        return self.controller.status(self.now_s, LoopStatus(), {})

    def tick(self, dt_s: float = PERIOD_S) -> None:
        """Run one period of the control loop, as the node does: read, step, write, send the
        status.
        """
        self.now_s += dt_s
        inbox, self.inbox = self.inbox, []
        self.setpoint = self.controller.step(
            self.now_s, self.measure(), inbox, battery_v=self.battery_v, servo_c=self.servo_c
        )
        if self.simulated is not None:
            self.simulated.write(self.setpoint, self.now_s)
        if next(self._ticks) % 5 == 0 or self.mode is not self._told:
            self._told = self.mode
            self.status_seq += 1
            self.status_sent_s[self.status_seq] = self.now_s
            self.controller.record_status_sent(self.status_seq, self.now_s)

    def measure(self) -> Array | None:
        """Return the measurement of this period, or None if the robot measures nothing."""
        if not self.measures:
            return None
        if self.simulated is not None:
            return self.simulated.read(self.now_s)
        if self.controller.robot.measures_spin:
            return self.setpoint.copy()
        return np.where(self.wheels, np.nan, self.setpoint)

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds / PERIOD_S)):
            self.tick()

    def ask(self, service: Service, **fields: Any) -> Any:
        return self.controller.serve(service, json.dumps(fields).encode(), self.now_s)

    def acquire(self, name: str = "alice", **fields: Any) -> HarnessOperator:
        reply = self.ask(Service.LEASE, op="acquire", operator=name, **fields)
        assert reply.granted, reply.reason
        return self.pilot(name, reply.lease)

    @staticmethod
    def pilot(name: str, lease: str) -> HarnessOperator:
        return HarnessOperator(name, lease)

    def sample(
        self, pilot: HarnessOperator, twist: Sequence[float], frame: str = BASE, **changed: Any
    ) -> Sample:
        """Return a valid command for three velocities, except for the fields in `changed`."""
        spatial = np.zeros(6)
        spatial[list(self.controller.kinematics.twist_axes)] = twist
        attachment = encode_attachment(
            changed.get("seq", next(pilot.numbers)),
            bytes.fromhex(changed.get("lease", pilot.lease)),
            changed.get("status_seq", self.status_seq),
        )
        payload = encode_twist(TwistStamped(frame, spatial))
        return Sample(f"twin/tsd/cmd/{pilot.name}/twist", payload, attachment)

    def send(self, pilot: HarnessOperator, twist: Sequence[float], frame: str = BASE) -> None:
        self.inbox.append(self.sample(pilot, twist, frame))

    def drive(
        self, pilot: HarnessOperator, twist: Sequence[float], seconds: float, frame: str = BASE
    ) -> None:
        """Send 50 commands per second."""
        for i in range(round(seconds / PERIOD_S)):
            if i % 2 == 0:
                self.send(pilot, twist, frame)
            self.tick()

    def get_ready(self, name: str = "alice", **fields: Any) -> HarnessOperator:
        """Take control and arm."""
        pilot = self.acquire(name, **fields)
        reply = self.ask(Service.ARM, lease=pilot.lease)
        assert reply.ok, reply.reason
        for _ in range(40):
            if self.mode is Mode.READY:
                break
            self.drive(pilot, (0, 0, 0), 0.1)
        assert self.mode is Mode.READY
        return pilot

    def place(self, *xy_heading: float, pilot: HarnessOperator) -> None:
        """Set the pose estimate of the robot."""
        x, y, heading = xy_heading
        reply = self.ask(Service.SET_POSE, lease=pilot.lease, x_m=x, y_m=y, heading_rad=heading)
        assert reply.ok, reply.reason


ROBOTS = {name: robots.load_robot(name) for name in robots.robot_names()}
PUSH = (0.1, 0.0, 0.0)


class DelayedClient:
    """Client of a robot behind a link that delays or loses messages of either direction."""

    def __init__(self, name: str, up_s: float, down_s: float, max_age_s: float | None) -> None:
        self.rig = ControllerHarness(robot=ROBOTS[name])
        pilot = self.rig.get_ready(max_age_s=max_age_s)
        status = self.rig.status()
        self.max_age_s = status.limits.max_command_age_s
        self.up_s, self.down_s = up_s, down_s
        self.up_lost = self.down_lost = self.paused = False
        self.given_s = -math.inf
        """Time of the latest input."""
        self.failures: list[str] = []
        self._heard = self.rig.status_seq
        self._up: deque[tuple[float, Sample]] = deque()
        self._down: deque[tuple[float, int, RobotStatus]] = deque()
        self.protocol = ControlProtocol(name, ROBOTS[name], "alice")
        self.protocol.receive_status(status, self._heard, self.rig.now_s)
        reply = LeaseReply(True, pilot.lease, "alice", 2.0, "", self.max_age_s)
        self.protocol.grant(reply, self.rig.now_s)
        self.protocol.add_round_trip(up_s + down_s)
        self.wait(0.3)

    @property
    def drives(self) -> bool:
        """Whether the robot obeys a velocity other than zero."""
        supervisor = self.rig.controller.supervisor
        command = supervisor.command
        return self.rig.mode is Mode.DRIVING and command is not None and bool(command.twist.any())

    def give(self, age_s: float = 0.0) -> None:
        """Set a velocity from an input of some age."""
        now_s = self.rig.now_s
        self.given_s = max(self.given_s, now_s - age_s)
        try:
            self.send(self.protocol.set_velocity(PUSH, "base_link", now_s, now_s - age_s))
        except ClientError as error:
            self.failures.append(str(error))

    def send(self, command: TwistCommand | None) -> None:
        """Send a command over the link."""
        if command is not None and not self.up_lost:
            key = twist_key("tsd", command.operator)
            sample = Sample(key, command.payload, command.attachment)
            self._up.append((self.rig.now_s + self.up_s, sample))

    def tick(self) -> None:
        """Run one period of robot, link and client."""
        rig = self.rig
        while self._up and self._up[0][0] <= rig.now_s + 1e-9:
            rig.inbox.append(self._up.popleft()[1])
        rig.tick()
        if rig.status_seq != self._heard:
            self._heard = rig.status_seq
            if not self.down_lost:
                self._down.append((rig.now_s + self.down_s, self._heard, rig.status()))
        if self.paused:
            return
        while self._down and self._down[0][0] <= rig.now_s + 1e-9:
            _, seq, status = self._down.popleft()
            self.protocol.receive_status(status, seq, rig.now_s)
        if self.protocol.has_lease:
            self.send(self.protocol.poll_command(rig.now_s))

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds / PERIOD_S)):
            self.tick()

    def drive_for(self, inputs: int, ticks: int, age_s: float) -> float:
        """Apply inputs of some age every few periods; return how long the robot drove."""
        moved_s = 0.0
        for _ in range(inputs):
            self.give(age_s)
            for _ in range(ticks):
                self.tick()
                moved_s += self.drives * PERIOD_S
        return moved_s
