"""ROS adapter of all robots on the bus, and a mesh file server."""

from __future__ import annotations

import asyncio
import contextlib
import sys
import threading
from collections.abc import Callable, Collection
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, cast

from tsd_twin.adapters.cmd_vel import CmdVelOperator
from tsd_twin.adapters.fleet import LONGEST_OPERATOR, Fleet, MeshFiles
from tsd_twin.adapters.ros.operator import RosSource
from tsd_twin.adapters.ros.port import OpenPort
from tsd_twin.bus import Bus
from tsd_twin.errors import TwinError

_TIMEOUT_S = 5.0
_WATCH_S = 0.05


class MeshServer(ThreadingHTTPServer):
    """HTTP server for `/<robot>/<file>`."""

    daemon_threads = True

    def __init__(self, host: str, port: int) -> None:
        """Start listening; port 0 selects a free port."""
        self._robots: dict[str, MeshFiles] = {}
        try:
            super().__init__((host, port), _MeshHandler)
        except OSError as error:
            raise TwinError(f"port {port} of {host} cannot be used for meshes") from error
        self._host = host
        threading.Thread(target=self.serve_forever, args=(0.1,), daemon=True).start()

    def serve(self, robot: str, files: MeshFiles) -> str:
        """Serve the files of a robot and return their URI prefix."""
        self._robots[robot] = files
        return f"http://{self._host}:{self.server_address[1]}/{robot}/"

    def file(self, path: str) -> bytes | None:
        """Return the file for a request path, or None."""
        robot, _, name = path.lstrip("/").partition("/")
        files = self._robots.get(robot)
        return None if files is None else files.get(name)

    def close(self) -> None:
        """Stop listening."""
        self.shutdown()
        self.server_close()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print request errors other than connection failures."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


class _MeshHandler(BaseHTTPRequestHandler):
    timeout = _TIMEOUT_S

    def do_GET(self) -> None:
        body = cast("MeshServer", self.server).file(self.path)
        self.send_response(404 if body is None else 200)
        self.send_header("Content-Type", "model/stl")
        self.send_header("Content-Length", str(len(body or b"")))
        with contextlib.suppress(ConnectionError):  # The client disconnected.
            self.end_headers()
            self.wfile.write(body or b"")

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002  Base-class name.
        """Disable request logging."""


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

    `meshes` is a server, or the URI prefix of meshes served elsewhere.
    """
    name = operator[:LONGEST_OPERATOR]
    machines = dict[str, CmdVelOperator]() if may_drive else None
    mesh_uri: Callable[[str, MeshFiles], str] = (
        meshes.serve if isinstance(meshes, MeshServer) else lambda _robot, _files: meshes
    )
    bus = await asyncio.to_thread(open_bus)
    # Skip robots imported from ROS, or two adapters would drive each other in a loop.
    fleet = Fleet(
        lambda link: RosSource(open_port, mesh_uri, name, machines, require_echo, link),
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
