"""Live robots: their streams to the channels of the SDK, and the operator of each client."""

from __future__ import annotations

import asyncio
import secrets
import threading
import time
from collections.abc import Callable, Collection
from dataclasses import replace
from functools import partial

from tsd_twin.bus import Bus
from tsd_twin.client.link import BusLink
from tsd_twin.errors import MessageError
from tsd_twin.foxglove.front import Access, Front
from tsd_twin.foxglove.sdk import SdkServer
from tsd_twin.interop.cmd_vel import decode_cmd_vel
from tsd_twin.interop.driver import RobotDriver
from tsd_twin.interop.fleet import LONGEST_OPERATOR, Fleet, RobotSource, frames_of, package_of
from tsd_twin.interop.mapping import CMD_VEL, PUBLISHED, SERVICES, RosMessage, RosNames

_WATCH_S = 0.05


class FoxgloveSource(RobotSource):
    """One robot on the bus, as channels and services of the SDK."""

    def __init__(self, server: SdkServer, services: bool, operator: str, link: BusLink) -> None:
        """With `services` it can be driven."""
        self._server, self._services = server, services
        super().__init__(link, operator)

    async def show(self, names: RosNames) -> None:
        """Declare channels, services and meshes."""
        self._server.declare([(row, names.topic(row.name)) for row in PUBLISHED], self.id)
        self._server.set_assets(self.mesh_uri(names), self.meshes.get)
        if self._services:
            self._server.add_services([names.topic(name) for name in SERVICES])

    async def withdraw(self, names: RosNames) -> None:
        """Withdraw what `show` has declared."""
        self._server.forget([names.topic(row.name) for row in PUBLISHED], self.id)
        self._server.set_assets(self.mesh_uri(names), None)
        if self._services:
            self._server.remove_services([names.topic(name) for name in SERVICES])

    def mesh_uri(self, names: RosNames) -> str:
        """Return what goes before the name of each mesh file."""
        return package_of(names)

    def wants(self, topic: str) -> bool:
        """Return whether a topic has a subscriber."""
        return self._server.wants(topic)

    def publish(self, message: RosMessage) -> None:
        """Log a message for all subscribers."""
        self._server.log(message, self.id)


class LiveOperator:
    """Operator behind one client: a driver for each robot that it drives."""

    def __init__(
        self, fleet: Fleet[FoxgloveSource], operator: str, say: Callable[[str], None]
    ) -> None:
        """`operator` is the name before the digits; `say` tells the client a sentence."""
        self._fleet, self._say = fleet, say
        self._name = f"{operator}-{secrets.token_hex(4)}"
        self._drivers: dict[str, tuple[FoxgloveSource, RobotDriver]] = {}
        self._closing: asyncio.Task[None] | None = None

    def publish(
        self, topic: str, encoding: str, schema: str, payload: bytes, sent_after_s: float
    ) -> None:
        """Act on a twist."""
        now_s = time.monotonic()
        found = self._robot_of(topic)
        if found is None or found[1] != CMD_VEL.name:
            known = [each.names for each in self._fleet.sources.values() if each.names]
            names = ", ".join(each.topic(CMD_VEL.name) for each in known) or "no robot is there"
            self._say(f"nothing reads {topic[:100]}; publish to {names}")
            for _, driver in self._drivers.values():
                driver.machine.on_unread(now_s)
            return
        source, _ = found
        try:
            message = decode_cmd_vel(encoding, schema, payload)
        except MessageError as error:
            self._say(str(error)[:200])
            return
        if source.names is not None and message.frame in frames_of(source.names):
            message = replace(message, frame=frames_of(source.names)[message.frame])
        self._driver(source).on_cmd_vel(message, now_s, sent_after_s)

    async def call(self, service: str) -> tuple[bool, str]:
        """Carry out a service."""
        found = self._robot_of(service)
        if found is None:
            return False, f"there is no service {service}"
        return await self._driver(found[0]).call(found[1])

    async def close(self) -> None:
        """Bring all that it drives to rest, and release it."""
        drivers, self._drivers = self._drivers, {}
        await asyncio.gather(*(driver.close() for _, driver in drivers.values()))

    def _driver(self, source: FoxgloveSource) -> RobotDriver:
        made = self._drivers.get(source.id)
        if made is None or made[0] is not source:
            if made is not None:  # The robot was restarted.
                self._closing = asyncio.create_task(made[1].close())
            made = source, RobotDriver(source.client, self._name, partial(self._tell, source.id))
            self._drivers[source.id] = made
        return made[1]

    def _robot_of(self, topic: str) -> tuple[FoxgloveSource, str] | None:
        """Return the robot that a topic or service belongs to, and its relative name."""
        for source in self._fleet.sources.values():
            if source.names is not None:
                for name in (CMD_VEL.name, *SERVICES):
                    if topic == source.names.topic(name):
                        return source, name
        return None

    def _tell(self, robot: str, text: str) -> None:
        self._say(f"{robot}: {text}")


async def serve_live(
    open_bus: Callable[[], Bus],
    address: tuple[str, int],
    access: Access,
    stop: threading.Event,
    ready: Callable[[int], None],
    *,
    operator: str,
    may_drive: bool = True,
    only: Collection[str] = (),
) -> None:
    """Serve all robots on the bus until `stop` is set.

    Raises:
        TwinError: the SDK is missing, or the address or the access settings cannot be used.
    """
    access.check(address[0])
    server = SdkServer("tsd-twin", may_drive=may_drive)
    operator = operator[:LONGEST_OPERATOR]
    make_source = partial(FoxgloveSource, server, may_drive, operator)
    fleet = Fleet(make_source, open_bus, only)
    make = partial(LiveOperator, fleet, operator) if may_drive else None
    front = Front(access, make, server.port, server.trust)
    bus = await asyncio.to_thread(open_bus)
    try:
        await front.start(*address)
        fleet.watch(bus)
        ready(front.port)
        while not stop.is_set():
            await asyncio.sleep(_WATCH_S)
    finally:
        await front.stop()
        await fleet.close()
        bus.close()
        server.close()
