"""Connection to one robot over the bus: services, commands and streams.

It has no operator: several may command the robot over one connection, as the pages of a
dashboard do. `bus_port` has the connection of a script, with callbacks.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal, TypeAlias

from tsd_twin import robots
from tsd_twin.bus import Bus, Publisher, Subscriber
from tsd_twin.client.instances import Instances, stop_instances
from tsd_twin.client.lease_signing import LeaseSigning, signing_key_beside
from tsd_twin.client.protocol import ControlProtocol, TwistCommand
from tsd_twin.errors import BusError, NoAnswerError, SeveralAnswersError
from tsd_twin.lie import SO3, Array
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import Odometry, decode_odometry
from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.events import duplicate_id_text
from tsd_twin.messages.services import Description, decode_json, encode_refusal
from tsd_twin.messages.status import RobotStatus, decode_stamp, decode_status
from tsd_twin.messages.topics import Sample, Service, Topic
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
        self._key = signing_key_beside(bus.certificate)
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
        self._publisher(topics.STOP, topics.STOP.key(self.id))  # Ready when needed.

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

    def protocol(self, operator: str, name: str = "") -> ControlProtocol:
        """Return a protocol for an operator, which signs if this connection has a key."""
        signing = None if self._key is None else LeaseSigning(self._key, self.id)
        return ControlProtocol(self.id, self.robot, operator, name, signing)

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
        self._put(topics.TWIST, key, command.payload, command.attachment)

    @property
    def sent_commands(self) -> Sequence[SentCommand]:
        """Recently sent commands, oldest first; some may still be in flight."""
        return tuple(self._sent_commands)

    def send_stop(self, payload: bytes) -> None:
        """Publish a stop without waiting for an acknowledgement."""
        self._put(topics.STOP, topics.STOP.key(self.id), payload)

    def send_pose(self, payload: bytes) -> None:
        """Publish a pose measurement, unless several instances have the id."""
        if self.has_duplicate:
            return
        self._put(topics.SENSOR_POSE, topics.SENSOR_POSE.key(self.id), payload)

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

    def _put(self, topic: Topic, key: str, payload: bytes, attachment: bytes = b"") -> None:
        with contextlib.suppress(BusError):
            self._publisher(topic, key).put(payload, attachment)

    def _publisher(self, topic: Topic, key: str) -> Publisher:
        with self._publishers_lock:
            if key not in self._publishers:
                self._publishers[key] = self._bus.publisher(key, topic.qos, topic.type)
            return self._publishers[key]


def numbered_status(sample: Sample) -> tuple[RobotStatus, int]:
    """Decode a sample of `state/status`; return the status and its sequence number.

    Raises:
        MessageError: If it is invalid.
    """
    return decode_status(sample.payload), decode_stamp(sample.attachment)[0]


Source: TypeAlias = Literal["robot", "recording", "several"]
"""Sender of a state; `several` means that instances share one id and their states mix."""
