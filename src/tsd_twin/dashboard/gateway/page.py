"""The dashboard's page, built from `web/`, and its files."""

from __future__ import annotations

import re
from base64 import b64encode
from hashlib import sha256

from aiohttp import web
from aiohttp.typedefs import Handler

from tsd_twin.dashboard.gateway.auth import CLIENT_ADDRESS, HEADERS, policy_of
from tsd_twin.dashboard.gateway.content import Content
from tsd_twin.dashboard.gateway.viewport_page import BUNDLE
from tsd_twin.errors import TwinError
from tsd_twin.security.web_access import name_of_host

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
            router.add_get(f"/{name}", self._serve_file(file))

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

    def _serve_file(self, file: Content) -> Handler:
        async def serve(request: web.Request) -> web.StreamResponse:
            return file.respond(request)

        return serve
