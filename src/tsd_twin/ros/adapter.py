"""Robots of the bus as ROS nodes, ROS as an operator of each robot, and a server of mesh files."""

from __future__ import annotations

import asyncio
import logging
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Coroutine
from dataclasses import dataclass, replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from tsd_twin.bus import Bus
from tsd_twin.client.link import BusLink
from tsd_twin.errors import MessageError, TwinError
from tsd_twin.interop.cmd_vel import MAX_AGE_S, SAY_AGAIN_S, CmdVelOperator, decode_cmd_vel
from tsd_twin.interop.driver import RobotDriver
from tsd_twin.interop.fleet import LONGEST_OPERATOR, Fleet, RobotSource, frames_of
from tsd_twin.interop.mapping import CMD_VEL, INITIAL_POSE, RosMessage, RosNames, RosTopic
from tsd_twin.messages.requests import encode_pose
from tsd_twin.messages.ros import ODOM
from tsd_twin.robots import ImportedDescription
from tsd_twin.ros.port import (
    UNTOLD,
    Arrivals,
    OnePublisher,
    OpenPort,
    Origin,
    RosPort,
    decode_pose_input,
)

_TIMEOUT_S = 5.0


class MeshServer:
    """Server of `/<robot>/<file>`, until it is closed."""

    def __init__(self, host: str, port: int) -> None:
        """Listen; port 0 takes a free one.

        Raises:
            TwinError: the address cannot be used.
        """
        self.robots: dict[str, Callable[[str], bytes | None]] = {}
        """Function that returns a file of each robot."""
        served = self

        class Handler(BaseHTTPRequestHandler):
            timeout = _TIMEOUT_S

            def do_GET(self) -> None:
                body = served.file(self.path)
                self.send_response(404 if body is None else 200)
                self.send_header("Content-Type", "model/stl")
                self.send_header("Content-Length", str(len(body or b"")))
                self.end_headers()
                self.wfile.write(body or b"")

            def log_message(self, format: str, *args: Any) -> None:  # noqa: A002  Named so by the base class.
                """Write no line for each request."""

        try:
            self._server = ThreadingHTTPServer((host, port), Handler)
        except OSError as error:
            raise TwinError(f"port {port} of {host} cannot be used for meshes") from error
        self._server.daemon_threads = True
        self._host = host
        threading.Thread(target=self._server.serve_forever, args=(0.1,), daemon=True).start()

    def uri(self, robot: str) -> str:
        """Return what goes before the name of each file of a robot."""
        return f"http://{self._host}:{self._server.server_address[1]}/{robot}/"

    def file(self, path: str) -> bytes | None:
        """Return a file by the path of a request, None when there is none."""
        robot, _, name = path.lstrip("/").partition("/")
        get = self.robots.get(robot)
        return None if get is None else get(name)

    def close(self) -> None:
        """Stop listening."""
        self._server.shutdown()
        self._server.server_close()


_LOG = logging.getLogger(__name__)
_WATCH_S = 0.05
MOST_WAITING = 64
"""Messages of one robot that wait for the event loop; the oldest are dropped."""
MOST_CALLS = 16
"""Services of one robot that are under way at once; `stop` is always carried out."""
SEVERAL = "it has several publishers, and ROS does not say which one: run twist_mux, or end one"


@dataclass(frozen=True, slots=True)
class _Received:
    row: RosTopic
    type_name: str
    payload: bytes
    origin: Origin
    arrived_s: float


class RosOperator:
    """ROS as the operator of one robot: `Inputs` of its port; belongs to the event loop."""

    def __init__(self, source: RosSource, machine: CmdVelOperator) -> None:
        """`machine` is that of the robot, also of the time before it was out of reach."""
        self._source = source
        self._driver = RobotDriver(source.client, machine, self._tell)
        self._driver.connected()
        self._loop = asyncio.get_running_loop()
        self._waiting: deque[_Received] = deque(maxlen=MOST_WAITING)
        self._woken = False
        self._arrivals: dict[str, Arrivals] = {}
        self._turn = OnePublisher()
        self._calls = 0
        self._tasks: set[asyncio.Task[None]] = set()
        self._said: dict[str, float] = {}
        self._lock = threading.Lock()

    async def close(self) -> None:
        """Bring the robot to rest and release it, if it is held."""
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self._driver.close()

    def topic_opened(self) -> None:
        """Note that `cmd_vel` is read from now on."""
        self._driver.machine.topic_opened(time.monotonic())

    # On threads of the middleware.

    def on_message(self, row: RosTopic, type_name: str, payload: bytes, origin: Origin) -> None:
        """Queue a message for the event loop, which one wake-up at most waits for."""
        received = _Received(row, type_name, payload, origin, time.monotonic())
        with self._lock:
            self._waiting.append(received)
            woken, self._woken = self._woken, True
        if not woken:
            self._call(self._take)

    def on_unreadable(self, row: RosTopic, reason: str) -> None:
        """Say that a message is none."""
        self._say(f"a message of {row.name} is ignored: {reason}")

    def on_call(self, service: str, answer: Callable[[bool, str], None]) -> None:
        """Carry out a service."""
        self._call(self._serve, service, answer)

    def _call(self, function: Callable[..., None], *args: Any) -> None:
        try:
            self._loop.call_soon_threadsafe(function, *args)
        except RuntimeError:  # The loop is closed.
            return

    # On the event loop.

    def _take(self) -> None:
        with self._lock:
            waiting = list(self._waiting)
            self._waiting.clear()
            self._woken = False
        for received in waiting:
            try:
                self._receive(received)
            except MessageError as error:
                if received.row is CMD_VEL:
                    self._driver.machine.on_unread(time.monotonic())
                self.on_unreadable(received.row, str(error)[:200])

    def _receive(self, received: _Received) -> None:
        row, names = received.row, self._source.names
        arrivals = self._arrivals.setdefault(f"{row.name} {received.type_name}", Arrivals())
        sent_after_s = arrivals.sent_after_s(received.origin, received.arrived_s)
        if sent_after_s is None or names is None:
            return
        if row is CMD_VEL:
            self._drive(received, names, sent_after_s)
            return
        pose = decode_pose_input(received.payload, row.type, names.frame(ODOM))
        if row is not INITIAL_POSE:
            stamped = pose if pose.stamp_ns else replace(pose, stamp_ns=time.time_ns())
            self._source.client.link.send_pose(encode_pose(stamped))
        elif time.monotonic() - sent_after_s > MAX_AGE_S:
            self._say("initialpose comes too late: the link has stalled, or is slow")
        elif self._calls >= MOST_CALLS:
            self._say("initialpose is ignored: too many requests are under way")
        else:
            self._start(self._answer(self._driver.set_pose(pose), self._tell_refusal))

    def _drive(self, received: _Received, names: RosNames, sent_after_s: float) -> None:
        message = decode_cmd_vel("cdr", received.type_name, received.payload)
        frames, now_s = frames_of(names), time.monotonic()
        if message.frame in frames:
            message = replace(message, frame=frames[message.frame])
        if received.origin.publisher == UNTOLD:
            if not message.is_zero:
                raise MessageError("publishers", SEVERAL)
            self._driver.on_cmd_vel(message, now_s, sent_after_s)
            # A zero of one publisher does not release the stick that another one holds.
            self._driver.machine.on_unread(now_s)
            return
        if not self._turn.admits(received.origin.publisher, not message.is_zero, now_s):
            if not message.is_zero:
                self._say("cmd_vel of a second publisher is ignored: only one drives at a time")
            return
        self._driver.on_cmd_vel(message, now_s, sent_after_s)

    def _serve(self, service: str, answer: Callable[[bool, str], None]) -> None:
        if self._calls >= MOST_CALLS and service != "stop":
            answer(False, "too many calls are under way")
        else:
            self._start(self._answer(self._driver.call(service), answer))

    async def _answer(
        self, work: Coroutine[Any, Any, tuple[bool, str]], answer: Callable[[bool, str], None]
    ) -> None:
        self._calls += 1
        try:
            answer(*await work)
        finally:
            self._calls -= 1

    def _start(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    # Sentences.

    def _tell_refusal(self, done: bool, text: str) -> None:
        if not done:
            self._say(f"initialpose is refused: {text}")

    def _say(self, text: str) -> None:
        """Tell a sentence, the same one no more often than every two seconds."""
        now_s = time.monotonic()
        with self._lock:
            recent = {key: at_s for key, at_s in self._said.items() if now_s - at_s < SAY_AGAIN_S}
            known, self._said = text in recent, recent
            recent.setdefault(text, now_s)
        if not known:
            self._tell(text)

    def _tell(self, text: str) -> None:
        _LOG.warning("%s: %s", self._source.id, text)
        self._source.say(text)


class RosSource(RobotSource):
    """One robot on the bus, as a node of ROS."""

    def __init__(
        self,
        open_port: OpenPort,
        meshes: MeshServer | str,
        operator: str,
        machines: dict[str, CmdVelOperator] | None,
        link: BusLink,
    ) -> None:
        """`meshes` serves files, or is a URI before names; without `machines` ROS only looks on.

        They are those of robots that were seen before, and get that of this one.
        """
        self._open_port, self._meshes_at = open_port, meshes
        self._port: RosPort | None = None
        super().__init__(link, operator)
        self._operator: RosOperator | None = None
        if machines is not None:
            machine = CmdVelOperator(f"{operator}-{secrets.token_hex(4)}")
            self._operator = RosOperator(self, machines.setdefault(self.id, machine))

    async def show(self, names: RosNames) -> None:
        """Enter the graph under these names."""
        if isinstance(self._meshes_at, MeshServer):
            self._meshes_at.robots[self.id] = self.meshes.get
        self._port = await asyncio.to_thread(self._open_port, names, self._operator)
        if self._operator is not None:
            self._operator.topic_opened()

    async def withdraw(self, names: RosNames) -> None:  # noqa: ARG002  Of the interface.
        """Leave the graph."""
        port, self._port = self._port, None
        if port is not None:
            await asyncio.to_thread(port.close)

    def mesh_uri(self, names: RosNames) -> str:  # noqa: ARG002  Of the interface.
        """Return what goes before the name of each mesh file."""
        at = self._meshes_at
        return at.uri(self.id) if isinstance(at, MeshServer) else at

    def wants(self, topic: str) -> bool:
        """Return whether a topic has a subscriber."""
        return self._port is not None and self._port.wants(topic)

    def publish(self, message: RosMessage) -> None:
        """Publish a message."""
        if self._port is not None:
            try:
                self._port.publish(message)
            except TwinError as error:  # The session has been closed meanwhile.
                _LOG.info("%s: %s", message.name, error)

    async def close(self) -> None:
        """Bring the robot to rest, if ROS drives it, and leave it."""
        if self._operator is not None:
            await self._operator.close()
        await self.rename(None)
        await super().close()


async def serve_ros(
    open_bus: Callable[[], Bus],
    open_port: OpenPort,
    meshes: MeshServer | str,
    stop: threading.Event,
    ready: Callable[[], None],
    *,
    operator: str,
    may_drive: bool = True,
    only: Collection[str] = (),
) -> None:
    """Show all robots on the bus to ROS until `stop` is set.

    Raises:
        TwinError: the bus cannot be opened.
    """
    name = operator[:LONGEST_OPERATOR]
    machines = dict[str, CmdVelOperator]() if may_drive else None
    bus = await asyncio.to_thread(open_bus)
    # A robot that comes from ROS is there already: two adapters would drive each other in a circle.
    fleet = Fleet(
        lambda link: RosSource(open_port, meshes, name, machines, link),
        open_bus,
        only,
        lambda robot: not isinstance(robot, ImportedDescription),
    )
    try:
        fleet.watch(bus)
        ready()
        while not stop.is_set():
            await asyncio.sleep(_WATCH_S)
    finally:
        await fleet.close()
        bus.close()
