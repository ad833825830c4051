"""HTTP interface of the recordings folder: list, search, titles, downloads, deletion and undo.

Refusals are JSON: `code`, for texts of the page, and `text`, one sentence in English.
"""

from __future__ import annotations

import math
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

import msgspec
from aiohttp import web
from aiohttp.typedefs import Handler

from tsd_twin.dashboard.gateway.auth import PRINCIPAL, require_origin
from tsd_twin.dashboard.gateway.file_download import send_file
from tsd_twin.dashboard.gateway.socket_limits import Bucket, Quota
from tsd_twin.dashboard.recorded.exports import KINDS, Exports, ExportsBusyError
from tsd_twin.dashboard.recorded.library import RecordingLibrary
from tsd_twin.dashboard.wire.recordings import TrashRow
from tsd_twin.errors import RecordingError
from tsd_twin.recording.export import RecordingSlice
from tsd_twin.recording.titles import FolderError, read_title
from tsd_twin.security import Role
from tsd_twin.security.router_rules import EVERY_ROBOT

CHANGES = Quota(1.0, 30.0)
"""Limit of titles, deletions and restorations for each login."""
MAX_DOWNLOADS = 4
"""Maximum number of simultaneous downloads and exports for each login."""
QUERY_LENGTH = 100
"""Maximum length of a search, characters."""
_MOST_LOGINS = 1000
_STATUS = {"no_recording": 404, "not_in_trash": 404, "being_written": 409, "name_taken": 409}
_EXPORT_TYPES = {"html": "text/html", "csv": "application/zip", "mcap": "application/octet-stream"}


class _Title(msgspec.Struct, forbid_unknown_fields=True):
    title: str


class _ExportQuery(msgspec.Struct, forbid_unknown_fields=True):
    kind: str = msgspec.field(name="as")
    start_s: float = msgspec.field(default=0.0, name="from")
    end_s: float | None = msgspec.field(default=None, name="to")
    robot: str | None = None


class RecordingRoutes:
    """Routes of the recordings; event loop only."""

    def __init__(self, library: RecordingLibrary) -> None:
        self._library = library
        self._exports = Exports()
        self._changes: dict[str, Bucket] = {}
        self._downloads: dict[str, int] = {}

    def add_to(self, router: web.UrlDispatcher) -> None:
        """Register the routes."""
        router.add_get("/recordings", _refusing(self._list))
        router.add_get("/recordings/trash", _refusing(self._list_trash))
        router.add_post("/recordings/trash/{id}/restore", _refusing(self._restore))
        router.add_delete("/recordings/{name}", _refusing(self._delete))
        router.add_put("/recordings/{name}/title", _refusing(self._set_title))
        router.add_get("/recordings/{name}/path", _refusing(self._path))
        router.add_get("/recordings/{name}/lanes", _refusing(self._lanes))
        router.add_get("/recordings/{name}/download", _refusing(self._download))
        router.add_get("/recordings/{name}/export", _refusing(self._export))

    def close(self) -> None:
        """End all exports."""
        self._exports.close()

    # Lists.

    async def _list(self, request: web.Request) -> web.StreamResponse:
        query = request.query.get("q", "")
        if len(query) > QUERY_LENGTH:
            text = f"a search has at most {QUERY_LENGTH} characters"
            raise _refusal(web.HTTPBadRequest, "invalid_query", text)
        rows = await self._library.rows(query, request[PRINCIPAL].rights)
        response = json_response(rows)
        response.enable_compression()
        return response

    async def _list_trash(self, request: web.Request) -> web.StreamResponse:
        return json_response(await self._trash_of(request))

    async def _trash_of(self, request: web.Request) -> list[TrashRow]:
        """Return all deletions, or a user's own if not all robots may be watched."""
        rows, principal = await self._library.trash(), request[PRINCIPAL]
        own = principal.identity.name
        return [row for row in rows if principal.rights == EVERY_ROBOT or row.by == own]

    async def _permitted_file(self, request: web.Request) -> Path:
        name, rights = request.match_info["name"], request[PRINCIPAL].rights
        return await self._library.permitted_file(name, rights)

    async def _require_use(self, request: web.Request) -> None:
        """Refuse viewers, also of one of the robots in a recording.

        Raises:
            web.HTTPException: If the request is refused.
        """
        _require_operator(request)
        name, rights = request.match_info["name"], request[PRINCIPAL].rights
        if not await self._library.may_change(name, rights):
            raise _refusal(web.HTTPForbidden, "viewer", "viewers cannot do this")

    async def _path(self, request: web.Request) -> web.StreamResponse:
        path = await self._permitted_file(request)
        try:
            found = await self._library.paths(path)
        except RecordingError as error:
            raise FolderError("no_recording", "this recording cannot be shown") from error
        return json_response(found)

    async def _lanes(self, request: web.Request) -> web.StreamResponse:
        path = await self._permitted_file(request)
        response = json_response(await self._library.lanes(path))
        response.enable_compression()
        return response

    # Changes.

    async def _set_title(self, request: web.Request) -> web.StreamResponse:
        self._admit_change(request)
        await self._require_use(request)
        try:
            body = msgspec.json.decode(await request.read(), type=_Title)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            text = 'the body is {"title": "..."}'
            raise _refusal(web.HTTPBadRequest, "invalid_title", text) from error
        name = request.match_info["name"]
        title, previous = await self._library.set_title(name, body.title)
        return json_response({"name": name, "title": title, "previous": previous})

    async def _delete(self, request: web.Request) -> web.StreamResponse:
        self._admit_change(request)
        await self._require_use(request)
        operator = request[PRINCIPAL].identity.name
        row = await self._library.delete(request.match_info["name"], operator)
        return json_response(row)

    async def _restore(self, request: web.Request) -> web.StreamResponse:
        self._admit_change(request)
        deletion = request.match_info["id"]
        if deletion not in {row.id for row in await self._trash_of(request)}:
            raise FolderError("not_in_trash", "this recording is no longer in the trash")
        name = await self._library.restore(deletion)
        return json_response({"name": name})

    def _admit_change(self, request: web.Request) -> None:
        """Refuse a change by another site, a viewer or a flood.

        Raises:
            web.HTTPException: If the change is refused.
        """
        require_origin(request)
        _require_operator(request)
        key = request[PRINCIPAL].key or ""
        if key not in self._changes and len(self._changes) >= _MOST_LOGINS:
            del self._changes[next(iter(self._changes))]
        if not self._changes.setdefault(key, Bucket(CHANGES)).try_take(time.monotonic()):
            text = "too many changes: wait a second"
            raise _refusal(web.HTTPTooManyRequests, "too_many", text)

    # Downloads.

    async def _download(self, request: web.Request) -> web.StreamResponse:
        # It contains lease ids, with which a program on the bus could drive.
        await self._require_use(request)
        path = await self._permitted_file(request)
        name = (read_title(path) or path.stem) + ".mcap"
        return await self._send(request, lambda: send_file(request, path, name))

    async def _export(self, request: web.Request) -> web.StreamResponse:
        path = await self._permitted_file(request)
        query = _export_query(request)
        kind = query.kind
        part = RecordingSlice(path, query.start_s, query.end_s, query.robot)
        name = (read_title(path) or path.stem) + KINDS[kind]

        async def send() -> web.StreamResponse:
            async with self._exports.file(kind, part) as file:
                return await send_file(request, file, name, _EXPORT_TYPES[kind])

        return await self._send(request, send)

    async def _send(
        self, request: web.Request, send: Callable[[], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        """Send a file, unless another site asks for it or the login has too many downloads.

        Raises:
            web.HTTPException: If the download is refused.
        """
        if request.headers.get("Sec-Fetch-Site", "none") not in ("same-origin", "none"):
            text = "a download is started on this page only"
            raise _refusal(web.HTTPForbidden, "other_site", text)
        key = request[PRINCIPAL].key or ""
        if self._downloads.get(key, 0) >= MAX_DOWNLOADS:
            text = f"{MAX_DOWNLOADS} downloads are in progress"
            raise _refusal(web.HTTPTooManyRequests, "too_many", text)
        self._downloads[key] = self._downloads.get(key, 0) + 1
        try:
            return await send()
        finally:
            self._downloads[key] -= 1
            if not self._downloads[key]:
                del self._downloads[key]


def json_response(value: object) -> web.Response:
    """Return a value as JSON that no browser stores."""
    body, headers = msgspec.json.encode(value), {"Cache-Control": "no-store"}
    return web.Response(body=body, content_type="application/json", headers=headers)


def _export_query(request: web.Request) -> _ExportQuery:
    try:
        query = msgspec.convert(dict(request.query), _ExportQuery, strict=False)
    except msgspec.ValidationError as error:
        text = f"this is not an export: {error}"
        raise _refusal(web.HTTPBadRequest, "invalid_query", text) from error
    if not all(math.isfinite(each) for each in (query.start_s, query.end_s or 0.0)):
        raise _refusal(web.HTTPBadRequest, "invalid_query", "times are finite numbers")
    if query.kind not in KINDS:
        text = f"choose as={', '.join(KINDS)}"
        raise _refusal(web.HTTPBadRequest, "invalid_query", text)
    return query


def _require_operator(request: web.Request) -> None:
    if request[PRINCIPAL].identity.role is not Role.OPERATOR:
        raise _refusal(web.HTTPForbidden, "viewer", "viewers cannot do this")


def _refusing(handler: Handler) -> Handler:
    """Return a handler that answers refused changes and unreadable files with JSON."""

    async def handle(request: web.Request) -> web.StreamResponse:
        try:
            return await handler(request)
        except FolderError as error:
            return _problem(_STATUS.get(error.code, 400), error.code, str(error))
        except ExportsBusyError as error:
            return _problem(503, "busy", str(error), headers={"Retry-After": "5"})
        except RecordingError as error:
            return _problem(422, "failed", str(error))

    return handle


def _problem(
    status: int, code: str, text: str, headers: dict[str, str] | None = None
) -> web.Response:
    response = json_response({"code": code, "text": text})
    response.set_status(status)
    response.headers.update(headers or {})
    return response


def _refusal(kind: type[web.HTTPException], code: str, text: str) -> web.HTTPException:
    body = msgspec.json.encode({"code": code, "text": text}).decode()
    return kind(text=body, content_type="application/json")
