"""The page that the operator opens: viser's own, with our scripts in it."""

from __future__ import annotations

import gzip
import hashlib
from pathlib import Path

import viser
from aiohttp import web

from tsd_twin.errors import TwinError

STATIC = Path(__file__).parent / "static"
"""Our scripts and styles."""
STRIPPED = frozenset({"websocket", "playbackPath"})
"""Query parameters by which a link could make viser's client obey a foreign server."""

_FIRST = '<script src="static/boot.js"></script><script src="static/pace.js"></script>'
_LAST = '<script type="module" src="static/overlay.js"></script>'


class IndexPage:
    """viser's client, read once from the installed package."""

    def __init__(self) -> None:
        """Read it.

        Raises:
            TwinError: the package has no client that scripts can be added to.
        """
        file = Path(viser.__file__).parent / "client" / "build" / "index.html"
        try:
            html = with_scripts(file.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise TwinError(f"viser's page cannot be used: {error}") from error
        self._plain = html.encode()
        self._zipped = gzip.compress(self._plain, mtime=0)
        self._etag = hashlib.sha256(self._plain).hexdigest()[:16]

    async def serve(self, request: web.Request) -> web.StreamResponse:
        """Answer `GET /`."""
        if STRIPPED & request.query.keys():
            return web.Response(status=302, headers={"Location": without_stripped(request)})
        response = web.Response(content_type="text/html", charset="utf-8")
        response.headers["Cache-Control"] = "no-cache"
        response.headers["Vary"] = "Accept-Encoding"
        response.etag = self._etag
        known = request.if_none_match or ()
        if any(tag.value == self._etag for tag in known):
            response.set_status(304)
            return response
        if "gzip" in request.headers.get("Accept-Encoding", ""):
            response.headers["Content-Encoding"] = "gzip"
            response.body = self._zipped
        else:
            response.body = self._plain
        return response


def with_scripts(html: str) -> str:
    """Return the page with our scripts: two before all others, one at the end of the head.

    Raises:
        ValueError: it has no head.
    """
    # The client's own code, in the head, may mention the end of a head: the last one is the end.
    start, end = html.index("<head>") + len("<head>"), html.rindex("</head>")
    return html[:start] + _FIRST + html[start:end] + _LAST + html[end:]


def without_stripped(request: web.Request) -> str:
    """Return the same address, relative, without the parameters that are stripped."""
    kept = [(key, value) for key, value in request.query.items() if key not in STRIPPED]
    return "?" + request.url.with_query(kept).raw_query_string
