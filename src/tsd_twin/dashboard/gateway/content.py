"""Responses with a fixed body, compressed and with an entity tag."""

from __future__ import annotations

import gzip
import hashlib
from collections.abc import Mapping
from pathlib import Path

from aiohttp import web

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
        self._is_text = self._type.startswith("text/")  # Fonts and pictures are compressed already.
        self._zipped = gzip.compress(body, mtime=0) if self._is_text else None
        self._etag = hashlib.sha256(body).hexdigest()[:16]

    @classmethod
    def of_file(cls, file: Path) -> Content:
        """Read a file.

        Raises:
            OSError: If it cannot be read.
        """
        return cls(file.read_bytes(), file.suffix)

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
