"""Robots on the bus as ROS nodes, with ROS as the operator of each.

Bounded queues connect the ROS threads with the event loop.
"""

from __future__ import annotations

import asyncio
import logging
import math
import secrets
import struct
import threading
import time
from collections import deque
from collections.abc import Callable, Coroutine
from dataclasses import replace
from typing import Any

from tsd_twin.adapters.cmd_vel import (
    MAX_AGE_S,
    MUST_PAUSE,
    NOTICE_INTERVAL_S,
    TWIST_STAMPED,
    CmdVelOperator,
    NoticeLimiter,
    decode_cmd_vel,
)
from tsd_twin.adapters.cmd_vel_bridge import CmdVelBridge
from tsd_twin.adapters.fleet import MeshFiles, RobotSource
from tsd_twin.adapters.ros.arrivals import (
    Arrival,
    Echoes,
    Origin,
    PublisherArbiter,
    PublisherTracker,
)
from tsd_twin.adapters.ros.port import (
    UNKNOWN_PUBLISHER,
    Inbox,
    OpenPort,
    Received,
    RosPort,
    decode_pose_input,
)
from tsd_twin.adapters.ros.shared_names import NameWatch
from tsd_twin.adapters.ros_messages import RosMessage
from tsd_twin.adapters.ros_topics import (
    CMD_VEL,
    INITIAL_POSE,
    MEASURED_POSE,
    ODOMETRY,
    READ,
    RosNames,
    RosTopic,
)
from tsd_twin.client.bus_port import BusLink
from tsd_twin.errors import TwinError
from tsd_twin.messages.cdr import ODOM
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.pose import encode_pose
from tsd_twin.messages.ros_types import decode_cdr, stamp_ns
from tsd_twin.messages.sentences import sentence

_LOG = logging.getLogger(__name__)
MAX_QUEUED_MESSAGES = 64
"""Maximum number of queued twists per robot; the oldest are dropped."""
MOST_POSES = 8
"""Maximum number of queued poses per topic; the oldest are dropped."""
QUEUE_SIZES = {CMD_VEL: MAX_QUEUED_MESSAGES, INITIAL_POSE: MOST_POSES, MEASURED_POSE: MOST_POSES}
MOST_CALLS = 16
"""Maximum number of concurrent service calls other than `stop`."""
MOST_STOPS = 1000
"""Maximum number of pending `stop` calls; one stop completes all that precede it."""
MOST_SENTENCES = 10
"""Maximum number of messages per `NOTICE_INTERVAL_S`."""
SEVERAL = "it has several publishers, and ROS does not say which one: run twist_mux, or end one"
NO_ECHO = (
    "cmd_vel needs the stamp of the newest odom, as TwistStamped: tsd-ros runs with --require-echo"
)
_TOO_MANY = "too many calls are under way"
_STOPPING = "the robot is being stopped, but too many calls wait for an answer"
_ALWAYS = frozenset({"stop", "disarm"})
"""Services available even with a duplicate name."""
_STAMP = struct.Struct("<iI")
"""Header stamp, after the four bytes of the CDR encapsulation."""
Answer = Callable[[bool, str], None]


class RosOperator:
    """ROS as the operator of a robot, and callbacks of its port; used from the event loop."""

    def __init__(self, source: RosSource, machine: CmdVelOperator) -> None:
        """`machine` keeps the operator state of the robot across disconnections."""
        self._source, self.machine = source, machine
        self._driver = CmdVelBridge(source.client, machine, self._tell, conflict=source.shared_name)
        self._loop = asyncio.get_running_loop()
        self._inbox = Inbox(QUEUE_SIZES)
        self._woken = False
        self._arrivals: dict[str, PublisherTracker] = {}
        self._turn = PublisherArbiter()
        self._calls = 0
        self._stops: list[Answer] = []
        self._stopping = False
        self._notices = NoticeLimiter()
        self._told: deque[float] = deque([-math.inf] * MOST_SENTENCES, MOST_SENTENCES)
        self._lock = threading.Lock()
        self._driver.connected()  # May report lost control.

    async def close(self) -> None:
        """Stop and release the robot if held."""
        await self._driver.close()

    # On any thread.

    def on_message(self, row: RosTopic, type_name: str, payload: bytes, origin: Origin) -> None:
        """Queue a message for the event loop, with at most one pending wake-up."""
        received = Received(row, type_name, payload, origin, time.monotonic())
        with self._lock:
            self._inbox.put(received)
            woken, self._woken = self._woken, True
        if not woken:
            self._call(self._take)

    def on_unreadable(self, name: str, reason: str) -> None:
        """Report an invalid message, rate-limited by kind."""
        kind = reason.partition(":")[0]
        self._say(f"a message of {name} is ignored: {reason}"[:250], f"{name} {kind}")

    def on_call(self, service: str, answer: Answer) -> None:
        """Call a service; calls above the limit are refused immediately, on this thread."""
        is_stop = service == "stop"
        with self._lock:
            accepted = len(self._stops) < MOST_STOPS if is_stop else self._calls < MOST_CALLS
            if accepted and is_stop:
                self._stops.append(answer)
            elif accepted:
                self._calls += 1
        if not accepted:
            answer(False, _STOPPING if is_stop else _TOO_MANY)
        elif is_stop:
            self._call(self._begin_stop)
        else:
            self._call(self._serve, service, answer)

    def _call(self, function: Callable[..., None], *args: Any) -> None:
        try:
            self._loop.call_soon_threadsafe(function, *args)
        except RuntimeError:  # The loop is closed.
            return

    # On the event loop.

    def _take(self) -> None:
        with self._lock:
            waiting = self._inbox.take(READ)
            self._woken = False
        for received in waiting:
            try:
                self._receive(received)
            except MessageError as error:
                if received.row is CMD_VEL:
                    self.machine.on_unread(time.monotonic())
                self.on_unreadable(received.row.name, str(error)[:200])

    def _receive(self, received: Received) -> None:
        row, names = received.row, self._source.names
        arrivals = self._arrivals.setdefault(f"{row.name} {received.type_name}", PublisherTracker())
        arrival = arrivals.note(received.origin, received.arrived_s)
        if arrival is None or names is None:
            return
        if row is CMD_VEL:
            self._drive(received, arrival)
            return
        pose = decode_pose_input(received.payload, row.type, names.frame(ODOM))
        if shared := self._source.shared_name(time.monotonic()):
            self._say(f"a pose is ignored: {shared}")
        elif row is not INITIAL_POSE:
            stamped = pose if pose.stamp_ns else replace(pose, stamp_ns=time.time_ns())
            self._source.client.link.send_pose(encode_pose(stamped))
        elif time.monotonic() - arrival.sent_after_s > MAX_AGE_S:
            self._say("initialpose comes too late: the link has stalled, or is slow")
        elif self._calls >= MOST_CALLS:
            self._say("initialpose is ignored: too many requests are under way")
        else:
            with self._lock:
                self._calls += 1
            self._driver.start(self._answer(self._driver.set_pose(pose), self._tell_refusal))

    def _drive(self, received: Received, arrival: Arrival) -> None:
        message = decode_cmd_vel("cdr", received.type_name, received.payload)
        message, now_s = self._source.to_bus_frame(message), time.monotonic()
        if received.origin.publisher == UNKNOWN_PUBLISHER:
            if not message.is_zero:
                raise MessageError("publishers", SEVERAL)
            self._driver.on_cmd_vel(message, now_s, arrival.sent_after_s)
            # A zero from one publisher must not end the pause required for another.
            self.machine.on_unread(now_s)
            return
        if not message.is_zero and (shared := self._source.shared_name(now_s)):
            self.machine.on_unread(now_s)
            self._say(f"cmd_vel does not move the robot: {shared}")
            return
        if not self._turn.admits(received.origin.publisher, not message.is_zero, now_s):
            if not message.is_zero:
                self._say("cmd_vel of a second publisher is ignored: only one drives at a time")
            return
        if self._source.echoes is not None:
            arrival = _echoed(received, self._source.echoes, now_s)
        self._driver.on_cmd_vel(message, now_s, arrival.sent_after_s, arrival.unproven)

    def _serve(self, service: str, answer: Answer) -> None:
        shared = self._source.shared_name(time.monotonic())
        work = self._refuse(shared) if shared and service not in _ALWAYS else None
        self._driver.start(self._answer(work or self._driver.call(service), answer))

    async def _refuse(self, reason: str) -> tuple[bool, str]:
        return False, reason

    def _begin_stop(self) -> None:
        if not self._stopping:
            self._stopping = True
            self._driver.start(self._stop())

    async def _stop(self) -> None:
        """Stop the robot for all pending calls, and again for later ones."""
        try:
            while True:
                with self._lock:
                    answers, self._stops = self._stops, []
                if not answers:
                    return
                done, text = await self._driver.call("stop")
                for answer in answers:
                    answer(done, text)
        finally:
            self._stopping = False

    async def _answer(self, work: Coroutine[Any, Any, tuple[bool, str]], answer: Answer) -> None:
        try:
            answer(*await work)
        finally:
            with self._lock:
                self._calls -= 1

    # Messages to the user.

    def _tell_refusal(self, done: bool, text: str) -> None:
        if not done:
            self._say(f"initialpose is refused: {text}")

    def _say(self, text: str, kind: str = "") -> None:
        """Report a message, limited per kind to one per `NOTICE_INTERVAL_S`."""
        with self._lock:
            admitted = self._notices.admits(kind or text, time.monotonic())
        if admitted:
            self._tell(text)

    def _tell(self, text: str) -> None:
        """Report a message unless the overall rate limit is reached."""
        now_s = time.monotonic()
        with self._lock:
            if now_s - self._told[0] < NOTICE_INTERVAL_S:
                return
            self._told.append(now_s)
        self._source.tell(text)


def _echoed(received: Received, echoes: Echoes, now_s: float) -> Arrival:
    """Return the send time proven by the stamp of a twist."""
    if received.type_name != TWIST_STAMPED:
        return Arrival(now_s, NO_ECHO)
    sent_s = echoes.sent_after_s(stamp_ns(decode_cdr(received.payload, TWIST_STAMPED)))
    return Arrival(now_s, NO_ECHO) if sent_s is None else Arrival(sent_s)


class RosSource(RobotSource):
    """Robot on the bus, shown as a ROS node."""

    def __init__(
        self,
        open_port: OpenPort,
        mesh_uri: Callable[[str, MeshFiles], str],
        operator: str,
        machines: dict[str, CmdVelOperator] | None,
        require_echo: bool,
        link: BusLink,
    ) -> None:
        """`mesh_uri` serves the meshes of a robot and returns their URI prefix.

        `machines` keeps the state of all robots seen, including this one; without it, ROS is
        read-only. With `require_echo`, a twist moves the robot only if it carries the stamp of an
        `odom`.
        """
        self._open_port, self._mesh_uri = open_port, mesh_uri
        self._port: RosPort | None = None
        self._watch: NameWatch | None = None
        self.echoes = Echoes() if require_echo else None
        super().__init__(link, operator)
        self._operator: RosOperator | None = None
        if machines is not None:
            machine = CmdVelOperator(f"{operator}-{secrets.token_hex(4)}")
            self._operator = RosOperator(self, machines.setdefault(self.id, machine))

    async def show(self, names: RosNames) -> None:
        """Join the graph under these names."""
        port = await asyncio.to_thread(self._open_port, names, self._operator)
        self._port, self._watch = port, NameWatch(port, names, is_shown=True)
        if self._operator is not None:
            self._operator.machine.topic_opened(time.monotonic())

    async def withdraw(self, names: RosNames) -> None:  # noqa: ARG002  Interface.
        """Leave the graph."""
        port, self._port, self._watch = self._port, None, None
        if port is not None:
            await asyncio.to_thread(port.close)

    def mesh_uri(self, names: RosNames) -> str:  # noqa: ARG002  Interface.
        """Return the URI prefix of mesh files."""
        return self._mesh_uri(self.id, self.meshes)

    def wants(self, topic: str) -> bool:
        """Return whether a topic has a subscriber."""
        return self._port is not None and self._port.wants(topic)

    def publish(self, message: RosMessage) -> None:
        """Publish a message."""
        if self._port is not None:
            if self.echoes is not None and message.topic is ODOMETRY:
                sec, nanosec = _STAMP.unpack_from(message.payload, 4)
                self.echoes.sent(sec * 1_000_000_000 + nanosec, time.monotonic())
            try:
                self._port.publish(message)
            except TwinError as error:  # The session was closed concurrently.
                _LOG.info("%s: %s", message.name, error)

    def shared_name(self, now_s: float) -> str:
        """Return an error if another robot has the same ROS name, or ""."""
        problem = None if self._watch is None else self._watch.problem(now_s)
        return "" if problem is None else sentence(problem)

    def input_problem(self) -> str:
        """Return the reason why the robot ignores `cmd_vel`, or ""."""
        if self._operator is None:
            return ""
        now_s = time.monotonic()
        waits = self._operator.machine.waits_for_pause(now_s)
        return self.shared_name(now_s) or (MUST_PAUSE if waits else "")

    def tell(self, text: str) -> None:
        """Log a message and publish it on the robot's events topic."""
        _LOG.warning("%s: %s", self.id, text)
        self.say(text)

    async def close(self) -> None:
        """Stop and release the robot if driven by ROS, and disconnect."""
        if self._operator is not None:
            await self._operator.close()
        await self.rename(None)
        await super().close()
