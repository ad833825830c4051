"""Simulated robots in virtual time, without bus, clock or threads.

`SimulatedRobot` has the interface of a client; time advances only in calls that wait: `drive`,
`go_to`, `sleep`, arming, iterators. `VirtualRobot`, for experiments, is stepped explicitly. Both
run the controller of the real robot, with the same lease, command gate and limits.
"""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Sequence
from functools import partial

import msgspec
import numpy as np

from tsd_twin import robots
from tsd_twin.client.errors import ClientError
from tsd_twin.client.link import Link
from tsd_twin.client.protocol import ControlProtocol, TwistCommand
from tsd_twin.client.state import RobotState
from tsd_twin.client.sync import RobotClient
from tsd_twin.control import RobotController
from tsd_twin.lie import SE2, Array
from tsd_twin.link_emulation.link import LinkModel
from tsd_twin.link_emulation.spec import LinkSpec
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import Odometry, wrapped_heading
from tsd_twin.messages.status import LoopStatus, RobotStatus
from tsd_twin.messages.topics import Sample, Service
from tsd_twin.robots import RobotDescription
from tsd_twin.simulation import SimRobot

PERIOD_S = 0.01
_STATE_EVERY = 2
_MESSAGE_BYTES = 700
"""Approximate size of a status or an odometry message."""
_STATUS_EVERY = 5
"""Status every 5 periods (20 Hz)."""
_EXACT = np.zeros((3, 3))
_NOWHERE = np.zeros(3)
"""Pose of a sphere that turns in place."""


class SimulationLink(Link):
    """Link to a robot in virtual time, with its controller and simulated joints at 100 Hz.

    `network` delays and drops commands, statuses and the odometry of protocols, like datagrams.
    Responses of services take its mean delay, and are never lost; renewals take none.
    """

    def __init__(
        self,
        robot: RobotDescription,
        simulated: SimRobot,
        pose: SE2 | None,
        network: LinkSpec = LinkSpec(),  # noqa: B008  Immutable.
    ) -> None:
        super().__init__()
        self.id = robot.name
        self.virtual = True
        self.robot = robot
        self.simulated = simulated
        self.lock = threading.RLock()
        numbers = itertools.count(1)  # Deterministic lease ids.
        self.controller = RobotController(
            robot, lambda: next(numbers).to_bytes(16, "big"), pose=pose
        )
        """Controller of the robot, to observe it; commands come from protocols."""
        self._tick = 0
        up, down = (np.random.default_rng((network.seed, way)) for way in range(2))
        self._up = LinkModel[Sample](network, up, 0.0)
        self._down = LinkModel[Callable[[float], None]](network, down, 0.0)
        self._one_way_s = network.delay_s + network.jitter_s
        self._received_seq = 0
        self._poses: list[Sample] = []
        self._mode = self.controller.supervisor.mode
        self._status = self.controller.status(0.0, LoopStatus(), simulated.hardware())
        self._status_seq = 0
        self._step()

    def now_s(self) -> float:
        """Return the virtual time."""
        return self._tick * PERIOD_S

    def wall_ns(self) -> int:
        """Return the virtual time in nanoseconds, also used as the robot's wall clock."""
        return self._tick * round(PERIOD_S * 1e9)

    def call(self, service: Service, payload: bytes, timeout_s: float) -> bytes | None:  # noqa: ARG002  Interface.
        """Call a service of the controller and return its response, after a round trip."""
        self.sleep_until(self.now_s() + self._one_way_s)
        answer = self._serve(service, payload)
        self.sleep_until(self.now_s() + self._one_way_s)
        return answer

    def _serve(self, service: Service, payload: bytes) -> bytes:
        if service is Service.STOP:
            return msgspec.json.encode(self.controller.stop(payload, self.now_s()))
        return msgspec.json.encode(self.controller.serve(service, payload, self.now_s()))

    def send(self, command: TwistCommand) -> None:
        """Send a command, which arrives at the next step or later."""
        key = topics.twist_key(self.id, command.operator)
        sample = Sample(key, command.payload, command.attachment)
        self._up.send(sample, len(command.payload) + len(command.attachment), self.now_s())

    def send_stop(self, payload: bytes) -> None:
        """Stop and latch the robot."""
        self.controller.stop(payload, self.now_s())

    def send_pose(self, payload: bytes) -> None:
        """Queue a pose measurement for the next step."""
        self._poses.append(Sample(topics.SENSOR_POSE.key(self.id), payload, b""))

    def sleep_until(self, until_s: float) -> None:
        """Advance virtual time to `until_s`."""
        while self.now_s() < until_s - 1e-9:
            self._step()

    def wait_for_status(self, until_s: float) -> None:
        """Advance virtual time to the next status, at most to `until_s`."""
        seen = self._received_seq
        while self._received_seq == seen and self.now_s() < until_s - 1e-9:
            self._step()

    def state(self) -> RobotState:
        """Return the current state."""
        controller, stamp_ns = self.controller, self.wall_ns()
        odometry = controller.odometry(stamp_ns).wrapped()
        alternative = controller.alternative_odometry(stamp_ns)
        joints, setpoint = controller.joint_state(stamp_ns), controller.setpoint_state(stamp_ns)
        truth = self.simulated.truth(self.now_s())
        exact = Odometry.of(truth.pose, truth.twist, _EXACT, _EXACT, stamp_ns).wrapped()
        return RobotState(
            self._status,
            self.now_s(),
            lambda: odometry,
            lambda: exact,
            lambda: None if alternative is None else alternative.wrapped(),
            lambda: joints,
            lambda: setpoint,
        )

    def attach(self, protocol: ControlProtocol) -> None:
        """Start passing states to a protocol and sending its due setpoints and renewals."""
        protocol.receive_status(self._status, self._status_seq, self.now_s())
        self._protocols.append(protocol)
        self._hand_odometry()
        self._deliver()

    def _step(self) -> None:
        """Run one control period, like the node."""
        self._send_due()
        self._tick += 1
        now_s = self.now_s()
        measured = self.simulated.read(now_s)
        if self._poses:
            self.controller.add_pose_measurements(self._poses, now_s, self.wall_ns())
            self._poses = []
        inbox = self._up.receive(now_s)
        self.simulated.write(self.controller.step(now_s, measured, inbox), now_s)
        for event in self.controller.take_events():
            self._put_event(event)
        if self._tick % _STATUS_EVERY == 0 or self.controller.supervisor.mode is not self._mode:
            self._send_status(now_s)
        if self._tick % _STATE_EVERY == 0:
            self._hand_odometry()
            if self._states:
                self._put_state(self.state())
        self._deliver()

    def _deliver(self) -> None:
        now_s = self.now_s()
        for arrive in self._down.receive(now_s):
            arrive(now_s)

    def _send_status(self, now_s: float) -> None:
        self._mode = self.controller.supervisor.mode
        self._status = self.controller.status(now_s, LoopStatus(), self.simulated.hardware())
        self._status_seq += 1
        self.controller.record_status_sent(self._status_seq, now_s)
        arrive = partial(self._receive_status, self._status, self._status_seq)
        self._down.send(arrive, _MESSAGE_BYTES, now_s)

    def _receive_status(self, status: RobotStatus, seq: int, now_s: float) -> None:
        self._received_seq = seq
        for protocol in self._protocols:
            protocol.receive_status(status, seq, now_s)

    def _hand_odometry(self) -> None:
        if self._protocols:
            # Omit covariances, which dominate the cost of odometry.
            pose, twist = self.controller.pose, self.controller.end_twist
            xy_heading = wrapped_heading(pose.xy_heading) if isinstance(pose, SE2) else _NOWHERE
            arrive = partial(self._receive_odometry, xy_heading, twist)
            self._down.send(arrive, _MESSAGE_BYTES, self.now_s())

    def _receive_odometry(self, xy_heading: Array, twist: Array, now_s: float) -> None:
        for protocol in self._protocols:
            protocol.receive_odometry(xy_heading, twist, now_s)

    def _send_due(self) -> None:
        now_s = self.now_s()
        for protocol in self._protocols:
            if (command := protocol.poll_command(now_s)) is not None:
                self.send(command)
            if (renewal := protocol.renewal(now_s)) is not None:
                protocol.receive_renewal(renewal, self._serve(Service.LEASE, renewal), 0.0)


class SimulatedRobot(RobotClient):
    """Simulated robot in virtual time with the interface of `RobotClient`; seeded.

    Single-threaded: `on_state` and `on_event` call back on the thread that advances time.
    """

    def __init__(
        self,
        robot: str = "tsd",
        *,
        seed: int | None = 0,
        noise: float = 0.0,
        errors: float = 0.0,
        plant: str = "kinematic",
        pose: Sequence[float] | None = None,
    ) -> None:
        """Simulate a shipped robot (by name) or the robot in a TOML file (by path).

        `noise` and `errors` scale the values in the description, `plant` is `kinematic` or
        `mujoco`, and `pose` is the initial (x, y, heading) in metres and radians.

        Raises:
            RobotFileError: If the description is invalid or incompatible with the plant.
            ClientError: If `pose` is given for a robot that turns a sphere.
        """
        description = robots.load_robot(robot)
        start = None if pose is None else SE2(np.array(pose, dtype=float))
        if start is not None and description.kinematics().pose_type is not SE2:
            sentence = f"{description.name} turns a sphere in place: it has no such pose"
            raise ClientError(sentence, "no_such_pose")
        simulated = SimRobot(description, seed, noise, pose=start, plant=plant, errors=errors)
        super().__init__(SimulationLink(description, simulated, start), "script")
