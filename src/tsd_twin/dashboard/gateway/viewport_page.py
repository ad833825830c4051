"""viser's page for a frame of the dashboard's page.

It loads the frame script before all others, and only the dashboard's page may frame it.
"""

from __future__ import annotations

from pathlib import Path

import viser
from aiohttp import web

from tsd_twin.dashboard.gateway.auth import CLIENT_ADDRESS, CONTENT_SOURCES, HEADERS, policy_of
from tsd_twin.dashboard.gateway.content import Content
from tsd_twin.dashboard.gateway.listener import LISTENER, Listener
from tsd_twin.errors import TwinError

BUNDLE = Path(__file__).parents[1] / "bundle"
"""The page, built from `web/`."""
VIEWPORT_PATH = "/viewport/"
_FRAME_SCRIPT = "frame.js"
BLOCKED_PARAMETERS = frozenset({"websocket", "playbackPath"})
"""Query parameters with which a link could connect viser's client to a foreign server."""


class ViewportPage:
    """viser's page and the frame script, on both ports."""

    def __init__(self, main: Listener) -> None:
        """Read viser's page; `main` is the port of the page that frames it.

        Raises:
            TwinError: If viser's page has no place for a script, or the bundle is missing.
        """
        self._main = main
        file = Path(viser.__file__).parent / "client" / "build" / "index.html"
        try:
            html = _with_script(file.read_text(encoding="utf-8"), _FRAME_SCRIPT)
            self._script = Content.of_file(BUNDLE / _FRAME_SCRIPT)
        except (OSError, ValueError) as error:
            raise TwinError(f"viser's page cannot be used: {error}") from error
        self._page = Content(html.encode(), file.suffix)

    def add_to(self, router: web.UrlDispatcher) -> None:
        """Register the routes of the page and its script."""
        router.add_get(VIEWPORT_PATH, self._serve)
        router.add_get(VIEWPORT_PATH + _FRAME_SCRIPT, self._serve_script)

    async def _serve(self, request: web.Request) -> web.StreamResponse:
        if BLOCKED_PARAMETERS & request.query.keys():
            return _without_blocked_parameters(request)
        parent = request.query.get("parent", "")
        host, secure = request.headers["Host"], request[CLIENT_ADDRESS].secure
        accepted = (
            self._main.refusal(host, parent, secure=secure) is None
            if request.app[LISTENER] is self._main
            else self._main.accepts_parent(parent, host, secure=secure)
        )
        if not accepted:
            raise web.HTTPForbidden(text="Only the dashboard's page may show this in a frame.")
        policy = policy_of(CONTENT_SOURCES | {"frame-ancestors": parent})
        return self._page.respond(request, HEADERS | {"Content-Security-Policy": policy})

    async def _serve_script(self, request: web.Request) -> web.StreamResponse:
        return self._script.respond(request)


def _with_script(html: str, script: str) -> str:
    """Return the page with `script` before all others.

    Raises:
        ValueError: If the page has no head.
    """
    start = html.index("<head>") + len("<head>")
    return f'{html[:start]}<script src="{script}"></script>{html[start:]}'


def _without_blocked_parameters(request: web.Request) -> web.Response:
    """Return a redirect to the same page without the blocked parameters."""
    kept = [(key, value) for key, value in request.query.items() if key not in BLOCKED_PARAMETERS]
    address = "?" + request.url.with_query(kept).raw_query_string
    return web.Response(status=302, headers={"Location": address})
