"""Adaptations of viser 1.1.1, which is pinned because of its private API: two patches.

Queues: viser sets the event of a queue on the thread that fills it, and again on the loop that
empties it. The first call is redundant, and fails if the loop starts or stops waiting at that
moment ("deque mutated during iteration"), which loses the rest of the frame. And every broadcast
message gets the next id, while a message that supersedes an older one (a new pose of the same node)
removes it, so only a few are kept; for each new client, viser tries all ids from zero, on the loop
that serves all clients: at 1200 poses per second, the hundred million ids of a day freeze all pages
for seconds. `MessageQueue` replaces viser's `AsyncMessageBuffer`.

Access: the server listens on the loopback interface and requires a secret key that only the
dashboard's HTTP server sends. Because viser has no authentication, another user of this machine
could otherwise connect, and so could a foreign page in the operator's browser, which may open a
WebSocket to any loopback port. Pages cannot set request headers of WebSockets, and only this
process knows the key. `require_access_key` wraps the function with which viser starts its server.
"""

from __future__ import annotations

import asyncio
import functools
import http
import secrets
import sys
import threading
import warnings
from collections.abc import AsyncGenerator, Callable, Generator, Sequence
from contextlib import contextmanager
from itertools import islice, takewhile
from operator import attrgetter
from typing import Any, TypeAlias, cast

import numpy as np
import rich
import viser
import viser.infra
from viser import _messages as messages  # Message classes, which viser does not export.
from viser.infra import Message
from viser.infra._async_message_buffer import AsyncMessageBuffer
from websockets.asyncio import server as websockets_server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from tsd_twin.errors import TwinError
from tsd_twin.lie import Array

_QUEUE_MODULE = sys.modules[viser.infra.WebsockServer.__module__]
_QUEUE_CLASS = "AsyncMessageBuffer"


class LoopEvent(asyncio.Event):
    """Event that only its loop can set; redundant calls from other threads are ignored."""

    def __init__(self, home: asyncio.AbstractEventLoop) -> None:
        super().__init__()
        self._home = home

    def set(self) -> None:
        """Set the event if called on the loop's thread."""
        try:
            here = asyncio.get_running_loop()
        except RuntimeError:
            return
        if here is self._home:
            super().set()


MessageFilter: TypeAlias = Callable[[Message], bool]
"""Returns whether a client may receive a message."""


class MessageQueue(AsyncMessageBuffer):
    """viser's message queue, filled from any thread, whose replay skips superseded messages."""

    def __init__(self, event_loop: asyncio.AbstractEventLoop, persistent_messages: bool) -> None:
        super().__init__(event_loop, persistent_messages)
        self.message_event = LoopEvent(event_loop)
        self.filters: dict[int, MessageFilter] = {}
        """Filters of clients that do not receive everything, by client id."""
        self.catch_up: dict[int, list[Message]] = {}
        """Messages that adapt the scene of a client to its new filter."""

    def change_filter(self, client_id: int, may_send: MessageFilter) -> None:
        """Replace the filter of a client.

        It receives what the former one withheld; nodes that it may not receive any more are
        removed.
        """
        with self.buffer_lock:
            before = self.filters.get(client_id, lambda _: True)
            self.filters[client_id] = may_send
            sent_id = self.generator_cursors.get(client_id, -1)
            sent = [message for i, message in self.message_from_id.items() if i <= sent_id]
            removed = [
                messages.RemoveSceneNodeMessage(cast("Any", message).name)
                for message in sent
                if message.lifecycle_phase == "create" and before(message) and not may_send(message)
            ]
            missing = [each for each in sent if may_send(each) and not before(each)]
            self.catch_up[client_id] = [*reversed(removed), *missing]
        self.event_loop.call_soon_threadsafe(self.message_event.set)

    def _window_loop(
        self, client_id: int, backlog_last_id: int, backlog_done_message: Message | None
    ) -> AsyncGenerator[Sequence[Message]]:
        if self.persistent_messages:
            return message_windows(self, client_id, backlog_last_id, backlog_done_message)
        # A client's own queue starts at zero.
        windows = super()._window_loop(client_id, backlog_last_id, backlog_done_message)
        return self._permitted_windows(windows, client_id)

    async def _permitted_windows(
        self, windows: AsyncGenerator[Sequence[Message]], client_id: int
    ) -> AsyncGenerator[Sequence[Message]]:
        try:
            async for window in windows:
                if permitted := self.permitted(window, client_id):
                    yield permitted
        finally:
            await windows.aclose()

    def permitted(self, window: Sequence[Message], client_id: int) -> Sequence[Message]:
        """Return the messages that pass a client's filter."""
        may_send = self.filters.get(client_id)
        return window if may_send is None else list(filter(may_send, window))


def install_message_queues() -> None:
    """Make viser create `MessageQueue`s in the future; idempotent."""
    setattr(_QUEUE_MODULE, _QUEUE_CLASS, MessageQueue)


VISER_VERSION = "1.1.1"
"""Version of viser that the patches are written for."""


def check_viser_version() -> None:
    """Raise TwinError unless the supported version of viser is installed."""
    if viser.__version__ != VISER_VERSION:
        raise TwinError(
            f"viser {viser.__version__} is installed, and the dashboard needs {VISER_VERSION}: "
            f"pip install viser=={VISER_VERSION}"
        )


async def message_windows(
    buffer: MessageQueue, client_id: int, backlog_id: int, replay_done: Message | None
) -> AsyncGenerator[Sequence[Message]]:
    """Yield kept messages, then new ones, for a client until the buffer is done.

    Replaces `AsyncMessageBuffer._window_loop`. `replay_done` follows `backlog_id`, the latest id
    when the client connected, and precedes later messages.
    """
    cursors, sent_id = buffer.generator_cursors, -1
    flushed = asyncio.ensure_future(buffer.flush_event.wait())
    try:
        # viser discards a removal only after it was sent to all clients in this list.
        cursors[client_id] = sent_id
        while not buffer.done:
            newest_id = buffer.message_counter - 1 if replay_done is None else backlog_id
            if catch_up := buffer.catch_up.pop(client_id, None):
                yield catch_up
            window, sent_id = next_message_window(buffer, client_id, sent_id, newest_id)
            cursors[client_id] = sent_id
            replayed = sent_id >= backlog_id and buffer.atomic_counter == 0
            if replay_done is not None and replayed:
                window.append(replay_done)
                replay_done = None
            if permitted := buffer.permitted(window, client_id):
                yield permitted
            elif not window:
                await buffer.message_event.wait()
                buffer.message_event.clear()
            if window and sent_id < buffer.message_counter - 1:
                continue  # More messages are available already.
            # Wait for a frame period to group related messages, unless a flush ends it.
            await asyncio.wait([flushed], timeout=buffer.window_duration_sec)
            if flushed.done() and not buffer.done:
                buffer.flush_event.clear()
                flushed = asyncio.ensure_future(buffer.flush_event.wait())
    finally:
        cursors.pop(client_id, None)
        flushed.cancel()
        await asyncio.wait([flushed])


def next_message_window(
    buffer: AsyncMessageBuffer, client_id: int, sent_id: int, newest_id: int
) -> tuple[list[Message], int]:
    """Return the messages kept after `sent_id` up to `newest_id`, and the last id covered.

    The result is limited to a window, excludes messages that are not for the client itself, and is
    empty while an atomic block is open.
    """
    with buffer.buffer_lock:
        if buffer.atomic_counter > 0:
            return [], sent_id
        kept = buffer.message_from_id
        # Ids are added in ascending order, so new messages are at the end.
        new = [i for i in takewhile(sent_id.__lt__, reversed(kept)) if i <= newest_id]
        meant = (i for i in reversed(new) if kept[i].excluded_self_client != client_id)
        ids = list(islice(meant, buffer.max_window_size))
        full = len(ids) == buffer.max_window_size
        return [kept[i] for i in ids], ids[-1] if full else newest_id


PAGE_HEADER = "X-Tsd-Page"
"""Header added by the gateway to the request of a viser socket: its page."""
LOOK_HEADER = "X-Tsd-Look"
"""Header added by the gateway: the `LOOKS` requested by the page's browser."""
LOOKS = ("dark", "plain")
"""Dark colours, and the scene for a browser without a graphics card."""
ROBOTS_HEADER = "X-Tsd-Robots"
"""Header added by the gateway: the robots that a page may show, as `lab1,lab2`, or `all`."""
_SOCKET_SERVER = attrgetter("_websock_server")
_LIVE_CONNECTIONS = attrgetter("_websock_server._live_connections")
_SHARED_QUEUE = attrgetter("_websock_server.get_message_buffer")
_SERVER = attrgetter("_viser_server")
_INSERT = attrgetter("_insert_message")
_SOCKET = attrgetter("_websock_connection")


def page_of(server: viser.ViserServer, client_id: int) -> str | None:
    """Return the page of a client, or None if unknown or disconnected."""
    return _header_of(server, client_id, PAGE_HEADER)


def look_of(server: viser.ViserServer, client_id: int) -> list[str]:
    """Return the `LOOKS` requested by a client's browser; dark without a gateway."""
    return (_header_of(server, client_id, LOOK_HEADER) or "dark").split("-")


def _header_of(server: viser.ViserServer, client_id: int, name: str) -> str | None:
    connection = _LIVE_CONNECTIONS(server).get(client_id)
    if connection is None or connection.request is None:
        return None
    return connection.request.headers.get(name)


def robots_of(server: viser.ViserServer, client_id: int) -> str:
    """Return the robots that a client may show, as in the header, which the gateway always adds."""
    robots = _header_of(server, client_id, ROBOTS_HEADER)
    return "all" if robots is None else robots


def filter_clients(
    server: viser.ViserServer,
    filters_of: Callable[[viser.ViserServer, int], tuple[MessageFilter, MessageFilter]],
) -> None:
    """Filter the messages to clients.

    `filters_of` returns the filters of a client, by its id, for the messages of the shared scene
    and for its own.
    """

    # viser calls this before it sends anything, unlike its public callback.
    def on_connect(connection: viser.infra.WebsockClientConnection) -> None:
        queues = _SHARED_QUEUE(server)(), connection.get_message_buffer()
        filters = filters_of(server, connection.client_id)
        for queue, may_send in zip(queues, filters, strict=True):
            cast("MessageQueue", queue).filters[connection.client_id] = may_send

    def on_disconnect(connection: viser.infra.WebsockClientConnection) -> None:
        queue = _SHARED_QUEUE(server)()
        queue.filters.pop(connection.client_id, None)
        queue.catch_up.pop(connection.client_id, None)

    _SOCKET_SERVER(server).on_client_connect(on_connect)
    _SOCKET_SERVER(server).on_client_disconnect(on_disconnect)


def change_filter(client: viser.ClientHandle, may_send: MessageFilter) -> None:
    """Replace a client's filter for the shared scene, and update its scene accordingly."""
    _SHARED_QUEUE(_SERVER(client))().change_filter(client.client_id, may_send)


def scene_recorder(
    server: viser.ViserServer, may_send: MessageFilter
) -> viser.infra.StateSerializer:
    """Return viser's recorder of the shared scene and its changes, with the permitted messages."""

    def is_recorded(message: Any) -> bool:
        return message.include_in_scene_serialization and may_send(message)

    recorder: viser.infra.StateSerializer = _SOCKET_SERVER(server).get_message_serializer(
        is_recorded
    )
    for message in list(_SHARED_QUEUE(server)().message_from_id.values()):
        _INSERT(recorder)(message)
    return recorder


def is_disconnected(client: viser.ClientHandle) -> bool:
    """Return whether a client's connection is closed; viser reports it slightly later."""
    return bool(_SOCKET(client).get_message_buffer().done)


def refuse_sharing(server: viser.ViserServer) -> None:
    """Unregister the handlers that let any client open a public tunnel to the server."""
    for message in (messages.ShareUrlRequest, messages.ShareUrlDisconnect):
        _SOCKET_SERVER(server).unregister_handler(message)


def scale_instances(client: viser.ClientHandle, name: str, scales: Array) -> None:
    """Scale the instances of a shared batched node by `scales` (n,) for a client; 0 hides.

    A client-specific node of this name would hide all instances and would have to be moved.
    """
    update = messages.SceneNodeUpdateMessage(name, {"batched_scales": np.float32(scales)})
    _SOCKET(client).queue_message(update)


KEY_HEADER = "X-Tsd-Key"
_SERVE_FUNCTION = "serve"
_PATCH_LOCK = threading.Lock()
_REFUSAL = "Only the gateway may speak to this port.\n"
_ProcessRequest: TypeAlias = Callable[[ServerConnection, Request], Response | None]


@functools.cache
def access_key() -> str:
    """Return the key of all viser servers of this process."""
    return secrets.token_hex(32)


def has_access_key(request: Request) -> bool:
    """Return whether a request contains the key exactly once."""
    brought = request.headers.get_all(KEY_HEADER)
    return len(brought) == 1 and secrets.compare_digest(
        brought[0].encode("utf-8", "replace"), access_key().encode()
    )


@contextmanager
def require_access_key() -> Generator[None]:
    """Make servers started in this context refuse requests without the key, before the upgrade.

    viser looks up the function that creates its server only at start.
    """
    serve = websockets_server.serve

    def serve_locked(*args: Any, process_request: _ProcessRequest, **options: Any) -> Any:
        def answer(connection: ServerConnection, request: Request) -> Response | None:
            if not has_access_key(request):
                return connection.respond(http.HTTPStatus.FORBIDDEN, _REFUSAL)
            return process_request(connection, request)

        return serve(*args, process_request=answer, **options)

    with _PATCH_LOCK:
        setattr(websockets_server, _SERVE_FUNCTION, serve_locked)
        try:
            yield
        finally:
            setattr(websockets_server, _SERVE_FUNCTION, serve)


LOOPBACK = "127.0.0.1"
BRAND_COLOUR = (36, 132, 227)
CAMERA_OFFSET_M = (-0.78, -0.58, 0.62)
"""Initial camera position relative to the robot: behind it to its right, so that it drives away."""
LOOK_AT_M = (0.0, 0.0, 0.03)
FIELD_OF_VIEW_RAD = 0.55


def start_server(title: str, *, dark: bool = True) -> viser.ViserServer:
    """Return a running server on a free loopback port; `get_port()` returns the port.

    viser checks neither authentication nor origins, so the port requires `access_key()`. The system
    chooses a free port, so viser does not search for another one.

    Raises:
        TwinError: If the installed version of viser is not supported.
    """
    check_viser_version()
    install_message_queues()
    # viser prints to standard output, where our programs print a single line.
    rich.get_console().quiet = True
    # A page may leave while its scene is drawn.
    warnings.filterwarnings("ignore", "Queued a .* on a closed connection", UserWarning)
    with require_access_key():
        server = viser.ViserServer(host=LOOPBACK, port=0, label=title, verbose=False)
    refuse_sharing(server)
    set_theme(server.gui, dark=dark)
    server.scene.set_up_direction("+z")
    server.initial_camera.position = CAMERA_OFFSET_M
    server.initial_camera.look_at = LOOK_AT_M
    server.initial_camera.fov = FIELD_OF_VIEW_RAD
    return server


def set_theme(gui: viser.GuiApi, *, dark: bool) -> None:
    """Set dark or light colours for all clients, or for the client of `gui`."""
    gui.configure_theme(
        control_width="small",
        dark_mode=dark,
        show_logo=False,
        show_share_button=False,
        brand_color=BRAND_COLOUR,
    )
