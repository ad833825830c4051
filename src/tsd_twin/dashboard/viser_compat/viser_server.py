"""viser server on the loopback, behind a secret key that only the HTTP server of the dashboard
sends.

viser 1.1.1 has no authentication: another user of this machine, or a foreign page in the operator's
browser, which may open a WebSocket to any port of the loopback, could connect. A browser sends no
header of a page's choice, and only this process knows the key.
"""

from __future__ import annotations

import functools
import http
import secrets
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any, TypeAlias

import rich
import viser
from websockets.asyncio import server as websockets_server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from tsd_twin.dashboard.viser_compat import patches
from tsd_twin.dashboard.viser_compat.private_api import refuse_sharing

KEY_HEADER = "X-Tsd-Key"
_SERVE_FUNCTION = "serve"
_PATCH_LOCK = threading.Lock()
_REFUSAL = "Only the gateway may speak to this port.\n"
_ProcessRequest: TypeAlias = Callable[[ServerConnection, Request], Response | None]


@functools.cache
def access_key() -> str:
    """Return the key of all viser servers of this process."""
    return secrets.token_hex(32)


def has_access_key(request: Request) -> bool:
    """Return whether a request brings the key, once."""
    brought = request.headers.get_all(KEY_HEADER)
    return len(brought) == 1 and secrets.compare_digest(
        brought[0].encode("utf-8", "replace"), access_key().encode()
    )


@contextmanager
def require_access_key() -> Generator[None]:
    """Make servers started in this context refuse requests without the key, before the upgrade.

    viser names the function that makes its server when it starts, and only then.
    """
    serve = websockets_server.serve

    def serve_locked(*args: Any, process_request: _ProcessRequest, **options: Any) -> Any:
        def answer(connection: ServerConnection, request: Request) -> Response | None:
            if not has_access_key(request):
                return connection.respond(http.HTTPStatus.FORBIDDEN, _REFUSAL)
            return process_request(connection, request)

        return serve(*args, process_request=answer, **options)

    with _PATCH_LOCK:
        setattr(websockets_server, _SERVE_FUNCTION, serve_locked)
        try:
            yield
        finally:
            setattr(websockets_server, _SERVE_FUNCTION, serve)


LOOPBACK = "127.0.0.1"
BRAND_COLOUR = (36, 132, 227)
CAMERA_OFFSET_M = (-0.78, -0.58, 0.62)
"""Where the camera starts, seen from the robot: behind it on its right, so that it drives away."""
LOOK_AT_M = (0.0, 0.0, 0.03)
FIELD_OF_VIEW_RAD = 0.80
PANEL_WIDTH_PX = 288
"""The narrowest that all tabs fit into in one row."""


def start_server(title: str, *, dark: bool = True) -> viser.ViserServer:
    """Return a running server on a free port of the loopback; `get_port()` says which.

    viser has no authentication and no check of origins, so the port requires `access_key()`. A
    port that the system chooses is free, so viser does not go looking for another one.

    Raises:
        TwinError: another version of viser is installed than the one that this is made for.
    """
    patches.check_viser_version()
    patches.install_thread_safe_queues()
    patches.install_fast_pose_setter()
    patches.install_strict_value_check()
    # viser announces itself on standard output, where our programs print one line only.
    rich.get_console().quiet = True
    with require_access_key():
        server = viser.ViserServer(host=LOOPBACK, port=0, label=title, verbose=False)
    refuse_sharing(server)
    patches.install_bounded_replay(server)
    set_theme(server.gui, dark=dark)
    server.gui.main_panel.dock_right()
    server.gui.main_panel.set_width(PANEL_WIDTH_PX)
    server.scene.set_up_direction("+z")
    server.initial_camera.position = CAMERA_OFFSET_M
    server.initial_camera.look_at = LOOK_AT_M
    server.initial_camera.fov = FIELD_OF_VIEW_RAD
    return server


def set_theme(gui: viser.GuiApi, *, dark: bool) -> None:
    """Set dark or light colours for all clients, or for the client of `gui`."""
    gui.configure_theme(
        control_width="small",
        dark_mode=dark,
        show_logo=False,
        show_share_button=False,
        brand_color=BRAND_COLOUR,
    )
