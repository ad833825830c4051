"""Robot client of the dashboard: state, commands, services, round-trip times, twist axes and
reported wheel speed.
"""

from __future__ import annotations

import asyncio
import itertools
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple, ParamSpec, TypeVar

import msgspec
import numpy as np

from tsd_twin import robots
from tsd_twin.bus import Bus, Publisher, Subscriber
from tsd_twin.errors import BusError, MessageError
from tsd_twin.kinematics import Kinematics
from tsd_twin.lie import SO3, Array
from tsd_twin.messages import topics
from tsd_twin.messages.commands import encode_attachment
from tsd_twin.messages.ros import (
    BASE,
    JointState,
    Odometry,
    TwistStamped,
    decode_joints,
    decode_odometry,
    encode_twist,
    warm_up,
)
from tsd_twin.messages.services import (
    Description,
    LeaseReply,
    Reply,
    StopRequest,
    decode_json,
    duplicate_id_text,
)
from tsd_twin.messages.status import Refusals, Status, decode_stamp, decode_status
from tsd_twin.messages.topics import QoS, Service
from tsd_twin.robots import RPM, RobotDescription
from tsd_twin.robots.description import Limits

MAX_ROUND_TRIPS = 40
"""Round trips that count: the last ten seconds."""


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


_MAX_SENT_COMMANDS = 100
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
    status_seq: int = 0
    status_robot_s: float = 0.0
    """When the robot sent the status, on its monotonic clock."""
    received_s: float = -np.inf
    """When the newest of these came in, on the clock given to `poll`."""


@dataclass(frozen=True, slots=True, eq=False)
class SentCommand:
    """Twist command sent by this dashboard."""

    sent_s: float
    """On the monotonic clock, which `poll` is given too."""
    twist: Array
    """(3,): m/s and rad/s in `frame`."""
    frame: str


class RobotClient:
    """Client of one robot on the bus: description, newest state, services and commands.

    `poll` and `set_streaming` belong to one thread; all else may be called from any.
    """

    def __init__(self, bus: Bus, robot_id: str, answer: bytes | None = None) -> None:
        """Read the description of a robot; without its `answer`, request it and wait.

        Raises:
            BusError: it does not answer.
            MessageError: its answer is no description.
            RobotFileError: its description cannot be used.
        """
        self.id = robot_id
        self._bus = bus
        if answer is None:
            answer = bus.query(Service.DESC.key(robot_id), b"")
        if len(answer) > _DESCRIPTION_BYTES:
            raise MessageError("shape", f"a description of {len(answer)} bytes is too long")
        description = decode_json(answer, Description, "a description")
        robot = robots.parse_description(description.robot, f"description of {robot_id}")
        self.ignored = ""
        """Sentence that names ignored parts of the description; empty without any."""
        if robot.body.meshes is not None:
            # A folder on the robot's computer; on this one the path names other files.
            self.ignored = _NO_MESHES
            body = msgspec.structs.replace(robot.body, meshes=None)
            robot = msgspec.structs.replace(robot, body=body)
        self.robot = robot
        self.urdf = description.urdf
        self.kinematics = self.robot.kinematics()
        self.snapshot = Snapshot()
        self.has_duplicate = False
        """Whether another robot on the bus has the same id, so that the streams mix."""
        self._frozen: Status | None = None
        decode_pose = partial(decode_odometry, turning=self.kinematics.pose_type is SO3)
        self.round_trips = RoundTrips()
        """Measured round-trip times."""
        warm_up()  # On this thread: the first page shall not wait for it.
        self._streams: dict[str, tuple[topics.Topic, Callable[[bytes], Any]]] = {
            "joints": (topics.JOINTS, decode_joints),
            "setpoint": (topics.SETPOINT, decode_joints),
            "odom": (topics.ODOM, decode_pose),
            "alternative": (topics.ODOM_ALTERNATIVE, decode_pose),
            "truth": (topics.TRUTH, decode_pose),
        }
        self._subscribers: dict[str, Subscriber] = {}
        self.set_streaming(True)
        self._status = bus.subscriber(topics.STATUS.key(robot_id), 1)
        self._stop = bus.publisher(Service.STOP.key(robot_id), QoS.REAL_TIME)
        self._twists: dict[str, Publisher] = {}
        self._lock = threading.Lock()
        self._sent_commands: deque[SentCommand] = deque(maxlen=_MAX_SENT_COMMANDS)
        self._components = list(self.kinematics.twist_axes)

    @property
    def sent_commands(self) -> Sequence[SentCommand]:
        """Recent commands of this dashboard, oldest first; some may still be in transit."""
        return tuple(self._sent_commands)

    def close(self) -> None:
        """Close all subscriptions."""
        for reader in self._subscribers.values():
            reader.close()
        self._status.close()
        self._stop.close()
        with self._lock:
            for publisher in self._twists.values():
                publisher.close()
            self._twists.clear()

    def set_streaming(self, on: bool) -> None:
        """Subscribe to all that is drawn, or to the status only; belongs to the thread of `poll`.

        A robot does not even make messages that have no subscriber. What was drawn before is
        forgotten then: it must not look like news to the page that opens next.
        """
        if on == bool(self._subscribers):
            return
        if on:
            self._subscribers = {
                name: self._bus.subscriber(topic.key(self.id), 1)
                for name, (topic, _) in self._streams.items()
            }
            return
        for reader in self._subscribers.values():
            reader.close()
        self._subscribers = {}
        self.snapshot = Snapshot(
            status=self.snapshot.status,
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
        return {"status": self._frozen, "status_seq": self.snapshot.status_seq + 1}

    def _poll_streams(self, fresh: dict[str, Any], now_s: float) -> bool:
        for name, reader in self._subscribers.items():
            if (sample := reader.newest()) is not None:
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
            fresh["status"] = decode_status(sample.payload)
            seq, robot_ns = decode_stamp(sample.attachment)
            fresh["status_seq"], fresh["status_robot_s"] = seq, 1e-9 * robot_ns
        except MessageError:
            fresh.pop("status", None)
            return False
        return True

    def call_service(
        self, service: Service, request: msgspec.Struct, timeout_s: float = 1.0
    ) -> Reply:
        """Return the response of a service; blocks. A missing response becomes a refusal."""
        return self._call(
            service, request, Reply, Reply(False, "the robot does not answer"), timeout_s
        )

    def call_lease_service(self, request: msgspec.Struct, timeout_s: float = 1.0) -> LeaseReply:
        """Return the response of the lease service; blocks."""
        silence = LeaseReply(False, reason="the robot does not answer")
        return self._call(Service.LEASE, request, LeaseReply, silence, timeout_s)

    def _call(
        self, service: Service, request: msgspec.Struct, kind: Any, silence: Any, timeout_s: float
    ) -> Any:
        try:
            answer = self._bus.query(service.key(self.id), msgspec.json.encode(request), timeout_s)
            return decode_json(answer, kind, "an answer")
        except (BusError, MessageError):
            return silence

    def stop(self, operator: str, reason: str = "") -> Reply:
        """Stop the robot: sent at once, and repeated until it is acknowledged; blocks."""
        request = StopRequest(operator, reason)
        payload = msgspec.json.encode(request)
        for _ in range(STOP_REPEATS):
            self._stop.put(payload)
            reply = self.call_service(Service.STOP, request, timeout_s=0.1)
            if reply.ok:
                return reply
        return Reply(False, "the stop was not acknowledged")

    def publish_twist(
        self, holder: LeaseHolder, spatial_twist: Array, status_seq: int, frame: str = BASE
    ) -> int:
        """Send a twist (6,), m/s and rad/s in `frame`, on behalf of the holder of a lease.

        Returns its number. Numbers rise in the order in which commands are sent, from any thread.

        Raises:
            BusError: the session is closed.
        """
        payload = encode_twist(TwistStamped(frame, spatial_twist))
        with self._lock:
            if holder.operator not in self._twists:
                self._twists[holder.operator] = self._bus.publisher(
                    topics.twist_key(self.id, holder.operator),
                    QoS.REAL_TIME,
                    topics.TWIST.type,
                )
            number = next(holder.numbers)
            self._sent_commands.append(
                SentCommand(time.monotonic(), spatial_twist[self._components], frame)
            )
            self._twists[holder.operator].put(
                payload, encode_attachment(number, holder.lease, status_seq)
            )
        return number


class LeaseHolder:
    """The holder of a lease, with the numbers of its commands."""

    def __init__(self, operator: str, lease_hex: str, max_age_s: float) -> None:
        self.operator = operator
        self.lease_hex = lease_hex
        self.lease = bytes.fromhex(lease_hex)
        self.max_age_s = max_age_s
        self.numbers = itertools.count(1)


_Args = ParamSpec("_Args")
_Answer = TypeVar("_Answer")

_RPC_THREADS = 8
_STOP_THREADS = 32


class RpcExecutor:
    """Thread pools for blocking calls: a stop never waits behind a call to a robot that does not
    answer.

    One thread plans for all pages; cancelled calls are not started.
    """

    def __init__(self) -> None:
        self._rpc_pool = ThreadPoolExecutor(_RPC_THREADS, "ask")
        self._stop_pool = ThreadPoolExecutor(_STOP_THREADS, "stop")
        self._planning_pool = ThreadPoolExecutor(1, "plan")
        self._stops: dict[str, asyncio.Task[Reply]] = {}
        self._next_stops: dict[str, asyncio.Task[Reply]] = {}

    def close(self) -> None:
        """Accept no more calls; running ones end by themselves."""
        self._rpc_pool.shutdown(wait=False, cancel_futures=True)
        self._stop_pool.shutdown(wait=False)
        self._planning_pool.shutdown(wait=False, cancel_futures=True)

    async def call(
        self, call: Callable[_Args, _Answer], *args: _Args.args, **kwargs: _Args.kwargs
    ) -> _Answer:
        """Return what `call` returns."""
        return await _run_in_pool(self._rpc_pool, call, *args, **kwargs)

    async def plan(
        self, call: Callable[_Args, _Answer], *args: _Args.args, **kwargs: _Args.kwargs
    ) -> _Answer:
        """Return the result of a long computation."""
        return await _run_in_pool(self._planning_pool, call, *args, **kwargs)

    async def stop(self, link: RobotClient, operator: str) -> Reply:
        """Stop a robot.

        A running stop repeats until it is acknowledged. Further requests share the one that follows
        it, so a stop begins after each press and no robot uses more than one thread.
        """
        if (under_way := self._stops.get(link.id)) is None or under_way.done():
            self._stops[link.id] = asyncio.create_task(self._stop(link, operator))
            return await asyncio.shield(self._stops[link.id])
        if link.id not in self._next_stops:
            self._next_stops[link.id] = asyncio.create_task(self._after(under_way, link, operator))
        return await asyncio.shield(self._next_stops[link.id])

    async def _after(self, before: asyncio.Task[Reply], link: RobotClient, operator: str) -> Reply:
        await before
        self._stops[link.id] = self._next_stops.pop(link.id)
        return await self._stop(link, operator)

    async def _stop(self, link: RobotClient, operator: str) -> Reply:
        try:
            return await _run_in_pool(self._stop_pool, link.stop, operator)
        except BusError as error:
            return Reply(False, str(error))


async def _run_in_pool(
    pool: Executor, call: Callable[_Args, _Answer], *args: _Args.args, **kwargs: _Args.kwargs
) -> _Answer:
    return await asyncio.get_running_loop().run_in_executor(pool, lambda: call(*args, **kwargs))


class TwistAxis(NamedTuple):
    """Component of a twist: name, symbol and unit."""

    name: str
    symbol: str
    unit: str
    hint: str

    @property
    def label(self) -> str:
        """Label of its slider."""
        return f"{self.name} ({self.unit})"


FLOOR_AXES = (
    TwistAxis("vx", "vx", "m/s", "Forward is positive"),
    TwistAxis("vy", "vy", "m/s", "Left is positive"),
    TwistAxis("omega", "ω", "rad/s", "Turning left is positive"),
)
"""Of a robot that drives over a floor."""
_SPHERE_AXES = (
    TwistAxis("wx", "ωx", "rad/s", "Positive rolls the top of the sphere to the right"),
    TwistAxis("wy", "ωy", "rad/s", "Positive rolls the top of the sphere forward"),
    TwistAxis("wz", "ωz", "rad/s", "Positive turns the sphere left"),
)
_TWIST_AXES = {(0, 1, 5): FLOOR_AXES, (3, 4, 5): _SPHERE_AXES}
"""By where they stand in a spatial twist."""


def twist_axes_of(kinematics: Kinematics[Any]) -> tuple[TwistAxis, TwistAxis, TwistAxis]:
    """Return the components of a twist, in order."""
    return _TWIST_AXES[kinematics.twist_axes]


def axis_limits(kinematics: Kinematics[Any], limits: Limits) -> tuple[float, float, float]:
    """Return the limit of each component of a twist, in its unit."""
    most = limits.speed_mps / kinematics.twist_scale_m
    return most, most, limits.turn_rate_rad_per_s


def kinematics_at_reported_speed(
    robot: RobotDescription, kinematics: Kinematics[Any], snapshot: Snapshot
) -> Kinematics[Any]:
    """Return the described kinematics at the wheel speed of the newest status."""
    gears, status = robot.wheel_speed_range, snapshot.status
    if gears is None or status is None or status.wheel_speed is None:
        return kinematics
    spin = status.wheel_speed.wanted_rpm * RPM
    return kinematics if gears.refusal(spin) else gears.kinematics.with_spin(spin)
