"""Connection to one robot: services, commands, streams and polling of the latest state.

It is not tied to an operator: several may command the robot over one connection, like the pages of
a dashboard. See `link` for callback-based connections of scripts.
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
from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.requests import (
    Description,
    Sample,
    decode_json,
    duplicate_id_text,
    encode_refusal,
)
from tsd_twin.messages.ros import JointState, Odometry, decode_joints, decode_odometry
from tsd_twin.messages.sentences import sentence
from tsd_twin.messages.status import Refusals, Status, decode_stamp, decode_status
from tsd_twin.messages.topics import QoS, Service, Topic
from tsd_twin.robots import RobotDescription

_DESCRIPTION_S = 5.0
"""A new session does not discover all robots immediately."""
_ASK_AGAIN_S = 0.02
_DESCRIPTION_BYTES = 2**20
"""A description (TOML and URDF) is about 30 kB."""
_MAX_SENT_COMMANDS = 100


@dataclass(frozen=True, slots=True, eq=False)
class SentCommand:
    """Twist command sent over a connection."""

    sent_s: float
    """Monotonic time."""
    twist: Array
    """(3,): m/s and rad/s in `frame`."""
    frame: str


class RobotConnection:
    """Thread-safe connection to one robot on the bus."""

    virtual = False

    def __init__(
        self,
        bus: Bus,
        robot_id: str,
        answer: bytes | None = None,
        instances: Instances | None = None,
    ) -> None:
        """Decode the description from `answer`, or request it if None.

        `instances` are the known instances of all robots on the bus, if available.

        Raises:
            BusError: If the robot does not respond.
            MessageError: If its response is not a description.
            RobotFileError: If its description is invalid.
        """
        self.id = topics.checked(robot_id)
        self.lock = threading.RLock()
        """Guards the operators' protocols."""
        self._bus = bus
        self._instances = instances or Instances(bus, robot_id)
        answer = self._describe() if answer is None else answer
        if len(answer) > _DESCRIPTION_BYTES:
            raise MessageError("shape", f"a description of {len(answer)} bytes is too long")
        self.description = decode_json(answer, Description, "a description")
        """Description as TOML and URDF."""
        self.robot: RobotDescription = robots.parse_description(
            self.description.robot, f"description of {robot_id}"
        )
        self.kinematics = self.robot.kinematics()
        turning = self.kinematics.pose_type is SO3
        self.decode_odometry: Callable[[bytes], Odometry] = partial(
            decode_odometry, turning=turning
        )
        """Decoder for pose topics."""
        self._publishers: dict[str, Publisher] = {}
        self._publishers_lock = threading.Lock()  # Lets a stop bypass operators.
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
                time.sleep(_ASK_AGAIN_S)  # If no such robot exists, the query fails immediately.
            except SeveralAnswersError:
                raise BusError(duplicate_id_text(self.id)) from None

    def now_s(self) -> float:
        """Return the monotonic time."""
        return time.monotonic()

    def wall_ns(self) -> int:
        """Return the wall-clock time of this machine."""
        return time.time_ns()

    @property
    def has_duplicate(self) -> bool:
        """Whether another robot or a replay has the same id, which mixes the streams."""
        return len(self._instances.of(self.id)) > 1

    def call(self, service: Service, payload: bytes, timeout_s: float) -> bytes | None:
        """Call a service and return its response, or None on timeout; blocking.

        If several instances have the id, only a stop is sent, and other calls return a refusal.
        """
        instances = self._instances.of(self.id)
        refusal = encode_refusal(service, because(Code.DUPLICATE_ID, robot=self.id))
        try:
            if service is Service.STOP:
                return stop_instances(self._bus, self.id, payload, timeout_s, instances)
            if len(instances) > 1:
                return refusal
            return self._bus.query(service.key(self.id), payload, timeout_s)
        except SeveralAnswersError:  # The token of another instance has not arrived yet.
            return refusal
        except BusError:
            return None

    def send(self, command: TwistCommand) -> None:
        """Publish a command, unless several instances have the id; the robot then stops."""
        if self.has_duplicate:
            return
        key = topics.twist_key(self.id, command.operator)
        self._sent_commands.append(SentCommand(time.monotonic(), command.twist, command.frame))
        self._put(key, topics.TWIST.type, command.payload, command.attachment)

    @property
    def sent_commands(self) -> Sequence[SentCommand]:
        """Recently sent commands, oldest first; some may still be in flight."""
        return tuple(self._sent_commands)

    def send_stop(self, payload: bytes) -> None:
        """Publish a stop without waiting for an acknowledgement."""
        self._put(Service.STOP.key(self.id), "json", payload)

    def send_pose(self, payload: bytes) -> None:
        """Publish a pose measurement, unless several instances have the id."""
        if self.has_duplicate:
            return
        topic = topics.SENSOR_POSE
        self._put(topic.key(self.id), topic.type, payload, qos=topic.qos)

    def subscriber(self, topic: Topic, depth: int) -> Subscriber:
        """Return a subscriber to a topic of the robot with a queue of `depth` samples."""
        return self._bus.subscriber(topic.key(self.id), depth)

    def subscribe(self, topic: Topic, take: Callable[[Sample], None]) -> None:
        """Call `take` with every sample of a topic of the robot, on a bus thread."""
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
    """Decode a sample of `state/status`; return the status and its sequence number.

    Raises:
        MessageError: If it is invalid.
    """
    return decode_status(sample.payload), decode_stamp(sample.attachment)[0]


MAX_ROUND_TRIPS = 40
"""Window of round trips (the last 10 s)."""


Source: TypeAlias = Literal["robot", "recording", "several"]
"""Sender of a state; `several` means that instances share one id and their states mix."""


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
        """Return the median, or None without data."""
        return self._quantile(0.5)

    def p95_s(self) -> float | None:
        """Return the 95th percentile, or None without data."""
        return self._quantile(0.95)

    def jitter_s(self) -> float | None:
        """Return the 95th percentile minus the median, or None without data."""
        typical_s, late_s = self.median_s(), self.p95_s()
        return None if typical_s is None or late_s is None else late_s - typical_s

    def _quantile(self, share: float) -> float | None:
        ordered = sorted(self._trips_s)
        if not ordered:
            return None
        return ordered[max(0, math.ceil(share * len(ordered)) - 1)]


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """Latest state messages of a robot."""

    joints: JointState | None = None
    setpoint: JointState | None = None
    odom: Odometry | None = None
    odom_received_s: float = -np.inf
    """Arrival time of `odom`, on the clock passed to `poll`."""
    alternative: Odometry | None = None
    """Second estimate, if the robot has one."""
    truth: Odometry | None = None
    status: Status | None = None
    source: Source = "robot"
    """Sender of the status."""
    status_seq: int = 0
    status_robot_s: float = 0.0
    """Send time of the status on the robot's monotonic clock."""
    received_s: float = -np.inf
    """Arrival time of the latest state, on the clock passed to `poll`."""


_NO_MESHES = (
    "The description names a folder of meshes. A dashboard reads no files that a robot names: "
    "the generated look is shown."
)


class RobotMonitor(RobotConnection):
    """Connection that keeps the latest state of a robot, updated by `poll`.

    Call `poll` and `set_streaming` from one thread; all other methods are thread-safe.
    """

    def __init__(
        self,
        bus: Bus,
        robot_id: str,
        answer: bytes | None = None,
        instances: Instances | None = None,
    ) -> None:
        """Read the description and subscribe; see `RobotConnection`."""
        super().__init__(bus, robot_id, answer, instances)
        self.ignored = ""
        """Message about ignored parts of the description, or ""."""
        if self.robot.body.meshes is not None:
            # The path is only valid on the robot's computer.
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
        """Whether only replays have this id; without liveliness tokens, taken from the status."""
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
        """Subscribe to all displayed topics, or only to the status; call from the thread of `poll`.

        Robots do not encode messages without subscribers. Switching off clears the displayed state,
        so that the next page does not show stale data as new.
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
        """Process received messages; return whether a new status arrived.

        While another robot has the same id, the snapshot is frozen because messages of both would
        mix; its status gives the reason.
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
            why = because(Code.DUPLICATE_ID, robot=self.id)
            self._frozen = msgspec.structs.replace(
                self.snapshot.status or fresh["status"],
                mode="fault",
                stop_reason=sentence(why),
                stop=why,
                arming=None,
                refusals=Refusals.of(dict.fromkeys(("arm", "drive", "set_pose", "speed"), why)),
            )
        number = self.snapshot.status_seq + 1
        return {"status": self._frozen, "status_seq": number, "source": "several"}

    def _poll_streams(self, fresh: dict[str, Any], now_s: float) -> bool:
        for name, subscriber in self._subscribers.items():
            if (sample := subscriber.newest()) is not None:
                try:
                    fresh[name] = self._streams[name][1](sample.payload)
                except MessageError:
                    continue  # The age of the state reveals invalid samples.
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
