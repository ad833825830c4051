"""Connection to one robot over the bus: services, commands, streams, and its newest state, polled.

It belongs to no operator: several may command the robot over one connection, as the pages of a
dashboard do. `link` has the connection of a script, with callbacks.
"""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal, TypeAlias

import msgspec
import numpy as np

from tsd_twin import robots
from tsd_twin.bus import Bus, Publisher, Subscriber
from tsd_twin.client.instances import Instances, live_count, stop_instances
from tsd_twin.client.protocol import TwistCommand
from tsd_twin.errors import BusError, MessageError, NoAnswerError, SeveralAnswersError
from tsd_twin.lie import SO3, Array
from tsd_twin.messages import topics
from tsd_twin.messages.requests import (
    Description,
    Sample,
    decode_json,
    duplicate_id_text,
    encode_refusal,
)
from tsd_twin.messages.ros import JointState, Odometry, decode_joints, decode_odometry
from tsd_twin.messages.status import Refusals, Status, decode_stamp, decode_status
from tsd_twin.messages.topics import QoS, Service, Topic
from tsd_twin.robots import RobotDescription

_DESCRIPTION_S = 5.0
"""A session that has just joined does not hear of every robot at once."""
_ASK_AGAIN_S = 0.02
_DESCRIPTION_BYTES = 2**20
"""A description is its TOML and its URDF, some 30 kB."""
_MAX_SENT_COMMANDS = 100


@dataclass(frozen=True, slots=True, eq=False)
class SentCommand:
    """Twist command sent over a connection."""

    sent_s: float
    """On the monotonic clock."""
    twist: Array
    """(3,): m/s and rad/s in `frame`."""
    frame: str


class RobotConnection:
    """Connection to one robot on the bus; every method may be called from any thread."""

    virtual = False

    def __init__(
        self,
        bus: Bus,
        robot_id: str,
        answer: bytes | None = None,
        instances: Instances | None = None,
    ) -> None:
        """Read the description of a robot; without its `answer`, request it and wait.

        `instances` are those of all robots on the bus, if they are known already.

        Raises:
            BusError: the robot does not answer.
            MessageError: its answer is no description.
            RobotFileError: its description cannot be used.
        """
        self.id = topics.checked(robot_id)
        self.lock = threading.RLock()
        """Guards the protocols of the operators."""
        self._bus = bus
        self._instances = instances or Instances(bus, robot_id)
        answer = self._describe() if answer is None else answer
        if len(answer) > _DESCRIPTION_BYTES:
            raise MessageError("shape", f"a description of {len(answer)} bytes is too long")
        self.description = decode_json(answer, Description, "a description")
        """TOML and URDF."""
        self.robot: RobotDescription = robots.parse_description(
            self.description.robot, f"description of {robot_id}"
        )
        self.kinematics = self.robot.kinematics()
        turning = self.kinematics.pose_type is SO3
        self.decode_odometry: Callable[[bytes], Odometry] = partial(
            decode_odometry, turning=turning
        )
        """Decoder of the topics with poses."""
        self._publishers: dict[str, Publisher] = {}
        self._publishers_lock = threading.Lock()  # A stop waits for no operator.
        self._sent_commands: deque[SentCommand] = deque(maxlen=_MAX_SENT_COMMANDS)
        self._publisher(Service.STOP.key(self.id), QoS.REAL_TIME, "json")  # Ready when needed.

    def _describe(self) -> bytes:
        end_s = time.monotonic() + _DESCRIPTION_S
        while True:
            try:
                return self._bus.query(Service.DESC.key(self.id), b"")
            except NoAnswerError:
                if time.monotonic() > end_s:
                    raise
                time.sleep(_ASK_AGAIN_S)  # Without such a robot the answer is none, and at once.
            except SeveralAnswersError:
                raise BusError(duplicate_id_text(self.id)) from None

    def now_s(self) -> float:
        """Return the time of the monotonic clock."""
        return time.monotonic()

    def wall_ns(self) -> int:
        """Return the wall clock of this machine."""
        return time.time_ns()

    @property
    def has_duplicate(self) -> bool:
        """Whether another robot or a replay on the bus has the same id, so that streams mix."""
        return len(self._instances.of(self.id)) > 1

    def call(self, service: Service, payload: bytes, timeout_s: float) -> bytes | None:
        """Return the answer of a service, None when there is none in time; blocks.

        While several instances have the id, only a stop is sent; the answer refuses the others.
        """
        instances = self._instances.of(self.id)
        refusal = encode_refusal(service, duplicate_id_text(self.id))
        try:
            if service is Service.STOP:
                return stop_instances(self._bus, self.id, payload, timeout_s, instances)
            if len(instances) > 1:
                return refusal
            return self._bus.query(service.key(self.id), payload, timeout_s)
        except SeveralAnswersError:  # Of an instance whose token has not arrived yet.
            return refusal
        except BusError:
            return None

    def send(self, command: TwistCommand) -> None:
        """Publish a command, unless several instances have the id; without it, the robot stops."""
        if self.has_duplicate:
            return
        key = topics.twist_key(self.id, command.operator)
        self._sent_commands.append(SentCommand(time.monotonic(), command.twist, command.frame))
        self._put(key, topics.TWIST.type, command.payload, command.attachment)

    @property
    def sent_commands(self) -> Sequence[SentCommand]:
        """Recent commands of this connection, oldest first; some may still be in transit."""
        return tuple(self._sent_commands)

    def send_stop(self, payload: bytes) -> None:
        """Publish a stop, without an acknowledgement."""
        self._put(Service.STOP.key(self.id), "json", payload)

    def send_pose(self, payload: bytes) -> None:
        """Publish a pose measurement, unless several instances have the id."""
        if self.has_duplicate:
            return
        topic = topics.SENSOR_POSE
        self._put(topic.key(self.id), topic.type, payload, qos=topic.qos)

    def subscriber(self, topic: Topic, depth: int) -> Subscriber:
        """Return a subscriber that queues at most `depth` samples of a topic of the robot."""
        return self._bus.subscriber(topic.key(self.id), depth)

    def subscribe(self, topic: Topic, take: Callable[[Sample], None]) -> None:
        """Call `take` with every sample of a topic of the robot, on a thread of the bus."""
        self._bus.subscribe(topic.key(self.id), take)

    def close(self) -> None:
        """Close the publishers; the bus stays open."""
        with self._publishers_lock:
            for publisher in self._publishers.values():
                publisher.close()
            self._publishers.clear()

    def _put(
        self,
        key: str,
        kind: str,
        payload: bytes,
        attachment: bytes = b"",
        qos: QoS = QoS.REAL_TIME,
    ) -> None:
        with contextlib.suppress(BusError):
            self._publisher(key, qos, kind).put(payload, attachment)

    def _publisher(self, key: str, qos: QoS, kind: str) -> Publisher:
        with self._publishers_lock:
            if key not in self._publishers:
                self._publishers[key] = self._bus.publisher(key, qos, kind)
            return self._publishers[key]


def numbered_status(sample: Sample) -> tuple[Status, int]:
    """Return the status in a sample of `state/status`, and its number.

    Raises:
        MessageError: it is none.
    """
    return decode_status(sample.payload), decode_stamp(sample.attachment)[0]


MAX_ROUND_TRIPS = 40
"""Round trips that count: the last ten seconds."""


Source: TypeAlias = Literal["robot", "recording", "several"]
"""Sender of a state; `several` instances have one id, so their states mix."""


class RoundTrips:
    """Recent round-trip times; written by one thread, read by any."""

    def __init__(self) -> None:
        self._trips_s: deque[float] = deque(maxlen=MAX_ROUND_TRIPS)

    def add(self, trip_s: float) -> None:
        """Add a round-trip time."""
        self._trips_s.append(trip_s)

    def clear(self) -> None:
        """Discard all times, after a missing response."""
        self._trips_s.clear()

    def median_s(self) -> float | None:
        """Return the median; None without data."""
        return self._quantile(0.5)

    def p95_s(self) -> float | None:
        """Return the 95th percentile; None without data."""
        return self._quantile(0.95)

    def jitter_s(self) -> float | None:
        """Return the 95th percentile minus the median; None without data."""
        typical_s, late_s = self.median_s(), self.p95_s()
        return None if typical_s is None or late_s is None else late_s - typical_s

    def _quantile(self, share: float) -> float | None:
        ordered = sorted(self._trips_s)
        if not ordered:
            return None
        return ordered[max(0, math.ceil(share * len(ordered)) - 1)]


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """Newest state messages of a robot."""

    joints: JointState | None = None
    setpoint: JointState | None = None
    odom: Odometry | None = None
    odom_received_s: float = -np.inf
    """When that came in, on the clock given to `poll`."""
    alternative: Odometry | None = None
    """Alternative estimate, of robots that have two."""
    truth: Odometry | None = None
    status: Status | None = None
    source: Source = "robot"
    """Sender of the status."""
    status_seq: int = 0
    status_robot_s: float = 0.0
    """When the robot sent the status, on its monotonic clock."""
    received_s: float = -np.inf
    """When the newest of these came in, on the clock given to `poll`."""


_NO_MESHES = (
    "The description names a folder of meshes. A dashboard reads no files that a robot names: "
    "the generated look is shown."
)


class RobotMonitor(RobotConnection):
    """Connection that keeps the newest state of a robot: `poll` decodes what has come in.

    `poll` and `set_streaming` belong to one thread; all else may be called from any.
    """

    def __init__(
        self,
        bus: Bus,
        robot_id: str,
        answer: bytes | None = None,
        instances: Instances | None = None,
    ) -> None:
        """Read the description and subscribe; as `RobotConnection`."""
        super().__init__(bus, robot_id, answer, instances)
        self.ignored = ""
        """Sentence that names ignored parts of the description; empty without any."""
        if self.robot.body.meshes is not None:
            # A folder on the robot's computer; on this one the path names other files.
            self.ignored = _NO_MESHES
            body = msgspec.structs.replace(self.robot.body, meshes=None)
            self.robot = msgspec.structs.replace(self.robot, body=body)
        self.snapshot = Snapshot()
        self.round_trips = RoundTrips()
        """Measured round-trip times."""
        self._frozen: Status | None = None
        self._streams: dict[str, tuple[Topic, Callable[[bytes], Any]]] = {
            "joints": (topics.JOINTS, decode_joints),
            "setpoint": (topics.SETPOINT, decode_joints),
            "odom": (topics.ODOM, self.decode_odometry),
            "alternative": (topics.ODOM_ALTERNATIVE, self.decode_odometry),
            "truth": (topics.TRUTH, self.decode_odometry),
        }
        self._subscribers: dict[str, Subscriber] = {}
        self.set_streaming(True)
        self._status = self.subscriber(topics.STATUS, 1)

    @property
    def is_recording(self) -> bool:
        """Whether only replays have this id; without liveliness tokens, as the status says."""
        if instances := self._instances.of(self.id):
            return live_count(instances) == 0
        status = self.snapshot.status
        return status is not None and status.is_recording

    def close(self) -> None:
        """Close all subscriptions and publishers; the bus stays open."""
        for subscriber in self._subscribers.values():
            subscriber.close()
        self._status.close()
        super().close()

    def set_streaming(self, on: bool) -> None:
        """Subscribe to all that is drawn, or to the status only; belongs to the thread of `poll`.

        A robot does not even make messages that have no subscriber. What was drawn before is
        forgotten then: it must not look like news to the page that opens next.
        """
        if on == bool(self._subscribers):
            return
        if on:
            self._subscribers = {
                name: self.subscriber(topic, 1) for name, (topic, _) in self._streams.items()
            }
            return
        for subscriber in self._subscribers.values():
            subscriber.close()
        self._subscribers = {}
        self.snapshot = Snapshot(
            status=self.snapshot.status,
            source=self.snapshot.source,
            status_seq=self.snapshot.status_seq,
            status_robot_s=self.snapshot.status_robot_s,
            received_s=self.snapshot.received_s,
        )

    def poll(self, now_s: float) -> bool:
        """Process received messages, and return whether there is a new status.

        While another robot has the same id, the snapshot does not change and the status says why:
        the messages of both would mix.
        """
        fresh: dict[str, Any] = {}
        new_status = self._poll_streams(fresh, now_s)
        if self.has_duplicate:
            fresh = self._of_two(fresh) if new_status else {}
        else:
            self._frozen = None
            if new_status:
                recorded = self.is_recording or fresh["status"].is_recording
                fresh["source"] = "recording" if recorded else "robot"
        if fresh:
            self.snapshot = replace(self.snapshot, **fresh, received_s=now_s)
        return new_status

    def _of_two(self, fresh: dict[str, Any]) -> dict[str, Any]:
        if self._frozen is None:
            reason = duplicate_id_text(self.id)
            self._frozen = msgspec.structs.replace(
                self.snapshot.status or fresh["status"],
                mode="fault",
                stop_reason=reason,
                arming=None,
                refusals=Refusals(arm=reason, drive=reason, set_pose=reason, speed=reason),
            )
        number = self.snapshot.status_seq + 1
        return {"status": self._frozen, "status_seq": number, "source": "several"}

    def _poll_streams(self, fresh: dict[str, Any], now_s: float) -> bool:
        for name, subscriber in self._subscribers.items():
            if (sample := subscriber.newest()) is not None:
                try:
                    fresh[name] = self._streams[name][1](sample.payload)
                except MessageError:
                    continue  # Invalid sample; the age of the state shows it.
        if "odom" in fresh:
            fresh["odom_received_s"] = now_s
        return self._poll_status(fresh)

    def _poll_status(self, fresh: dict[str, Any]) -> bool:
        sample = self._status.newest()
        if sample is None:
            return False
        try:
            fresh["status"], fresh["status_seq"] = numbered_status(sample)
            fresh["status_robot_s"] = 1e-9 * decode_stamp(sample.attachment)[1]
        except MessageError:
            return False
        return True
