"""Robots on the bus as ROS nodes, ROS as an operator of each robot, and a mesh file server."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import secrets
import struct
import sys
import threading
import time
from collections.abc import Callable, Collection
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from tsd_twin.adapters.cmd_vel import CmdVelOperator
from tsd_twin.adapters.fleet import LONGEST_OPERATOR, Fleet, RobotSource
from tsd_twin.adapters.ros.arrivals import Echoes
from tsd_twin.adapters.ros.operator import RosOperator
from tsd_twin.adapters.ros.port import OpenPort, RosPort
from tsd_twin.adapters.ros.shared_names import NameWatch
from tsd_twin.adapters.ros_messages import ODOMETRY, RosMessage, RosNames
from tsd_twin.bus import Bus
from tsd_twin.client.bus_port import BusLink
from tsd_twin.errors import TwinError
from tsd_twin.messages.sentences import sentence

_TIMEOUT_S = 5.0


class QuietServer(ThreadingHTTPServer):
    """HTTP server that ignores clients disconnecting during a response."""

    daemon_threads = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print request errors other than connection failures."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


class MeshServer:
    """HTTP server for `/<robot>/<file>`."""

    def __init__(self, host: str, port: int) -> None:
        """Start listening; port 0 selects a free port.

        Raises:
            TwinError: If the address is not available.
        """
        self.robots: dict[str, Callable[[str], bytes | None]] = {}
        """Mesh file lookup by robot."""
        served = self

        class Handler(BaseHTTPRequestHandler):
            timeout = _TIMEOUT_S

            def do_GET(self) -> None:
                body = served.file(self.path)
                self.send_response(404 if body is None else 200)
                self.send_header("Content-Type", "model/stl")
                self.send_header("Content-Length", str(len(body or b"")))
                with contextlib.suppress(ConnectionError):  # The client disconnected.
                    self.end_headers()
                    self.wfile.write(body or b"")

            def log_message(self, format: str, *args: Any) -> None:  # noqa: A002  Base-class name.
                """Disable request logging."""

        try:
            self._server = QuietServer((host, port), Handler)
        except OSError as error:
            raise TwinError(f"port {port} of {host} cannot be used for meshes") from error
        self._host = host
        threading.Thread(target=self._server.serve_forever, args=(0.1,), daemon=True).start()

    def uri(self, robot: str) -> str:
        """Return the URI prefix for files of a robot."""
        return f"http://{self._host}:{self._server.server_address[1]}/{robot}/"

    def file(self, path: str) -> bytes | None:
        """Return the file for a request path, or None."""
        robot, _, name = path.lstrip("/").partition("/")
        get = self.robots.get(robot)
        return None if get is None else get(name)

    def close(self) -> None:
        """Stop listening."""
        self._server.shutdown()
        self._server.server_close()


_LOG = logging.getLogger(__name__)
_WATCH_S = 0.05
_STAMP = struct.Struct("<iI")
"""Header stamp, after the four bytes of the CDR encapsulation."""


class RosSource(RobotSource):
    """Robot on the bus, shown as a ROS node."""

    def __init__(
        self,
        open_port: OpenPort,
        meshes: MeshServer | str,
        operator: str,
        machines: dict[str, CmdVelOperator] | None,
        require_echo: bool,
        link: BusLink,
    ) -> None:
        """`meshes` is a server or a URI prefix; without `machines`, ROS is read-only.

        `machines` keeps the state of all robots seen, including this one. With `require_echo`, a
        twist moves the robot only if it carries the stamp of an `odom`.
        """
        self._open_port, self._meshes_at = open_port, meshes
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
        if isinstance(self._meshes_at, MeshServer):
            self._meshes_at.robots[self.id] = self.meshes.get
        port = await asyncio.to_thread(self._open_port, names, self._operator)
        self._port, self._watch = port, NameWatch(port, names, is_shown=True)
        if self._operator is not None:
            self._operator.topic_opened()

    async def withdraw(self, names: RosNames) -> None:  # noqa: ARG002  Interface.
        """Leave the graph."""
        port, self._port, self._watch = self._port, None, None
        if port is not None:
            await asyncio.to_thread(port.close)

    def mesh_uri(self, names: RosNames) -> str:  # noqa: ARG002  Interface.
        """Return the URI prefix of mesh files."""
        at = self._meshes_at
        return at.uri(self.id) if isinstance(at, MeshServer) else at

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
        return self.shared_name(time.monotonic()) or self._operator.problem()

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


async def serve_ros(
    open_bus: Callable[[], Bus],
    open_port: OpenPort,
    meshes: MeshServer | str,
    stop: threading.Event,
    ready: Callable[[], None],
    *,
    operator: str,
    may_drive: bool = True,
    require_echo: bool = False,
    only: Collection[str] = (),
) -> None:
    """Show all robots on the bus to ROS until `stop` is set.

    Raises:
        TwinError: If the bus cannot be opened.
    """
    name = operator[:LONGEST_OPERATOR]
    machines = dict[str, CmdVelOperator]() if may_drive else None
    bus = await asyncio.to_thread(open_bus)
    # Skip robots imported from ROS, or two adapters would drive each other in a loop.
    fleet = Fleet(
        lambda link: RosSource(open_port, meshes, name, machines, require_echo, link),
        open_bus,
        only,
        lambda robot: not robot.driven_by_ros,
    )
    try:
        fleet.watch(bus)
        ready()
        while not stop.is_set():
            await asyncio.sleep(_WATCH_S)
    finally:
        await fleet.close()
        bus.close()
