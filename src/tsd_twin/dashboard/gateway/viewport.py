"""WebSocket proxy to viser, with a filter for messages from browsers.

viser's protocol allows more than the dashboard needs: click any node, upload files, request a
public tunnel. Only the camera, and clicks on spheres, are forwarded.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import re
import socket
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from types import MappingProxyType
from typing import Annotated, Any, Literal, TypeAlias, cast

import msgspec
from aiohttp import ClientError, ClientSession, ClientWebSocketResponse, WSMessage, WSMsgType, web
from msgspec import Meta

from tsd_twin.dashboard.gateway.socket_limits import VISER, SocketReader, limit_buffer
from tsd_twin.dashboard.scene.viser_compat import (
    KEY_HEADER,
    LOOK_HEADER,
    LOOKS,
    PAGE_HEADER,
    ROBOTS_HEADER,
    access_key,
)
from tsd_twin.dashboard.sessions.principal import Principal
from tsd_twin.messages.errors import MessageError
from tsd_twin.security import Role
from tsd_twin.security.router_rules import show_robots

MAX_MESSAGE_BYTES = 16 * 2**10
"""A camera message has 300 bytes."""
_CAMERA_MESSAGE = "ViewerCameraMessage"
_CLICK_MESSAGE = "SceneNodeClickMessage"
_CLICK_TARGET = r"^/w/r/[a-z0-9_-]{1,32}/x\Z"
"""Clickable scene nodes, which are the spheres."""
_IGNORED_MESSAGES = frozenset(
    {
        "CommandTriggerMessage",
        "FileTransferPart",
        "FileTransferPartAck",
        "FileTransferStartUpload",
        "GetRenderResponseMessage",
        "GuiButtonHoldMessage",
        "GuiFormSubmitMessage",
        "GuiUpdateMessage",
        "LocalStorageGetItemResponseMessage",
        "SceneNodeDragMessage",
        "ScenePointerMessage",
        "ShareUrlDisconnect",
        "ShareUrlRequest",
        "TransformControlsDragEndMessage",
        "TransformControlsDragStartMessage",
        "TransformControlsUpdateMessage",
    }
)
"""Other messages of viser's page, which this dashboard does not use."""
_OFF = 0.1
"""Tolerance of the length of a unit quaternion."""
_DECODER = msgspec.msgpack.Decoder(dict[str, Any])

_Number: TypeAlias = Annotated[float, Meta(ge=-1e9, le=1e9)]
_Positive: TypeAlias = Annotated[float, Meta(gt=0.0, le=1e9)]
_Pixels: TypeAlias = Annotated[int, Meta(ge=0, le=100_000)]
_Triple: TypeAlias = tuple[_Number, _Number, _Number]

_Modifier: TypeAlias = Literal[
    "cmd/ctrl",
    "alt",
    "shift",
    "cmd/ctrl+alt",
    "cmd/ctrl+shift",
    "alt+shift",
    "cmd/ctrl+alt+shift",
]


class _FromBrowser(msgspec.Struct, forbid_unknown_fields=True, frozen=True, tag_field="type"):
    """Base class of accepted browser messages, with the type and range of each field."""


class _Camera(_FromBrowser, frozen=True, tag=_CAMERA_MESSAGE):
    wxyz: tuple[_Number, _Number, _Number, _Number]
    position: _Triple
    fov: Annotated[float, Meta(gt=0.0, lt=math.pi)]
    near: _Positive
    far: _Positive
    image_height: _Pixels
    image_width: _Pixels
    look_at: _Triple
    up_direction: _Triple


class _Click(_FromBrowser, frozen=True, tag=_CLICK_MESSAGE):
    name: Annotated[str, Meta(pattern=_CLICK_TARGET)]
    ray_origin: _Triple
    ray_direction: _Triple
    instance_index: Annotated[int, Meta(ge=0, le=100_000)] | None = None
    screen_pos: tuple[_Number, _Number] = (0.0, 0.0)
    modifier: _Modifier | None = None
    owner: Annotated[str, Meta(max_length=64)] = ""


_KINDS: Mapping[str, type[_FromBrowser]] = MappingProxyType(
    {_CAMERA_MESSAGE: _Camera, _CLICK_MESSAGE: _Click}
)


def filter_message(frame: bytes, role: Role) -> bytes | None:
    """Return the part of a frame to forward to viser, or None to forward nothing.

    Viewers may send only their camera. Forwarded messages are re-encoded from fields with checked
    types and ranges, so that viser reads exactly the checked values. A message of an accepted kind
    with other fields is dropped.

    Raises:
        MessageError: With code `shape` if viser's page cannot send such a message.
    """
    if len(frame) > MAX_MESSAGE_BYTES:
        raise MessageError("shape", f"no message has more than {MAX_MESSAGE_BYTES} bytes")
    try:
        message = _DECODER.decode(frame)
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise MessageError("shape", str(error)) from error
    kind = message.get("type")
    if not isinstance(kind, str) or (kind not in _KINDS and kind not in _IGNORED_MESSAGES):
        raise MessageError("shape", "viser's page says no such thing")
    if kind in _IGNORED_MESSAGES or (kind != _CAMERA_MESSAGE and role is not Role.OPERATOR):
        return None
    try:
        read = msgspec.convert(message, _KINDS[kind])
    except (msgspec.ValidationError, OverflowError):
        return None
    fields = msgspec.to_builtins(read)
    return msgspec.msgpack.encode(fields) if _is_finite(fields) else None


def _is_finite(value: Any) -> bool:
    """Return whether all numbers are finite and any quaternion has unit length."""
    match value:
        case float():
            return math.isfinite(value)
        case dict():
            fields = cast("dict[str, Any]", value)
            turned = fields.get("wxyz")
            unit = turned is None or abs(math.hypot(*turned) - 1.0) < _OFF
            return unit and all(map(_is_finite, fields.values()))
        case list() | tuple():
            return all(map(_is_finite, cast("Sequence[Any]", value)))
        case _:
            return True


PAGE_ID = re.compile(r"[0-9a-f]{16}")
"""Page id, chosen by the page; it grants no rights."""

_MAX_VISER_MESSAGE_BYTES = 64 * 2**20
_SOCKET_BUFFER_BYTES = 128 * 2**10
"""The kernel's default is 2 MB for a slow page, which is many seconds of old poses."""
_HEARTBEAT_S = 10.0
_CLOSE_TIMEOUT_S = 0.5


class ViserProxy:
    """WebSocket proxy from each page's `viser/<page>` to the viser server."""

    def __init__(self, viser_port: int, reader: SocketReader) -> None:
        self.dropped = 0
        """Number of page messages that were not forwarded."""
        self._reader = reader
        self._url = f"ws://127.0.0.1:{viser_port}/"
        self._client: ClientSession | None = None
        self._open: set[web.WebSocketResponse] = set()

    async def close(self) -> None:
        """Close all sockets."""
        await asyncio.gather(
            *(page.close(code=1001, message=b"the dashboard ends") for page in self._open)
        )
        if self._client is not None:
            await self._client.close()

    async def serve(
        self,
        request: web.Request,
        page_id: str,
        principal: Principal,
        holding: Callable[[web.WebSocketResponse], AbstractContextManager[None]],
        *,
        port: int | None = None,
    ) -> web.StreamResponse:
        """Answer `GET viser/<page>`, with the page's socket open within `holding`.

        `port` selects the viser server of a recording.
        """
        viser = await self._connect_viser(request, page_id, principal, port)
        async with viser:
            chosen = (viser.protocol,) if viser.protocol else ()
            page = web.WebSocketResponse(
                timeout=_CLOSE_TIMEOUT_S,
                protocols=chosen,
                compress=False,
                max_msg_size=MAX_MESSAGE_BYTES,
                heartbeat=_HEARTBEAT_S,
                autoping=False,
            )
            await page.prepare(request)
            limit_buffer(request.get_extra_info("socket"), socket.SO_SNDBUF, _SOCKET_BUFFER_BYTES)
            limit_buffer(viser.get_extra_info("socket"), socket.SO_RCVBUF, _SOCKET_BUFFER_BYTES)
            self._open.add(page)
            try:
                with holding(page):
                    messages = self._reader.messages(request, page, VISER, principal.key or page_id)
                    await self._relay(request, page, viser, messages, principal.identity.role)
            finally:
                self._open.discard(page)
        return page

    async def _connect_viser(
        self, request: web.Request, page_id: str, principal: Principal, port: int | None
    ) -> ClientWebSocketResponse:
        if self._client is None:
            self._client = ClientSession()
        offered = request.headers.get("Sec-WebSocket-Protocol", "")
        try:
            return await self._client.ws_connect(
                self._url if port is None else f"ws://127.0.0.1:{port}/",
                protocols=[name.strip() for name in offered.split(",") if name.strip()],
                headers={
                    KEY_HEADER: access_key(),
                    PAGE_HEADER: page_id,
                    LOOK_HEADER: _look(request),
                    ROBOTS_HEADER: ",".join(show_robots(principal.rights.visible)),
                },
                compress=0,
                max_msg_size=_MAX_VISER_MESSAGE_BYTES,
            )
        except (ClientError, OSError) as error:
            raise web.HTTPServiceUnavailable(text=f"viser does not answer: {error}") from error

    async def _relay(
        self,
        request: web.Request,
        page: web.WebSocketResponse,
        viser: ClientWebSocketResponse,
        messages: AsyncIterator[WSMessage],
        role: Role,
    ) -> None:
        """Relay messages in both directions until either side closes, then close the other."""
        ways = [
            asyncio.create_task(self._pass_checked(messages, viser, role)),
            asyncio.create_task(_relay_to_page(viser, page)),
        ]
        try:
            await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for way in ways:
                way.cancel()
            await asyncio.gather(*ways, return_exceptions=True)
            await self._reader.close_cut_off(request, page)
            # viser's close code indicates a client version mismatch.
            await page.close(code=viser.close_code or 1001)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_CLOSE_TIMEOUT_S):
                    await viser.close()

    async def _pass_checked(
        self, messages: AsyncIterator[WSMessage], sink: ClientWebSocketResponse, role: Role
    ) -> None:
        """Forward the allowed messages of a page until it sends an invalid one."""
        with contextlib.suppress(ConnectionError, MessageError):
            async for message in messages:
                if message.type is not WSMsgType.BINARY:
                    return
                if (frame := filter_message(message.data, role)) is not None:
                    await sink.send_bytes(frame)
                else:
                    self.dropped += 1


def _look(request: web.Request) -> str:
    """Return the known words of the page's look, or a dash if there are no known ones."""
    asked = request.query.get("look", "").split("-")
    return "-".join(word for word in LOOKS if word in asked) or "-"


async def _relay_to_page(source: ClientWebSocketResponse, sink: web.WebSocketResponse) -> None:
    """Forward messages one at a time, so that a slow reader slows the sender without a queue."""
    with contextlib.suppress(ConnectionError):
        async for message in source:
            if message.type is WSMsgType.BINARY:
                await sink.send_bytes(message.data)
