"""The dashboard's page, built from `web/`, and viser's page for a frame of it.

viser's page loads the frame script before all others, and only the dashboard's page may frame it.
"""

from __future__ import annotations

import gzip
import hashlib
import re
from base64 import b64encode
from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path

import viser
from aiohttp import web

from tsd_twin.dashboard.gateway.auth import CLIENT_ADDRESS, CONTENT_SOURCES, HEADERS, policy_of
from tsd_twin.dashboard.gateway.listener import LISTENER, Listener
from tsd_twin.errors import TwinError
from tsd_twin.security.web_access import name_of_host

_TYPES = {
    ".html": "text/html",
    ".js": "text/javascript",
    ".css": "text/css",
    ".woff2": "font/woff2",
    ".webp": "image/webp",
}


class Content:
    """Body that is sent with revalidation, compressed if the browser accepts it."""

    def __init__(self, body: bytes, suffix: str) -> None:
        """Compress `body`; `suffix` of its file name selects the content type."""
        self._type = _TYPES[suffix]
        self._plain = body
        self._is_text = self._type.startswith("text/")  # The others are compressed.
        self._zipped = gzip.compress(body, mtime=0) if self._is_text else None
        self._etag = hashlib.sha256(body).hexdigest()[:16]

    @classmethod
    def of_file(cls, file: Path) -> Content:
        """Read a file.

        Raises:
            OSError: If it cannot be read.
        """
        return cls(file.read_bytes(), file.suffix)

    async def serve(self, request: web.Request) -> web.StreamResponse:
        """Answer a GET request."""
        return self.respond(request)

    def respond(
        self, request: web.Request, headers: Mapping[str, str] | None = None
    ) -> web.StreamResponse:
        """Answer a GET request, with 304 if the browser has this body already."""
        charset = "utf-8" if self._is_text else None
        response = web.Response(content_type=self._type, charset=charset)
        response.headers.update(headers or {})
        response.headers["Cache-Control"] = "no-cache"
        response.headers["Vary"] = "Accept-Encoding"
        response.etag = self._etag
        if any(tag.value == self._etag for tag in request.if_none_match or ()):
            response.set_status(304)
        elif self._zipped is not None and "gzip" in request.headers.get("Accept-Encoding", ""):
            response.headers["Content-Encoding"] = "gzip"
            response.body = self._zipped
        else:
            response.body = self._plain
        return response


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
        router.add_get(VIEWPORT_PATH + _FRAME_SCRIPT, self._script.serve)

    async def _serve(self, request: web.Request) -> web.StreamResponse:
        if BLOCKED_PARAMETERS & request.query.keys():
            kept = [(k, v) for k, v in request.query.items() if k not in BLOCKED_PARAMETERS]
            address = "?" + request.url.with_query(kept).raw_query_string
            return web.Response(status=302, headers={"Location": address})
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


def _with_script(html: str, script: str) -> str:
    """Return the page with `script` before all others.

    Raises:
        ValueError: If the page has no head.
    """
    start = html.index("<head>") + len("<head>")
    return f'{html[:start]}<script src="{script}"></script>{html[start:]}'


FILES = ("page.js", "page.css", "inter.woff2")
_INLINE = re.compile(r"<(script|style)>(.*?)</\1>", re.DOTALL)


class BundlePage:
    """Page with its files; its policy allows its own scripts and the viewport's frame only."""

    def __init__(self) -> None:
        """Read the bundle.

        Raises:
            TwinError: If a file is missing.
        """
        try:
            self._html = (BUNDLE / "index.html").read_text(encoding="utf-8")
            self._files = {name: Content.of_file(BUNDLE / name) for name in FILES}
        except OSError as error:
            raise TwinError(f"the page is not built: {error}") from error
        hashes: dict[str, list[str]] = {"script": [], "style": []}
        for kind, text in _INLINE.findall(self._html):
            hashes[kind].append(f"'sha256-{b64encode(sha256(text.encode()).digest()).decode()}'")
        self._sources = {
            "default-src": "'none'",
            "script-src": " ".join(["'self'", *hashes["script"]]),
            "style-src": " ".join(["'self'", *hashes["style"]]),
            "img-src": "'self' data: blob:",
            "font-src": "'self'",
            "connect-src": "'self'",
            "base-uri": "'self'",
            "form-action": "'self'",
            "frame-ancestors": "'none'",
        }
        self._pages: dict[str, Content] = {}
        self._viewport = ""

    def set_viewport(self, port: int, origin: str | None) -> None:
        """Set where the viewport is: at `origin`, or the page's name and `port`; 0 for neither."""
        self._viewport = origin or (str(port) if port else "")

    def add_to(self, router: web.UrlDispatcher) -> None:
        """Register the routes of the page and its files."""
        router.add_get("/", self._serve)
        for name, file in self._files.items():
            router.add_get(f"/{name}", file.serve)

    async def _serve(self, request: web.Request) -> web.StreamResponse:
        name, secure = name_of_host(request.headers["Host"]), request[CLIENT_ADDRESS].secure
        # A content security policy cannot name an IPv6 address.
        viewport = "" if name.startswith("[") and self._viewport.isdigit() else self._viewport
        if viewport not in self._pages:
            html = self._html.replace("{{viewport}}", viewport)
            self._pages[viewport] = Content(html.encode(), ".html")
        frames = ["'self'", viewport]
        if viewport.isdigit():
            frames[1] = f"{'https' if secure else 'http'}://{name}:{viewport}"
        policy = policy_of(self._sources | {"frame-src": " ".join(frames).strip()})
        return self._pages[viewport].respond(request, HEADERS | {"Content-Security-Policy": policy})
