"""Bare peers of our programs: `python -m bench.peers NAME ARGUMENTS`.

Each does the same input and output with the same library, without any of our processing. It prints
`ready: ADDRESS` and ends with its standard input.
"""

# pyright: reportUnknownMemberType=false

from __future__ import annotations

import importlib
import json
import math
import os
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import rich
import zenoh
from viser import ViserServer

from tsd_twin import robots
from tsd_twin.bus import client_config, dialling_config, from_file, node_config
from tsd_twin.simulation import SimRobot

PERIOD_S = 0.01
CMD, SETPOINT, STOP = "bench/cmd", "bench/setpoint", "bench/stop"
STATES = (("joints", 376, 2), ("setpoint", 376, 2), ("odom", 724, 2), ("truth", 724, 2),
          ("status", 1422, 5), ("inputs", 4643, 20))  # fmt: skip
"""Puts of a simulated robot: name, bytes, and period in cycles of its control loop."""
_ASK_S = 2.0
"""Period in which a viewer asks for all descriptions."""
_URGENT: dict[str, Any] = {"priority": zenoh.Priority.REAL_TIME, "express": True}


def ready(address: str) -> None:
    """Report that the peer is ready, and wait until standard input ends."""
    print("ready:", address, flush=True)
    sys.stdin.read()


def loop(tick: Callable[[int], None], period_s: float = PERIOD_S) -> None:
    """Call `tick` periodically on a thread."""

    def run() -> None:
        next_s, number = time.monotonic(), 0
        while True:
            try:
                tick(number)
            except zenoh.ZError:  # The session ends with the process.
                return
            number, next_s = number + 1, next_s + period_s
            time.sleep(max(0.0, next_s - time.monotonic()))

    threading.Thread(target=run, daemon=True).start()


def router() -> None:
    """Pass messages without TLS and rules."""
    session = zenoh.open(node_config(["tcp/127.0.0.1:0"]).parsed())
    ready(_endpoint(session))


def node(endpoint: str = "") -> None:
    """Read and write the simulated joints at 100 Hz, put as many bytes as a robot, and echo.

    With the endpoint of a router, dial it.
    """
    config = dialling_config([endpoint]) if endpoint else node_config(["tcp/127.0.0.1:0"])
    session, io = zenoh.open(config.parsed()), _Joints()
    publishers = [(session.declare_publisher(f"twin/bare/state/{name}"), bytes(size), every)
                  for name, size, every in STATES]  # fmt: skip
    echo: Any = session.declare_publisher(SETPOINT, **_URGENT)
    commands: Any = session.declare_subscriber(CMD, zenoh.handlers.RingChannel(8))
    stops: Any = session.declare_queryable(STOP, zenoh.handlers.RingChannel(8))

    def tick(number: int) -> None:
        io.step()
        while (query := stops.try_recv()) is not None:
            query.reply(STOP, b"{}")
            query.drop()
        while (sample := commands.try_recv()) is not None:
            echo.put(sample.payload)
        for publisher, payload, every in publishers:
            if number % every == 0:
                publisher.put(payload, attachment=bytes(16))

    loop(tick)
    ready(endpoint or _endpoint(session))


class _Joints:
    """Simulated joints at rest."""

    def __init__(self) -> None:
        robot = robots.load_robot("tsd")
        self._io = SimRobot(robot)
        self._rest = robot.kinematics().inverse(np.zeros(3))

    def step(self) -> None:
        """Read and write them once."""
        now_s = time.monotonic()
        self._io.read(now_s)
        self._io.write(self._rest, now_s)


def _endpoint(session: Any) -> str:
    for reply in session.get(f"@/{session.zid()}/router", timeout=2.0):
        if reply.ok is not None:
            return json.loads(reply.ok.payload.to_string())["locators"][0]
    raise RuntimeError("the session has no endpoint")


def subscriber(endpoint: str) -> None:
    """Subscribe to all topics and ignore them."""
    session = zenoh.open(client_config([endpoint]).parsed())
    kept: Any = session.declare_subscriber("twin/**", _ignore)
    ready(endpoint)
    kept.undeclare()


def _ignore(sample: zenoh.Sample) -> None:
    sample.payload.to_bytes()


def viewer(config: str, endpoint: str) -> None:
    """Read all states behind a router, ask for all descriptions, and count as a `counter`."""
    settings = replace(from_file(config), others={"connect/endpoints": json.dumps([endpoint])})
    session, received = zenoh.open(settings.parsed()), [0]

    def count(sample: zenoh.Sample) -> None:
        received[0] += len(sample.payload)

    kept: Any = session.declare_subscriber("twin/*/state/**", count)

    def ask(_number: int) -> None:
        session.get("twin/*/desc", _drop, timeout=_ASK_S)

    loop(ask, _ASK_S)
    print("ready:", endpoint, flush=True)
    while sys.stdin.readline():
        before, start_s = received[0], time.monotonic()
        sys.stdin.readline()
        took_s = time.monotonic() - start_s
        print(json.dumps({"kB_s": (received[0] - before) / took_s / 1000}), flush=True)
    kept.undeclare()


def blocking_robot(config: str, robot: str) -> None:
    """Publish poses at 50 Hz that wait for slow readers."""
    session = zenoh.open(from_file(config).parsed())
    publisher = session.declare_publisher(
        f"twin/{robot}/state/odom", congestion_control=zenoh.CongestionControl.BLOCK
    )

    def tick(_number: int) -> None:
        publisher.put(bytes(724), attachment=bytes(16))

    loop(tick, 2 * PERIOD_S)
    ready(robot)


def _drop(reply: zenoh.Reply) -> None:
    del reply


def foxglove(endpoint: str) -> None:
    """Forward all states to clients, and what they publish to the bus."""
    sdk: Any = importlib.import_module("foxglove")
    websocket: Any = importlib.import_module("foxglove.websocket")
    session = zenoh.open(client_config([endpoint]).parsed())
    out: Any = session.declare_publisher(CMD, **_URGENT)

    class Listener(websocket.ServerListener):
        def on_message_data(self, *arguments: Any) -> None:
            out.put(arguments[-1])  # After client and channel.

    server = sdk.start_server(
        host="127.0.0.1",
        port=0,
        capabilities=[websocket.Capability.ClientPublish],
        server_listener=Listener(),
        supported_encodings=["json"],
    )
    channels: dict[str, Any] = {}

    def forward(sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        if key not in channels:
            channels[key] = sdk.Channel(key, message_encoding="json")
        channels[key].log(sample.payload.to_bytes())

    kept: Any = session.declare_subscriber("twin/*/state/*", forward)
    ready(f"ws://127.0.0.1:{server.port}")
    kept.undeclare()


def ros(endpoint: str, router: str) -> None:
    """Forward all states to a ROS router, and `cmd_vel` of domain 1 to the bus."""
    robot = zenoh.open(client_config([endpoint]).parsed())
    nodes = zenoh.open(client_config([router]).parsed())
    out: Any = robot.declare_publisher(CMD, **_URGENT)
    publishers: dict[str, Any] = {}

    def forward(sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        if key not in publishers:
            publishers[key] = nodes.declare_publisher(f"1/{key}")
        publishers[key].put(sample.payload, attachment=bytes(33))

    kept: list[Any] = [
        robot.declare_subscriber("twin/*/state/*", forward),
        nodes.declare_subscriber("1/cmd_vel/**", lambda sample: out.put(sample.payload)),
    ]
    ready(endpoint)
    kept.clear()


def viser(nodes: str, hz: str) -> None:
    """Serve a plain scene whose frames all move at a rate."""
    rich.get_console().quiet = True  # viser prints to standard output.
    server = ViserServer(host="127.0.0.1", port=0, verbose=False)
    frames = [server.scene.add_frame(f"/w/{i}", show_axes=False) for i in range(int(nodes))]

    def tick(number: int) -> None:
        angle = 0.01 * number
        for i, frame in enumerate(frames):
            frame.position = (math.sin(angle), math.cos(angle), i)
            frame.wxyz = (math.cos(angle), 0.0, 0.0, math.sin(angle))
        server.flush()

    loop(tick, 1.0 / float(hz))
    ready(f"ws://127.0.0.1:{server.get_port()}")


PEERS: dict[str, Callable[..., None]] = {
    each.__name__: each
    for each in (router, node, subscriber, viewer, blocking_robot, foxglove, ros, viser)
}

if __name__ == "__main__":
    PEERS[sys.argv[1]](*sys.argv[2:])
    os._exit(0)  # Threads of the libraries would delay the exit.
