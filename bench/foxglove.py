"""`tsd-foxglove`: latency of a twist, compared with the client library, and CPU load."""

from __future__ import annotations

import json
import struct
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

import psutil
from websockets.sync.client import connect
from websockets.sync.connection import Connection
from websockets.typing import Subprotocol

from bench.bus import adapter_rows, client_commands, paced_speeds, program, watch_setpoint
from bench.table import Row
from tsd_twin.bus import Bus, client_config

_COMMANDS, _SMALLEST = 600, 20
_CALL, _PUBLISH, _RESPONSE = 2, 1, 3


def rows(*, smallest: bool = False) -> Iterator[Row]:
    """Measure with one robot and a client that subscribes to everything."""
    count = _SMALLEST if smallest else _COMMANDS
    mock = [sys.executable, "-m", "tsd_mock", "--listen", "tcp/127.0.0.1:0", "--until-eof"]
    with program(mock) as endpoint, Bus(client_config([endpoint])) as bus:
        plain_ms = client_commands(bus, endpoint, count)
    with program(mock) as endpoint, Bus(client_config([endpoint])) as bus:
        flags = ["--connect", endpoint, "--port", "0", "--until-eof"]
        adapter = program([sys.executable, "-m", "tsd_foxglove", *flags])
        with adapter as url:
            twist_ms, load = foxglove_commands(bus, url, adapter.process.pid, count)
    yield from adapter_rows("tsd-foxglove", "Foxglove", plain_ms, twist_ms, load)


def foxglove_commands(bus: Bus, url: str, pid: int, count: int) -> tuple[list[float], float]:
    """Return times from a published twist to the resulting setpoint, and CPU load."""
    came = watch_setpoint(bus)
    with connect(url, subprotocols=[Subprotocol("foxglove.sdk.v1")]) as socket:
        arm = _subscribe_to_all(socket)
        socket.send(struct.pack("<BIII", _CALL, arm, 1, 4) + b"json{}")
        while not (isinstance(message := socket.recv(), bytes) and message[0] == _RESPONSE):
            pass
        assert b'"success":true' in message
        reading = threading.Thread(target=_read, args=(socket,), daemon=True)
        reading.start()
        time.sleep(0.6)
        channel = {
            "id": 1,
            "topic": "/cmd_vel",
            "encoding": "json",
            "schemaName": "geometry_msgs/Twist",
        }
        socket.send(json.dumps({"op": "advertise", "channels": [channel]}))

        def send(vx_mps: float) -> None:
            twist = json.dumps({"linear": {"x": vx_mps}}).encode()
            socket.send(struct.pack("<BI", _PUBLISH, 1) + twist)

        adapter = psutil.Process(pid)
        adapter.cpu_percent()
        times_ms = paced_speeds(send, came, count)
        load = adapter.cpu_percent()
    reading.join()
    return times_ms, load


def _subscribe_to_all(socket: Connection) -> int:
    """Subscribe to all topics; return the id of the service `arm`."""
    known: set[int] = set()
    while True:
        text = socket.recv()
        message: dict[str, Any] = json.loads(text) if isinstance(text, str) else {"op": ""}
        if message["op"] == "advertise":
            new = {each["id"] for each in message["channels"]} - known
            pairs = [{"id": each, "channelId": each} for each in new]
            socket.send(json.dumps({"op": "subscribe", "subscriptions": pairs}))
            known |= new
        if message["op"] == "advertiseServices":
            for service in message["services"]:
                if service["name"] == "/arm":
                    return service["id"]


def _read(socket: Connection) -> None:
    for _ in socket:
        pass
