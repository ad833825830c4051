"""The robot node: one loop between the bus, the core and the joints of one robot."""

from __future__ import annotations

import logging
import secrets
import threading
import time

import msgspec
import numpy as np

from tsd_twin import topics
from tsd_twin.bus import Bus, Publisher
from tsd_twin.core import RobotCore
from tsd_twin.errors import BusError
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages.ros import Odometry, encode_joints, encode_odometry
from tsd_twin.messages.service import Description, Event
from tsd_twin.messages.status import encode_stamp, encode_status
from tsd_twin.node.namesakes import Namesakes
from tsd_twin.node.rate import RateKeeper
from tsd_twin.node.robot_io import Guarded, RobotIO, Simulated
from tsd_twin.robots import Robot
from tsd_twin.topics import Service, Urgency

_LOG = logging.getLogger(__name__)

PERIOD_S = 0.01
_EXACT = np.zeros((3, 3))
_STATE_EVERY = 2  # 50 Hz
_STATUS_EVERY = 5  # 20 Hz
_COMMANDS_KEPT = 64
"""More than operators that may send within a period; a flood makes the oldest give way."""

_POSES_KEPT = 32
"""More than cameras send in a period, also after a link was held up."""


class RobotNode:
    """Runs the core of one robot at 100 Hz; whatever ends it, the robot is left at rest.

    One thread does everything, so no rule of the core depends on how threads interleave.
    """

    def __init__(
        self,
        bus: Bus,
        robot_id: str,
        robot: Robot,
        io: RobotIO,
        description: Description,
        *,
        pose: SE2 | SO3 | None = None,
    ):
        """Claim the robot id on the bus; `pose` is where the robot is taken to be.

        Raises:
            BusError: the id is taken, or cannot be one.
        """
        alive = topics.alive_key(topics.checked(robot_id))
        if bus.living(alive):
            raise BusError(
                f"a robot with the id '{robot_id}' is on the bus already: choose another"
            )
        self._bus = bus
        self._id = robot_id
        self._io = io
        self._guard = io if isinstance(io, Guarded) else None
        self._core = RobotCore(robot, lambda: secrets.token_bytes(16), pose=pose)
        self._description = msgspec.json.encode(description)
        self._commands = bus.reader(topics.TWIST.key(robot_id), _COMMANDS_KEPT)
        self._poses = bus.reader(topics.OUTSIDE_POSE.key(robot_id), _POSES_KEPT)
        self._stops = bus.reader(topics.STOP.key(robot_id), 8)
        # To describe itself has no effect; a stop by who explores the bus would have one.
        self._servers = {
            service: bus.server(service.key(robot_id), patterns=service is Service.DESC)
            for service in Service
        }
        states = tuple(topic for topic in topics.TOPICS if topic.path.startswith("state/"))
        self._publishers = {
            topic: bus.publisher(topic.key(robot_id), topic.urgency, topic.type) for topic in states
        }
        self._event_publishers: dict[str, Publisher] = {}
        self._numbers = dict.fromkeys(states, 0)
        self._mode = self._core.authority.mode
        self._namesakes = Namesakes(bus, robot_id)
        # Last: who hears of the robot may ask it at once.
        self._token = bus.announce(alive)

    def run(self, stop: threading.Event) -> None:
        """Run until `stop` is set; the last thing the robot hears is to be at rest."""
        rate = RateKeeper(PERIOD_S)
        tick = 0
        try:
            while not stop.is_set():
                self._tick(rate.wait(stop), tick, rate)
                tick += 1
        finally:
            self._leave()

    def _leave(self) -> None:
        now_s = time.monotonic()
        self._core.stop(b'{"reason": "the node ended"}', now_s)
        try:
            self._write(self._core.step(now_s, None, ()), now_s)
        finally:
            self._io.close()
            self._token.close()
            self._namesakes.close()

    def _tick(self, now_s: float, tick: int, rate: RateKeeper) -> None:
        measured = self._io.read(now_s)
        for sample in self._stops.take():
            self._core.stop(sample.payload, now_s)
        self._serve(now_s)
        commands = self._commands.take()
        if poses := self._poses.take():
            self._core.see(poses, now_s, time.time_ns())
        self._write(self._core.step(now_s, measured, commands, self._fault(now_s)), now_s)
        self._publish(now_s, tick, bool(commands), rate)

    def _fault(self, now_s: float) -> str:
        # Two robots that obey the same commands are worse than what a board objects to.
        return self._namesakes.step(now_s) or (self._guard.fault(now_s) if self._guard else "")

    def _write(self, setpoint: Array, now_s: float) -> None:
        if self._guard:
            self._guard.vouch(self._core.authority.mandate)
        self._io.write(setpoint, now_s)

    def _serve(self, now_s: float) -> None:
        for service, server in self._servers.items():
            for request in server.take():
                if service is Service.DESC:
                    request.reply(self._description)
                else:
                    reply = self._core.serve(service, request.payload, now_s)
                    request.reply(msgspec.json.encode(reply))

    def _publish(self, now_s: float, tick: int, commanded: bool, rate: RateKeeper) -> None:
        core, stamp_ns = self._core, time.time_ns()
        state_due = tick % _STATE_EVERY == 0
        # A new command shows in the set-point at once: half a period sooner on average.
        if state_due or commanded:
            self._put(topics.SETPOINT, encode_joints(core.setpoint_state(stamp_ns)), now_s)
        if state_due:
            self._put(topics.JOINTS, encode_joints(core.joint_state(stamp_ns)), now_s)
            self._publish_poses(now_s, stamp_ns)
        for event in core.take_events():
            self._put_event(event)
        if (met := self._namesakes.take_event()) is not None:
            self._put_event(met)
        if tick % _STATUS_EVERY == 0 or core.authority.mode is not self._mode:
            self._mode = core.authority.mode
            status = core.status(now_s, rate.status(), self._io.hardware())
            number = self._put(topics.STATUS, encode_status(status), now_s)
            core.note_status_sent(number, now_s)

    def _publish_poses(self, now_s: float, stamp_ns: int) -> None:
        self._put(topics.ODOM, encode_odometry(self._core.odometry(stamp_ns)), now_s)
        other = self._core.other_odometry(stamp_ns)
        if other is not None:
            self._put(topics.OTHER_ODOM, encode_odometry(other), now_s)
        if isinstance(self._io, Simulated):
            truth = self._io.truth(now_s)
            message = Odometry.of(truth.pose, truth.twist, _EXACT, _EXACT, stamp_ns)
            self._put(topics.TRUTH, encode_odometry(message), now_s)

    def _put(self, topic: topics.Topic, payload: bytes, now_s: float) -> int:
        self._numbers[topic] += 1
        number = self._numbers[topic]
        self._publishers[topic].put(payload, encode_stamp(number, int(now_s * 1e9)))
        return number

    def _put_event(self, event: Event) -> None:
        if event.kind not in self._event_publishers:
            key = topics.event_key(self._id, event.kind)
            self._event_publishers[event.kind] = self._bus.publisher(key, Urgency.EVENT)
        self._event_publishers[event.kind].put(msgspec.json.encode(event))
        _LOG.info("%s: %s", self._id, event.text)
