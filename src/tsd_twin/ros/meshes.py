"""HTTP server of mesh files, which rviz fetches by the addresses in `robot_description`."""

from __future__ import annotations

import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from tsd_twin.errors import TwinError

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

            def log_message(self, format: str, *args: Any) -> None:  # noqa: A002  As above.
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
