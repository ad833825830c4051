"""Live robots in Foxglove, with an operator per client."""

from __future__ import annotations

import asyncio
import math
import secrets
import time
from collections.abc import Callable

from tsd_twin.adapters.cmd_vel import CmdVelOperator, decode_cmd_vel
from tsd_twin.adapters.cmd_vel_bridge import CmdVelBridge
from tsd_twin.adapters.fleet import Fleet, RobotSource, package_of
from tsd_twin.adapters.foxglove.sdk import SdkServer
from tsd_twin.adapters.ros_messages import RosMessage
from tsd_twin.adapters.ros_topics import CMD_VEL, PUBLISHED, SERVICES, RosNames
from tsd_twin.client.bus_port import BusLink
from tsd_twin.messages.errors import MessageError


class FoxgloveSource(RobotSource):
    """Robot on the bus, as channels and services of the SDK."""

    def __init__(self, server: SdkServer, services: bool, operator: str, link: BusLink) -> None:
        """If `services` is set, the robot can be driven."""
        self._server, self._services = server, services
        super().__init__(link, operator)

    async def show(self, names: RosNames) -> None:
        """Declare channels, services and meshes."""
        self._server.declare([(row, names.topic(row.name)) for row in PUBLISHED], self.id)
        self._server.set_assets(self.mesh_uri(names), self.meshes.get)
        if self._services:
            self._server.add_services([names.topic(name) for name in SERVICES])

    async def withdraw(self, names: RosNames) -> None:
        """Withdraw everything that `show` declared."""
        self._server.forget([names.topic(row.name) for row in PUBLISHED], self.id)
        self._server.set_assets(self.mesh_uri(names), None)
        if self._services:
            self._server.remove_services([names.topic(name) for name in SERVICES])

    def mesh_uri(self, names: RosNames) -> str:
        """Return the URI prefix of mesh files."""
        return package_of(names)

    def wants(self, topic: str) -> bool:
        """Return whether a topic has a subscriber."""
        return self._server.wants(topic)

    def publish(self, message: RosMessage) -> None:
        """Send a message to all subscribers."""
        self._server.log(message, self.id)


class LiveOperator:
    """Operator of a client, with a driver for each robot that it drives."""

    def __init__(
        self,
        fleet: Fleet,
        operator: str,
        say: Callable[[str], None],
        trip_s: Callable[[], float],
    ) -> None:
        """Create the operator of a client.

        Args:
            fleet: All robots.
            operator: Name prefix; random digits are appended.
            say: Sends the client a notice.
            trip_s: Returns the client's round-trip time.
        """
        self._fleet, self._say, self._trip_s = fleet, say, trip_s
        self._name = f"{operator}-{secrets.token_hex(4)}"
        self._drivers: dict[str, tuple[RobotSource, CmdVelBridge]] = {}
        self._unread_s = -math.inf
        self._closing: asyncio.Task[None] | None = None

    def publish(
        self, topic: str, encoding: str, schema: str, payload: bytes, sent_after_s: float
    ) -> None:
        """Handle a twist."""
        now_s = time.monotonic()
        found = self._robot_of(topic)
        if found is None or found[1] != CMD_VEL.name:
            known = [each.names for each in self._fleet.sources.values() if each.names]
            names = ", ".join(each.topic(CMD_VEL.name) for each in known) or "no robot is there"
            self._say(f"nothing reads {topic[:100]}; publish to {names}")
            self._unread_s = now_s
            for _, driver in self._drivers.values():
                driver.machine.on_unread(now_s)
            return
        source, _ = found
        try:
            message = source.to_bus_frame(decode_cmd_vel(encoding, schema, payload))
        except MessageError as error:
            self._say(str(error)[:200])
            return
        self._driver(source).on_cmd_vel(message, now_s, sent_after_s)

    async def call(self, service: str) -> tuple[bool, str]:
        """Call a service; return whether it succeeded, and a message."""
        found = self._robot_of(service)
        if found is None:
            return False, f"there is no service {service}"
        return await self._driver(found[0]).call(found[1])

    async def close(self) -> None:
        """Stop and release all driven robots."""
        drivers, self._drivers = self._drivers, {}
        await asyncio.gather(*(driver.close() for _, driver in drivers.values()))

    def _driver(self, source: RobotSource) -> CmdVelBridge:
        made = self._drivers.get(source.id)
        if made is None or made[0] is not source:
            if made is None:
                machine = CmdVelOperator(self._name)
                machine.on_unread(self._unread_s)
            else:  # The robot was restarted or unreachable.
                machine = made[1].machine
                self._closing = asyncio.create_task(made[1].close())
            driver = CmdVelBridge(
                source.client, machine, lambda text: self._say(f"{source.id}: {text}"), self._trip_s
            )
            if made is not None:
                driver.connected()
            made = self._drivers[source.id] = source, driver
        return made[1]

    def _robot_of(self, topic: str) -> tuple[RobotSource, str] | None:
        """Return the robot that a topic or service belongs to, and its relative name."""
        for source in self._fleet.sources.values():
            if source.names is not None:
                for name in (CMD_VEL.name, *SERVICES):
                    if topic == source.names.topic(name):
                        return source, name
        return None
