"""Client of a robot behind a delayed link in virtual time: protocol and controller, no bus."""

from __future__ import annotations

import math
from collections import deque

from tests.support.controller_harness import PERIOD_S, ControllerHarness
from tsd_twin import robots
from tsd_twin.client.errors import ClientError
from tsd_twin.client.protocol import ControlProtocol, TwistCommand
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.services import LeaseReply
from tsd_twin.messages.status import RobotStatus
from tsd_twin.messages.topics import Sample, twist_key

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
        """When the newest input was given."""
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
        """Set a velocity that was given some time ago."""
        now_s = self.rig.now_s
        self.given_s = max(self.given_s, now_s - age_s)
        try:
            self.send(self.protocol.set_velocity(PUSH, "base_link", now_s, now_s - age_s))
        except ClientError as error:
            self.failures.append(str(error))

    def send(self, command: TwistCommand | None) -> None:
        """Hand a command to the link."""
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
        """Give inputs of an age, one every few periods; return for how long the robot drove."""
        moved_s = 0.0
        for _ in range(inputs):
            self.give(age_s)
            for _ in range(ticks):
                self.tick()
                moved_s += self.drives * PERIOD_S
        return moved_s
