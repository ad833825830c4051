"""Private API of viser that the dashboard uses: the only access to it, and why its version is
pinned.
"""

from __future__ import annotations

from operator import attrgetter

import numpy as np
import viser
from viser import _messages as messages  # The classes of what it sends; it exports none.

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
    """Return the page that a client belongs to; None when unknown or disconnected."""
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
