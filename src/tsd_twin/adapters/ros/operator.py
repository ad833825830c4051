"""ROS as the operator of a robot: bounded queues between ROS threads and the event loop."""

from __future__ import annotations

import asyncio
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, replace
from typing import Any, Protocol

from tsd_twin.adapters.cmd_vel import (
    MAX_AGE_S,
    MUST_PAUSE,
    NOTICE_INTERVAL_S,
    TWIST_STAMPED,
    CmdVelOperator,
    decode_cmd_vel,
)
from tsd_twin.adapters.cmd_vel_bridge import CmdVelBridge
from tsd_twin.adapters.fleet import frames_of
from tsd_twin.adapters.ros.arrivals import (
    Arrival,
    Echoes,
    Origin,
    PublisherArbiter,
    PublisherTracker,
)
from tsd_twin.adapters.ros.port import UNKNOWN_PUBLISHER, decode_pose_input
from tsd_twin.adapters.ros_messages import CMD_VEL, INITIAL_POSE, READ, RosNames, RosTopic
from tsd_twin.client import AsyncRobotClient
from tsd_twin.messages.cdr import ODOM
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.pose import encode_pose
from tsd_twin.messages.ros_types import decode_cdr, stamp_ns

MAX_QUEUED_MESSAGES = 64
"""Maximum number of queued twists per robot; the oldest are dropped."""
MOST_POSES = 8
"""Maximum number of queued poses per topic; the oldest are dropped."""
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


class OperatedSource(Protocol):
    """Robot operated by ROS, as seen by its operator."""

    id: str
    client: AsyncRobotClient
    names: RosNames | None
    echoes: Echoes | None
    """Sent `odom` stamps, if twists must echo one."""

    def shared_name(self, now_s: float) -> str:
        """Return an error if another robot has the same ROS name, or ""."""
        ...

    def tell(self, text: str) -> None:
        """Log and publish a message."""
        ...


@dataclass(frozen=True, slots=True)
class Received:
    """Received message of a topic."""

    row: RosTopic
    type_name: str
    payload: bytes
    origin: Origin
    arrived_s: float


class Inbox:
    """Separate bounded queue per topic, so that poses neither replace nor delay twists."""

    def __init__(self) -> None:
        self._waiting = {
            row.name: deque[Received](maxlen=MAX_QUEUED_MESSAGES if row is CMD_VEL else MOST_POSES)
            for row in READ
        }

    def put(self, received: Received) -> None:
        """Add a message, dropping the oldest one of its topic if the queue is full."""
        self._waiting[received.row.name].append(received)

    def take(self) -> list[Received]:
        """Remove and return all messages, twists first."""
        taken = [received for each in self._waiting.values() for received in each]
        for each in self._waiting.values():
            each.clear()
        return taken


Answer = Callable[[bool, str], None]


class RosOperator:
    """ROS as the operator of a robot, and `Inputs` of its port; used from the event loop."""

    def __init__(self, source: OperatedSource, machine: CmdVelOperator) -> None:
        """`machine` keeps the operator state of the robot across disconnections."""
        self._source = source
        self._driver = CmdVelBridge(source.client, machine, self._tell, conflict=source.shared_name)
        self._loop = asyncio.get_running_loop()
        self._inbox = Inbox()
        self._woken = False
        self._arrivals: dict[str, PublisherTracker] = {}
        self._turn = PublisherArbiter()
        self._calls = 0
        self._stops: list[Answer] = []
        self._stopping = False
        self._tasks: set[asyncio.Task[None]] = set()
        self._notified_s: dict[str, float] = {}
        self._told: deque[float] = deque([-math.inf] * MOST_SENTENCES, MOST_SENTENCES)
        self._lock = threading.Lock()
        self._driver.connected()  # May report lost control.

    async def close(self) -> None:
        """Stop and release the robot if held."""
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self._driver.close()

    def topic_opened(self) -> None:
        """Handle (re)subscription to `cmd_vel`."""
        self._driver.machine.topic_opened(time.monotonic())

    # On any thread.

    def problem(self) -> str:
        """Return the reason why twists are refused, or ""."""
        waits = self._driver.machine.waits_for_pause(time.monotonic())
        return MUST_PAUSE if waits else ""

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
            waiting = self._inbox.take()
            self._woken = False
        for received in waiting:
            try:
                self._receive(received)
            except MessageError as error:
                if received.row is CMD_VEL:
                    self._driver.machine.on_unread(time.monotonic())
                self.on_unreadable(received.row.name, str(error)[:200])

    def _receive(self, received: Received) -> None:
        row, names = received.row, self._source.names
        arrivals = self._arrivals.setdefault(f"{row.name} {received.type_name}", PublisherTracker())
        arrival = arrivals.note(received.origin, received.arrived_s)
        if arrival is None or names is None:
            return
        if row is CMD_VEL:
            self._drive(received, names, arrival)
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
            self._start(self._answer(self._driver.set_pose(pose), self._tell_refusal))

    def _drive(self, received: Received, names: RosNames, arrival: Arrival) -> None:
        message = decode_cmd_vel("cdr", received.type_name, received.payload)
        frames, now_s = frames_of(names), time.monotonic()
        if message.frame in frames:
            message = replace(message, frame=frames[message.frame])
        if received.origin.publisher == UNKNOWN_PUBLISHER:
            if not message.is_zero:
                raise MessageError("publishers", SEVERAL)
            self._driver.on_cmd_vel(message, now_s, arrival.sent_after_s)
            # A zero from one publisher must not end the pause required for another.
            self._driver.machine.on_unread(now_s)
            return
        if not message.is_zero and (shared := self._source.shared_name(now_s)):
            self._driver.machine.on_unread(now_s)
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
        self._start(self._answer(work or self._driver.call(service), answer))

    async def _refuse(self, reason: str) -> tuple[bool, str]:
        return False, reason

    def _begin_stop(self) -> None:
        if not self._stopping:
            self._stopping = True
            self._start(self._stop())

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

    def _start(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    # Messages to the user.

    def _tell_refusal(self, done: bool, text: str) -> None:
        if not done:
            self._say(f"initialpose is refused: {text}")

    def _say(self, text: str, kind: str = "") -> None:
        """Report a message, limited per kind to one per `NOTICE_INTERVAL_S`."""
        now_s, kind = time.monotonic(), kind or text
        with self._lock:
            recent = {
                key: at_s
                for key, at_s in self._notified_s.items()
                if now_s - at_s < NOTICE_INTERVAL_S
            }
            known, self._notified_s = kind in recent, recent
            recent.setdefault(kind, now_s)
        if not known:
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
