"""File downloads with ranges, sent at the pace at which the client reads."""

from __future__ import annotations

import asyncio
import os
import unicodedata
from pathlib import Path
from typing import BinaryIO
from urllib.parse import quote

from aiohttp import web

_PART_BYTES = 1 << 18
_RESERVED = frozenset('<>:"/\\|?*')
"""Characters that some file system does not allow in names."""


def attachment(name: str) -> str:
    """Return a `Content-Disposition` header for a file name in any script, in NFC."""
    normal = unicodedata.normalize("NFC", name)
    safe = "".join(
        "_" if each in _RESERVED or unicodedata.category(each).startswith("C") else each
        for each in normal
    ).strip(". ")
    plain = "".join(each if each.isascii() else "_" for each in safe).replace("%", "_")
    return f"attachment; filename=\"{plain}\"; filename*=UTF-8''{quote(safe, safe='')}"


async def send_file(
    request: web.Request, path: Path, name: str, content_type: str = "application/octet-stream"
) -> web.StreamResponse:
    """Send a file, or the range that the request asks for, up to its current size.

    `web.FileResponse` would send after the handler has returned, without the timeout for clients
    that do not read.

    Raises:
        web.HTTPException: If the file is gone or the range is invalid.
    """
    try:
        file = await asyncio.to_thread(path.open, "rb")
    except OSError as error:
        raise web.HTTPNotFound(text="There is no such file.") from error
    try:
        about = os.fstat(file.fileno())
        etag = f"{about.st_mtime_ns:x}-{about.st_size:x}"
        response = web.StreamResponse()
        start, length = _range(request, about.st_size, etag)
        if length < about.st_size:
            response.set_status(206)
            last = start + length - 1
            response.headers["Content-Range"] = f"bytes {start}-{last}/{about.st_size}"
        response.etag = etag
        response.content_type = content_type
        response.content_length = length
        response.headers["Accept-Ranges"] = "bytes"
        response.headers["Cache-Control"] = "no-store"
        response.headers["Content-Disposition"] = attachment(name)
        await response.prepare(request)
        if request.method != "HEAD":
            await _send(response, file, start, length)
        await response.write_eof()
        return response
    finally:
        file.close()


def _range(request: web.Request, size: int, etag: str) -> tuple[int, int]:
    """Return start and length of the requested range; the whole file if it changed since.

    Raises:
        web.HTTPRequestRangeNotSatisfiable: If it contains no byte of the file.
    """
    if request.headers.get("If-Range", f'"{etag}"') != f'"{etag}"':
        return 0, size
    try:
        wanted = request.http_range
    except ValueError:
        return 0, size  # Several ranges: the whole file is a valid answer.
    if wanted.start is None and wanted.stop is None:
        return 0, size
    start, stop, _ = wanted.indices(size)
    if start >= stop:
        raise web.HTTPRequestRangeNotSatisfiable(headers={"Content-Range": f"bytes */{size}"})
    return start, stop - start


async def _send(response: web.StreamResponse, file: BinaryIO, start: int, length: int) -> None:
    file.seek(start)
    while length > 0:
        data = await asyncio.to_thread(file.read, min(length, _PART_BYTES))
        if not data:  # Truncated by another program: the client sees an incomplete download.
            response.force_close()
            return
        length -= len(data)
        await response.write(data)
