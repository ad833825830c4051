"""Third-party client of Foxglove's WebSocket protocol (`robo-ws-bridge`)."""

from __future__ import annotations

import asyncio
import json
import time
from collections import Counter
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from typing import Any

from robo_ws_bridge import WebSocketBridgeClient
from rosbags.typesys import Stores, get_typestore

from tests.support.withheld import PATIENCE_S

STORE = get_typestore(Stores.ROS2_JAZZY)
_PUSH_S, _HELD_S = 5.0, 60.0
TWIST = "geometry_msgs/msg/Twist"


def twist_json(vx_mps: float, omega_rad_per_s: float = 0.0) -> bytes:
    """A Twist as the panels of Foxglove publish it."""
    linear, angular = {"x": vx_mps, "y": 0.0, "z": 0.0}, {"x": 0.0, "y": 0.0, "z": omega_rad_per_s}
    return json.dumps({"linear": linear, "angular": angular}).encode()


def twist_cdr(vx_mps: float) -> bytes:
    """A Twist as ROS 2 encodes it."""
    types = STORE.types
    vector = types["geometry_msgs/msg/Vector3"]
    message = types[TWIST](linear=vector(vx_mps, 0.0, 0.0), angular=vector(0.0, 0.0, 0.0))
    return bytes(STORE.serialize_cdr(message, TWIST))


class _EndsWhenClosed:
    """Socket that notifies the client when it is closed.

    Without the notice, the client's loop would spin after a normal close and block this process.
    """

    def __init__(self, socket: Any, on_closed: Callable[[], None]) -> None:
        self._socket, self._on_closed = socket, on_closed

    def __getattr__(self, name: str) -> Any:
        return getattr(self._socket, name)

    async def __aiter__(self) -> AsyncGenerator[bytes | str]:
        async for raw in self._socket:
            yield raw
        self._on_closed()


class _Client(WebSocketBridgeClient):
    """Client that ends when its server closes the connection."""

    async def _attempt_connection(self) -> None:
        await super()._attempt_connection()
        self.socket = self._websocket = _EndsWhenClosed(self._websocket, self._give_up)

    def _give_up(self) -> None:
        self._should_connect = False


class ForeignClient:
    """Connection with the latest message of each topic."""

    def __init__(self, url: str) -> None:
        self.client = _Client(url)
        self.newest: dict[str, tuple[str, bytes]] = {}
        self.counted: Counter[str] = Counter()
        self.said: list[str] = []
        self.pushed_s: list[float] = []
        self.client.on_message(self._take)
        self.client.on_status(lambda _level, text, _id: self.said.append(text))
        self._channels: dict[tuple[str, str], int] = {}

    def _take(self, channel: Any, _time_ns: int, payload: bytes) -> None:
        topic = channel["topic"]
        self.counted[topic] += 1
        self.newest[topic] = (channel["schemaName"], payload)

    async def until(self, condition: Callable[[], object], what: str) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end_s, f"{what}: {self.said}"
            assert "/status" not in self.newest or self.status["mode"] != "fault", self.said
            await asyncio.sleep(0.01)

    async def subscribe(self, *topics: str) -> None:
        """Subscribe, and wait for a message of each."""
        await self.until(lambda: set(topics) <= set(self.topics), f"{topics} of {self.topics}")
        for topic in topics:
            await self.client.subscribe(topic)
        await self.until(lambda: all(self.counted[topic] for topic in topics), str(self.counted))

    @property
    def topics(self) -> list[str]:
        return [channel["topic"] for channel in self.client.channels.values()]

    def message(self, topic: str) -> Any:
        """Latest message of a topic, decoded."""
        schema, payload = self.newest[topic]
        return json.loads(payload) if not schema else STORE.deserialize_cdr(payload, schema)

    @property
    def x_m(self) -> float:
        return self.message("/odom/truth").pose.pose.position.x

    @property
    def status(self) -> Any:
        return json.loads(self.newest["/status"][1])

    @property
    def services(self) -> dict[str, int]:
        return {each["name"]: each["id"] for each in self.client.services.values()}

    async def call(self, service: str) -> Any:
        """Call a service, and return its answer."""
        await self.until(lambda: service in self.services, f"no {service}")
        number = self.services[service]
        answer = await self.client.call_service(number, b"{}", encoding="json", timeout=PATIENCE_S)
        return json.loads(answer.payload)

    async def publish(
        self,
        payload: bytes,
        topic: str = "/cmd_vel",
        encoding: str = "json",
        schema: str = TWIST,
    ) -> None:
        key = (topic, encoding + schema)
        if key not in self._channels:
            self._channels[key] = await self.client.advertise(
                topic, encoding=encoding, schema_name=schema
            )
        await self.client.publish(self._channels[key], payload)

    async def push(self, vx_mps: float, duration_s: float, encoding: str = "json") -> None:
        """Publish a twist 20 times a second."""
        payload = twist_json(vx_mps) if encoding == "json" else twist_cdr(vx_mps)
        end_s = time.monotonic() + duration_s
        while time.monotonic() < end_s:
            await self.publish(payload, encoding=encoding)
            self.pushed_s.append(time.monotonic())
            await asyncio.sleep(0.05)

    @asynccontextmanager
    async def driving(
        self, vx_mps: float, drives: Callable[[], object]
    ) -> AsyncGenerator[asyncio.Task[None]]:
        """Push until the robot drives, and on until the end."""
        pushing = asyncio.create_task(self.push(vx_mps, _HELD_S))
        try:
            end_s = time.monotonic() + _PUSH_S
            while not drives():
                assert time.monotonic() < end_s, f"it does not drive: {self.said}"
                await asyncio.sleep(0.01)
            yield pushing
        finally:
            pushing.cancel()
            await asyncio.gather(pushing, return_exceptions=True)

    async def pause(self) -> None:
        """Release the stick, and wait longer than the required rest."""
        await asyncio.sleep(0.6)

    async def until_still(self) -> None:
        """Wait until the robot is at rest."""
        at_m = float("nan")
        for _ in range(400):
            await asyncio.sleep(0.1)
            before_m, at_m = at_m, self.x_m
            if abs(at_m - before_m) < 1e-4 and self.status["mode"] != "driving":
                return
        raise AssertionError("it does not come to rest")


@asynccontextmanager
async def foreign_client(url: str) -> AsyncGenerator[ForeignClient]:
    """Connect, with pose and status subscribed."""
    made = ForeignClient(url)
    await made.client.connect()
    try:
        await made.subscribe("/odom/truth", "/status")
        yield made
    finally:
        await made.client.disconnect()
