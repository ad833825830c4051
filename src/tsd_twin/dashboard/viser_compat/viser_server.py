"""viser server on the loopback, behind a secret key that only the HTTP server of the dashboard
sends, and the only access to the private API of viser, which pins its version.

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
from operator import attrgetter
from typing import Any, TypeAlias

import numpy as np
import rich
import viser
from viser import _messages as messages  # The classes of what it sends; it exports none.
from websockets.asyncio import server as websockets_server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from tsd_twin.dashboard.viser_compat import patches
from tsd_twin.lie import Array
from tsd_twin.security import Role

PAGE_HEADER = "X-Tsd-Page"
"""The gateway adds it to the request of a viser socket: the page that the socket belongs to."""
DARK_HEADER = "X-Tsd-Dark"
"""Likewise: 1 or 0 as the browser prefers dark or light colours."""
PLAIN_HEADER = "X-Tsd-Plain"
"""Likewise: 1 or 0, whether the browser draws without a graphics card."""
ROLE_HEADER = "X-Tsd-Role"
"""Likewise: role of the login."""

_SOCKET_SERVER = attrgetter("_websock_server")
_LIVE_CONNECTIONS = attrgetter("_websock_server._live_connections")
_SOCKET = attrgetter("_websock_connection")
_LABEL_NAME = "_label"
_LABEL = attrgetter(_LABEL_NAME)
_REBUILD_TAB = attrgetter("_parent._rebuild_tab_props")


def page_of(server: viser.ViserServer, client_id: int) -> str | None:
    """Page that a client belongs to; None when unknown or disconnected."""
    return _header_of(server, client_id, PAGE_HEADER)


def prefers_dark(server: viser.ViserServer, client_id: int) -> bool | None:
    """Return whether the browser of a client prefers dark colours; None when unknown."""
    word = _header_of(server, client_id, DARK_HEADER)
    return None if word is None else word == "1"


def has_no_gpu(server: viser.ViserServer, client_id: int) -> bool:
    """Return whether the browser of a client draws without a graphics card."""
    return _header_of(server, client_id, PLAIN_HEADER) == "1"


def is_viewer(server: viser.ViserServer, client_id: int) -> bool:
    """Return whether a client belongs to a viewer, whose input is ignored."""
    return _header_of(server, client_id, ROLE_HEADER) == Role.VIEWER


def _header_of(server: viser.ViserServer, client_id: int, name: str) -> str | None:
    connection = _LIVE_CONNECTIONS(server).get(client_id)
    if connection is None or connection.request is None:
        return None
    return connection.request.headers.get(name)


def is_disconnected(client: viser.ClientHandle) -> bool:
    """Return whether a client's connection is closed; viser reports it a little later."""
    return bool(_SOCKET(client).get_message_buffer().done)


def refuse_sharing(server: viser.ViserServer) -> None:
    """Unregister the handlers with which any client could open a public tunnel to the server."""
    for message in (messages.ShareUrlRequest, messages.ShareUrlDisconnect):
        _SOCKET_SERVER(server).unregister_handler(message)


def scale_instances(client: viser.ClientHandle, name: str, scales: Array) -> None:
    """Let one client see the instances of a shared batched node scaled by `scales` (n,); 0 hides.

    A client's own node of that name would hide all instances, and would have to be moved for it.
    """
    update = messages.SceneNodeUpdateMessage(name, {"batched_scales": np.float32(scales)})
    _SOCKET(client).queue_message(update)


def rename_tab(tab: viser.GuiTabHandle, label: str) -> None:
    """Rename a tab; it keeps its place and content."""
    if _LABEL(tab) != label:
        setattr(tab, _LABEL_NAME, label)
        _REBUILD_TAB(tab)()


KEY_HEADER = "X-Tsd-Key"
_SERVE_FUNCTION = "serve"
_PATCH_LOCK = threading.Lock()
_REFUSAL = "Only the gateway may speak to this port.\n"
_ProcessRequest: TypeAlias = Callable[[ServerConnection, Request], Response | None]


@functools.cache
def access_key() -> str:
    """Key of all viser servers of this process."""
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
PANEL_WIDTH_PX = 352
"""The narrowest that all tabs fit into in one row."""


def start_server(title: str, *, dark: bool = True) -> viser.ViserServer:
    """Running server on a free port of the loopback; `get_port()` returns it.

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
