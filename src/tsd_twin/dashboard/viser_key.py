"""The key to viser's port: whoever else finds the port, in this machine or in a browser, stays out.

viser 1.1.1 lets anybody in, and has no option for that: another user of this machine, and a foreign
page in the operator's browser, which may open a WebSocket to any port of the loopback. A browser
sends no header of a page's choice, and nobody but this process knows the key.
"""

from __future__ import annotations

import functools
import http
import secrets
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any, TypeAlias

from websockets.asyncio import server as websockets_server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

KEY_HEADER = "X-Tsd-Key"
_SERVE = "serve"
_LOCK = threading.Lock()
_NO = "Only the gateway may speak to this port.\n"
_Answer: TypeAlias = Callable[[ServerConnection, Request], Response | None]


@functools.cache
def key() -> str:
    """Return the key of all viser servers of this process."""
    return secrets.token_hex(32)


def has_key(request: Request) -> bool:
    """Return whether a request brings the key, once."""
    brought = request.headers.get_all(KEY_HEADER)
    return len(brought) == 1 and secrets.compare_digest(
        brought[0].encode("utf-8", "replace"), key().encode()
    )


@contextmanager
def locked() -> Generator[None]:
    """Let servers that are started meanwhile refuse whoever lacks the key, before any upgrade.

    viser names the function that makes its server when it starts, and only then.
    """
    serve = websockets_server.serve

    def serve_locked(*args: Any, process_request: _Answer, **options: Any) -> Any:
        def answer(connection: ServerConnection, request: Request) -> Response | None:
            if not has_key(request):
                return connection.respond(http.HTTPStatus.FORBIDDEN, _NO)
            return process_request(connection, request)

        return serve(*args, process_request=answer, **options)

    with _LOCK:
        setattr(websockets_server, _SERVE, serve_locked)
        try:
            yield
        finally:
            setattr(websockets_server, _SERVE, serve)
