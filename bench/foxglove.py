"""`tsd-foxglove`, compared with a bare forwarder that uses the same SDK."""

from __future__ import annotations

import contextlib
import json
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.sync.connection import Connection
from websockets.typing import Subprotocol

from bench.adapters import Send, adapter_rows, robots
from bench.programs import peer, tool
from bench.table import Row, Run

_CALL, _PUBLISH, _RESPONSE = 2, 1, 3
_CHANNEL = {
    "id": 1,
    "topic": "/cmd_vel",
    "encoding": "json",
    "schemaName": "geometry_msgs/Twist",
}


def rows(run: Run) -> Iterator[Row]:
    """Measure with one robot and clients that subscribe to everything."""
    with ExitStack() as stack:
        endpoint, bare_endpoint, buses = robots(stack)
        adapter = tool("tsd_foxglove", "--connect", endpoint, "--port", "0")
        bare = peer("foxglove", bare_endpoint)
        subject = adapter, _publisher(stack, stack.enter_context(adapter), arms=True)
        other = bare, _publisher(stack, stack.enter_context(bare), arms=False)
        yield from adapter_rows(run, "foxglove", buses, subject, other)


def _publisher(stack: ExitStack, url: str, *, arms: bool) -> Send:
    """Subscribe to all topics, arm the robot, and return a function that publishes a speed."""
    protocols = [Subprotocol("foxglove.sdk.v1")]
    socket = stack.enter_context(connect(url, subprotocols=protocols, compression=None))
    arm = _subscribe_to_all(socket, until_service=arms)
    if arms:
        socket.send(struct.pack("<BIII", _CALL, arm, 1, 4) + b"json{}")
        while not (isinstance(message := socket.recv(), bytes) and message[0] == _RESPONSE):
            pass
        assert b'"success":true' in message
    threading.Thread(target=_read, args=(socket,), daemon=True).start()
    time.sleep(0.6)
    socket.send(json.dumps({"op": "advertise", "channels": [_CHANNEL]}))

    def send(vx_mps: float) -> None:
        twist = json.dumps({"linear": {"x": vx_mps}}).encode()
        socket.send(struct.pack("<BI", _PUBLISH, 1) + twist)

    return send


def _subscribe_to_all(socket: Connection, *, until_service: bool) -> int:
    """Subscribe to all topics; return the id of the service `arm`, or 0 without services."""
    known: set[int] = set()
    while True:
        text = socket.recv()
        message: dict[str, Any] = json.loads(text) if isinstance(text, str) else {"op": ""}
        if message["op"] == "advertise":
            new = {each["id"] for each in message["channels"]} - known
            pairs = [{"id": each, "channelId": each} for each in new]
            socket.send(json.dumps({"op": "subscribe", "subscriptions": pairs}))
            known |= new
            if not until_service and len(known) >= _BARE_CHANNELS:
                return 0
        for service in message.get("services", []):
            if service["name"] == "/arm":
                return service["id"]


_BARE_CHANNELS = 5
"""Channels of the bare forwarder, one per state topic of the robot."""


def _read(socket: Connection) -> None:
    with contextlib.suppress(ConnectionClosed):
        for _ in socket:
            pass
