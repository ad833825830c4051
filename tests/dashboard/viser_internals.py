"""Parts of viser without a public name, which the dashboard replaces or depends on."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Iterable
from typing import Any

import viser
from viser.infra import _infra as infra
from websockets.datastructures import Headers

message_producer = infra._message_producer
"""Loop that sends the messages of a queue to one client."""
run_garbage_collector = viser.ViserServer._run_garbage_collector
"""Loop that removes sent messages from the queues."""


def shared_queue(server: viser.ViserServer) -> Any:
    """Return the queue of messages to all clients."""
    return server._websock_server._broadcast_buffer


def queue_of(client: viser.ClientHandle) -> Any:
    """Return the queue of messages to one client."""
    return client._websock_connection.get_message_buffer()


def event_loop(server: viser.ViserServer) -> asyncio.AbstractEventLoop:
    """Return the loop of the server's thread."""
    return server._websock_server._background_event_loop


def handled_messages(server: viser.ViserServer) -> Iterable[type]:
    """Return the types of client messages with a handler for all clients."""
    return server._websock_server._incoming_handlers


def request_headers(server: viser.ViserServer) -> list[Headers]:
    """Return the headers of the open connections."""
    connections = server._websock_server._live_connections.values()
    return [each.request.headers for each in connections if each.request]


def replace_waiters(
    event: asyncio.Event, replaced: Callable[[deque[Any]], deque[Any]]
) -> deque[Any]:
    """Replace the futures that wait for an event, and return the new ones."""
    event._waiters = replaced(event._waiters)
    return event._waiters
