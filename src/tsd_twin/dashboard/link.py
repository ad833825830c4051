"""What the dashboard knows of one robot, and how it speaks to it."""

from __future__ import annotations

import itertools
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import msgspec
import numpy as np

from tsd_twin import robots, topics
from tsd_twin.bus import Bus, Publisher
from tsd_twin.dashboard.trips import RoundTrips
from tsd_twin.errors import BusError, MessageError
from tsd_twin.lie import SO3, Array
from tsd_twin.messages.command import encode_attachment
from tsd_twin.messages.ros import (
    BASE,
    JointState,
    Odometry,
    TwistStamped,
    decode_joints,
    decode_odometry,
    encode_twist,
)
from tsd_twin.messages.service import (
    Description,
    LeaseReply,
    Reply,
    StopRequest,
    decode_json,
    namesake_words,
)
from tsd_twin.messages.status import Status, decode_stamp, decode_status
from tsd_twin.topics import Service, Urgency

_SENT_KEPT = 100
_DESCRIPTION_BYTES = 2**20
"""A description is its TOML and its URDF, some 30 kB."""
_NO_MESHES = (
    "The description names a folder of meshes. A dashboard reads no files that a robot names: "
    "the generated look is shown."
)
STOP_REPEATS = 20
"""A stop is sent this often at 10 Hz, unless it is acknowledged before."""


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """The newest of everything a robot has said."""

    joints: JointState | None = None
    setpoint: JointState | None = None
    odom: Odometry | None = None
    odom_s: float = -np.inf
    """When that came in, on the clock given to `poll`."""
    other: Odometry | None = None
    """The estimate that `odom` is not, of robots that have two."""
    truth: Odometry | None = None
    status: Status | None = None
    status_seq: int = 0
    received_s: float = -np.inf
    """When the newest of these came in, on the clock given to `poll`."""


@dataclass(frozen=True, slots=True, eq=False)
class Sent:
    """A command that has been sent from here."""

    sent_s: float
    """On the monotonic clock, which `poll` is given too."""
    twist: Array
    """(3,): m/s and rad/s in `frame`."""
    frame: str


class RobotLink:
    """One robot on the bus: its description, its newest state, and a way to command it.

    `poll` belongs to one thread; all else may be called from any.
    """

    def __init__(self, bus: Bus, robot_id: str, answer: bytes | None = None) -> None:
        """Read the description of a living robot; without its `answer`, ask for it and wait.

        Raises:
            BusError: it does not answer.
            MessageError: its answer is no description.
            RobotFileError: its description cannot be used.
        """
        self.id = robot_id
        self._bus = bus
        if answer is None:
            answer = bus.ask(Service.DESC.key(robot_id), b"")
        if len(answer) > _DESCRIPTION_BYTES:
            raise MessageError("shape", f"a description of {len(answer)} bytes is too long")
        description = decode_json(answer, Description, "a description")
        robot = robots.parse(description.robot, f"description of {robot_id}")
        self.ignored = ""
        """What of the description is not obeyed, as a sentence; "" if all of it is."""
        if robot.body.meshes is not None:
            # A folder of the robot's machine; here it would name files that are not the robot's.
            self.ignored = _NO_MESHES
            body = msgspec.structs.replace(robot.body, meshes=None)
            robot = msgspec.structs.replace(robot, body=body)
        self.robot = robot
        self.urdf = description.urdf
        self.drive = self.robot.kinematics()
        self.snapshot = Snapshot()
        self.has_namesake = False
        """Whether another robot on the bus has the same id, so that all streams are of two."""
        self._frozen: Status | None = None
        decode_pose = partial(decode_odometry, turning=self.drive.space is SO3)
        self.trips = RoundTrips()
        """How long the robot takes to answer, as far as it has been measured."""
        self._readers = {
            "joints": (bus.reader(topics.JOINTS.key(robot_id), 1), decode_joints),
            "setpoint": (bus.reader(topics.SETPOINT.key(robot_id), 1), decode_joints),
            "odom": (bus.reader(topics.ODOM.key(robot_id), 1), decode_pose),
            "other": (bus.reader(topics.OTHER_ODOM.key(robot_id), 1), decode_pose),
            "truth": (bus.reader(topics.TRUTH.key(robot_id), 1), decode_pose),
        }
        self._status = bus.reader(topics.STATUS.key(robot_id), 1)
        self._stop = bus.publisher(Service.STOP.key(robot_id), Urgency.REAL_TIME)
        self._twists: dict[str, Publisher] = {}
        self._lock = threading.Lock()
        self._sent: deque[Sent] = deque(maxlen=_SENT_KEPT)
        self._components = list(self.drive.components)

    @property
    def sent(self) -> Sequence[Sent]:
        """The newest commands from here, oldest first: the robot may not have heard them yet."""
        return tuple(self._sent)

    def close(self) -> None:
        """Stop listening."""
        for reader, _ in self._readers.values():
            reader.close()
        self._status.close()
        self._stop.close()
        with self._lock:
            for publisher in self._twists.values():
                publisher.close()
            self._twists.clear()

    def poll(self, now_s: float) -> bool:
        """Take in what has arrived, and return whether there is a new status.

        While another robot has the same id, the picture stands still and the status says why:
        what arrives would show two robots in turn.
        """
        fresh: dict[str, Any] = {}
        new_status = self._poll_streams(fresh, now_s)
        if self.has_namesake:
            fresh = self._of_two(fresh) if new_status else {}
        else:
            self._frozen = None
        if fresh:
            self.snapshot = replace(self.snapshot, **fresh, received_s=now_s)
        return new_status

    def _of_two(self, fresh: dict[str, Any]) -> dict[str, Any]:
        if self._frozen is None:
            self._frozen = msgspec.structs.replace(
                self.snapshot.status or fresh["status"],
                mode="fault",
                stop_reason=namesake_words(self.id),
                arming=None,
            )
        return {"status": self._frozen, "status_seq": self.snapshot.status_seq + 1}

    def _poll_streams(self, fresh: dict[str, Any], now_s: float) -> bool:
        for name, (reader, decode) in self._readers.items():
            if (sample := reader.newest()) is not None:
                try:
                    fresh[name] = decode(sample.payload)
                except MessageError:
                    continue  # Somebody else writes on this key; the age of the state will tell.
        if "odom" in fresh:
            fresh["odom_s"] = now_s
        return self._poll_status(fresh)

    def _poll_status(self, fresh: dict[str, Any]) -> bool:
        sample = self._status.newest()
        if sample is None:
            return False
        try:
            fresh["status"] = decode_status(sample.payload)
            fresh["status_seq"] = decode_stamp(sample.attachment)[0]
        except MessageError:
            fresh.pop("status", None)
            return False
        return True

    def ask(self, service: Service, request: msgspec.Struct, timeout_s: float = 1.0) -> Reply:
        """Return the answer of a service; waits for it, and silence is an answer too."""
        return self._ask(
            service, request, Reply, Reply(False, "the robot does not answer"), timeout_s
        )

    def ask_lease(self, request: msgspec.Struct, timeout_s: float = 1.0) -> LeaseReply:
        """Return the answer of the lease service; waits for it."""
        silence = LeaseReply(False, reason="the robot does not answer")
        return self._ask(Service.LEASE, request, LeaseReply, silence, timeout_s)

    def _ask(
        self, service: Service, request: msgspec.Struct, kind: Any, silence: Any, timeout_s: float
    ) -> Any:
        try:
            answer = self._bus.ask(service.key(self.id), msgspec.json.encode(request), timeout_s)
            return decode_json(answer, kind, "an answer")
        except (BusError, MessageError):
            return silence

    def stop(self, operator: str, reason: str = "") -> Reply:
        """Stop the robot: sent at once, and again until it is acknowledged. Waits for that."""
        request = StopRequest(operator, reason)
        payload = msgspec.json.encode(request)
        for _ in range(STOP_REPEATS):
            self._stop.put(payload)
            reply = self.ask(Service.STOP, request, timeout_s=0.1)
            if reply.ok:
                return reply
        return Reply(False, "the stop was not acknowledged")

    def command(
        self, driver: Driver, spatial_twist: Array, status_seq: int, frame: str = BASE
    ) -> int:
        """Send a twist (6,), m/s and rad/s in `frame`, on behalf of the holder of a lease.

        Returns its number. Numbers rise in the order in which commands are sent, from any thread.

        Raises:
            BusError: the session is closed.
        """
        payload = encode_twist(TwistStamped(frame, spatial_twist))
        with self._lock:
            if driver.operator not in self._twists:
                self._twists[driver.operator] = self._bus.publisher(
                    topics.twist_key(self.id, driver.operator),
                    Urgency.REAL_TIME,
                    topics.TWIST.type,
                )
            number = next(driver.numbers)
            self._sent.append(Sent(time.monotonic(), spatial_twist[self._components], frame))
            self._twists[driver.operator].put(
                payload, encode_attachment(number, driver.lease, status_seq)
            )
        return number


class Driver:
    """The holder of a lease, with the numbers of its commands."""

    def __init__(self, operator: str, lease_hex: str, max_age_s: float) -> None:
        self.operator = operator
        self.lease_hex = lease_hex
        self.lease = bytes.fromhex(lease_hex)
        self.max_age_s = max_age_s
        self.numbers = itertools.count(1)
