"""Runs of a logged controller in virtual time with every kind of input."""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tests.support.controller_harness import ControllerHarness, HarnessOperator
from tsd_twin import robots
from tsd_twin.control import LoggedController
from tsd_twin.control.logged_controller import (
    Call,
    InputBatch,
    StepCall,
    decode_batch,
    encode_batch,
)
from tsd_twin.lie import SE2
from tsd_twin.messages import topics
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.pose import PoseStamped, encode_pose
from tsd_twin.messages.status import LoopStatus
from tsd_twin.messages.topics import Sample, Service
from tsd_twin.robots import RobotDescription
from tsd_twin.simulation import SimRobot

GYRO = "tsd with a gyro"
TEXTS = {name: robots.read_description(name) for name in robots.robot_names()} | {
    GYRO: robots.read_description("tsd") + "\n[gyro]\n"
}
"""Descriptions of all shipped robots, and of one with a gyro."""
WALL_NS = 1_700_000_000_000_000_000


@dataclass(slots=True)
class LoggedRun:
    """Recorded run, and the times of its events."""

    robot: RobotDescription
    text: str
    batches: list[InputBatch] = field(default_factory=list[InputBatch])
    moments: dict[str, float] = field(default_factory=dict[str, float])
    """Robot time of the first occurrence of each event, by name."""

    @property
    def calls(self) -> Iterator[Call]:
        for batch in self.batches:
            yield from batch.calls

    @property
    def steps(self) -> list[StepCall]:
        return [call for call in self.calls if isinstance(call, StepCall)]

    def first(self, what: str) -> float:
        return self.moments[what]


class LoggedHarness(ControllerHarness):
    """Harness with a logged controller and a noisy simulated robot.

    Batches have 20 periods and a snapshot each, like those on the bus.
    """

    def __init__(self, text: str, seed: int, start: SE2 | None = None) -> None:
        robot = robots.parse_description(text, "test")
        self.random = np.random.default_rng(seed)
        self.run = LoggedRun(robot, text)
        simulated = SimRobot(robot, seed, 1.0, errors=1.0)
        super().__init__(simulated, start_s=100.0, robot=robot)
        # Replace the parent's controller, which has already run one period.
        self.controller = LoggedController(
            robot, lambda: secrets.token_bytes(16), pose=start, build="test"
        )
        self.setpoint = self.controller.setpoint
        self.logged: LoggedController = self.controller
        self._untaken = 0
        """Number of periods since the last batch."""

    def tick(self, dt_s: float = 0.01) -> None:
        """Run one period; some are late."""
        before = self.mode
        super().tick(dt_s + self.random.uniform(-2e-4, 2e-4) if dt_s else 0.0)
        if not hasattr(self, "logged"):
            return
        self._untaken += 1
        if self.status_seq and self.status_sent_s[self.status_seq] == self.now_s:
            self.controller.status(self.now_s, LoopStatus(), {})
        if self.mode is not before:
            self.mark(str(self.mode))
        if self._untaken >= 20:
            self.take()

    def take(self) -> None:
        self._untaken = 0
        batch = self.logged.take_log(snapshot=True)
        self.run.batches.append(decode_batch(encode_batch(batch)))  # As received from the bus.

    def mark(self, what: str) -> None:
        self.run.moments.setdefault(what, self.now_s)

    def show(self, pose: SE2) -> None:
        """Send camera poses 60 ms late."""
        wall_ns = WALL_NS + round(self.now_s * 1e9)
        message = PoseStamped.planar(pose, wall_ns - 60_000_000)
        sample = Sample(topics.SENSOR_POSE.key("tsd"), encode_pose(message), b"")
        self.controller.add_pose_measurements([sample], self.now_s, wall_ns)


def eventful_run(text: str, seed: int = 1) -> LoggedRun:
    """Return a run with all kinds of commands, losses, a stop, a hand-over and camera poses."""
    planar = robots.parse_description(text, "test").kinematics().pose_type is SE2
    start = SE2(np.array([0.3, -0.2, 0.4])) if planar else None
    harness = LoggedHarness(text, seed, start)
    harness.wait(0.3)
    alice = harness.get_ready("alice")
    _drive(harness, alice, planar)
    _disturb(harness, alice)
    bob = _hand_over(harness, alice)
    _change_speed(harness, bob)
    _stop_and_reset(harness, bob)
    _let_run_out(harness, bob)
    harness.take()
    return harness.run


def _drive(harness: LoggedHarness, alice: HarnessOperator, planar: bool) -> None:
    harness.mark("first command")
    for i in range(150):
        if i % 2 == 0:
            frame = "odom" if planar and i > 80 else "base_link"
            harness.send(alice, (0.4, 0.1 * np.sin(0.05 * i), 0.3), frame)
        if planar and i % 4 == 0:
            assert harness.simulated is not None
            pose = harness.simulated.truth(harness.now_s).pose
            assert isinstance(pose, SE2)
            harness.show(pose)
        harness.tick()
    # Other processes used the processor for some time.
    harness.mark("overrun")
    harness.send(alice, (0.5, 0.1, 0.3))
    harness.tick(0.047)
    harness.drive(alice, (0.5, 0.0, 0.3), 0.3)


def _disturb(harness: LoggedHarness, alice: HarnessOperator) -> None:
    key = "twin/tsd/cmd/alice/twist"
    harness.inbox += [
        Sample(key, b"\x00\x01", b"short"),
        Sample("twin/tsd/cmd/*/twist", b"", b""),
        Sample(key, b"", b"", is_put=False),
        harness.sample(alice, (np.nan, 0.0, 0.0)),
        harness.sample(alice, (0.2, 0.0, 0.0), lease="ab" * 16),
        harness.sample(alice, (0.2, 0.0, 0.0), seq=1),
        harness.sample(alice, (0.2, 0.0, 0.0), status_seq=1),
    ]
    harness.drive(alice, (0.3, 0.0, 0.0), 0.2)
    harness.measures = False
    harness.drive(alice, (0.3, 0.0, 0.0), 0.04)
    harness.measures = True
    harness.drive(alice, (0.3, 0.0, 0.0), 0.2)
    harness.wait(0.8)  # All commands are lost.
    harness.drive(alice, (0.0, 0.0, 0.2), 0.3)


def _hand_over(harness: LoggedHarness, alice: HarnessOperator) -> HarnessOperator:
    for payload in (b"", b"{", b"\xff", b'{"lease": 3}'):
        harness.controller.serve(Service.ARM, payload, harness.now_s)
    assert harness.ask(Service.LEASE, op="request", operator="bob").done
    harness.drive(alice, (0.2, 0.0, 0.0), 0.2)
    granted = harness.ask(
        Service.LEASE, op="grant", operator="alice", lease=alice.lease, asker="bob"
    )
    assert granted.done
    harness.mark("grant")
    harness.wait(0.3)
    bob = harness.acquire("bob", max_age_s=0.5)
    harness.drive(bob, (-0.2, 0.0, 0.1), 0.8)
    carol = harness.acquire("carol", take_over=True, reason="a test")
    harness.wait(0.6)
    return carol


def _change_speed(harness: LoggedHarness, pilot: HarnessOperator) -> None:
    reply = harness.ask(Service.SPEED, lease=pilot.lease, cruise_speed_rpm=3000.0)
    if reply.ok:
        harness.mark("speed")
    harness.drive(pilot, (0.2, 0.0, 0.1), 1.0)
    harness.drive(pilot, (0.0, 0.0, 0.0), 0.6)
    fields: dict[str, Any] = {"x_m": 1.0, "y_m": 2.0, "heading_rad": 0.5}
    harness.ask(Service.SET_POSE, lease=pilot.lease, **fields)
    harness.drive(pilot, (0.2, 0.0, 0.0), 0.3)


def _stop_and_reset(harness: LoggedHarness, pilot: HarnessOperator) -> None:
    harness.controller.stop(b'{"operator": "dave", "reason": "a cat"}', harness.now_s)
    harness.controller.stop(b"\x00garbage", harness.now_s)
    harness.wait(1.0)
    assert harness.mode is Mode.STOPPED
    pilot = harness.acquire(pilot.name, take_over=True)
    assert harness.ask(Service.RESET, lease=pilot.lease).ok
    harness.wait(0.2)


def _let_run_out(harness: LoggedHarness, pilot: HarnessOperator) -> None:
    harness.ask(Service.LEASE, op="peek", operator=pilot.name)
    harness.wait(2.2)
    harness.controller.take_events()
