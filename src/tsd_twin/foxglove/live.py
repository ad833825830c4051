"""Live robots: their streams to the channels of the SDK, and the operator of each client."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import secrets
import threading
import time
from collections.abc import Callable, Collection
from dataclasses import replace
from functools import partial
from typing import Any

import msgspec

from tsd_twin.bus import Bus
from tsd_twin.client import AsyncRobotClient, Subscription
from tsd_twin.client.link import BusLink
from tsd_twin.errors import BusError, MessageError, TwinError
from tsd_twin.foxglove.front import Access, Front
from tsd_twin.foxglove.sdk import SdkServer
from tsd_twin.interop.cmd_vel import decode_cmd_vel
from tsd_twin.interop.driver import RobotDriver
from tsd_twin.interop.frames import FOOTPRINT
from tsd_twin.interop.mapping import (
    CMD_VEL,
    PUBLISHED,
    SERVICES,
    SOURCES,
    RobotMapping,
    RosNames,
    namespaces,
)
from tsd_twin.messages import topics
from tsd_twin.messages.commands import Sample
from tsd_twin.messages.ros import BASE, ODOM
from tsd_twin.messages.services import Event
from tsd_twin.messages.topics import Topic
from tsd_twin.models import Part, load_parts, urdf
from tsd_twin.robots import RobotDescription

_LOG = logging.getLogger(__name__)
MOST_ROBOTS = 16
"""Robots that are shown; each has a session of its own on the bus."""
LONGEST_OPERATOR = 32 - 9
"""Length of the name before `-<8 digits>`, which each client adds."""
_RETRY_S = 5.0
_WATCH_S = 0.05
_STREAMS = tuple(topic for topic in SOURCES if topic is not topics.EVENT)


class MeshFiles:
    """Mesh files of one robot, drawn from its description when they are first asked for."""

    def __init__(self, robot: RobotDescription) -> None:
        # A folder on the robot's computer; on this one the path names other files.
        body = msgspec.structs.replace(robot.body, meshes=None)
        self.robot = msgspec.structs.replace(robot, body=body)
        self._parts: dict[str, Part] | None = None
        self._lock = threading.Lock()

    def urdf(self, text: str, *, drawn: bool) -> str:
        """Return the URDF that fits the files: `text`, unless its meshes are `drawn` elsewhere."""
        return urdf(self.robot, load_parts(self.robot)) if drawn else text

    def get(self, name: str) -> bytes | None:
        """Return a file by its name, None when the robot has no such part."""
        with self._lock:
            if self._parts is None:
                several = load_parts(self.robot).values()
                self._parts = {part.file: part for parts in several for part in parts}
            part = self._parts.get(name)
        if part is None:
            return None
        mesh: Any = part.mesh
        return bytes(mesh.export(file_type="stl"))


class RobotSource:
    """One robot on the bus, shown under the names that it has now."""

    def __init__(self, server: SdkServer, link: BusLink, operator: str) -> None:
        """Made on the event loop; `operator` is the name before the digits of a client."""
        self.client = AsyncRobotClient(link, operator)
        self.id = link.id
        self.names: RosNames | None = None
        self._server, self._link = server, link
        self._meshes = MeshFiles(link.robot)
        own_meshes = link.robot.body.meshes is not None
        self._urdf = self._meshes.urdf(link.description.urdf, drawn=own_meshes)
        self._mapping: RobotMapping | None = None
        self._lock = threading.Lock()
        for topic in _STREAMS:
            link.subscribe(topic, partial(self._feed, topic))
        link.subscribe_events(_EventTap(self._feed_event))

    def rename(self, names: RosNames | None, services: bool) -> None:
        """Show the robot under other names; None withdraws it.

        Raises:
            MessageError: its URDF is none.
        """
        if self.names == names:
            return
        server, before = self._server, self.names
        with self._lock:
            self.names, self._mapping = names, None
        if before is not None:
            server.forget([before.topic(row.name) for row in PUBLISHED], self.id)
            server.set_assets(package_of(before), None)
            if services:
                server.remove_services([before.topic(name) for name in SERVICES])
        if names is None:
            return
        mapping = RobotMapping(self.id, names, self._urdf, package_of(names))
        server.declare([(row, names.topic(row.name)) for row in PUBLISHED], self.id)
        server.set_assets(package_of(names), self._meshes.get)
        if services:
            server.add_services([names.topic(name) for name in SERVICES])
        for message in mapping.static():
            server.log(message, self.id)
        with self._lock:
            self._mapping = mapping

    async def close(self) -> None:
        """Leave the robot."""
        await self.client.close()

    # On threads of the bus.

    def _feed(self, topic: Topic, sample: Sample) -> None:
        if not sample.is_put:
            return
        with self._lock, contextlib.suppress(MessageError):  # Its age shows it.
            if self._mapping is not None:
                for message in self._mapping.convert(topic, sample.payload, self._server.wants):
                    self._server.log(message, self.id)

    def _feed_event(self, event: Event) -> None:
        payload = msgspec.json.encode(event)
        self._feed(topics.EVENT, Sample(topics.event_key(self.id, "x"), payload, b""))


def package_of(names: RosNames) -> str:
    """Return what goes before the name of each mesh file."""
    return f"package://{names.namespace}_description/meshes/"


def _frames(names: RosNames) -> dict[str, str]:
    """Return the frames of the bus by their names here."""
    return {names.frame(BASE): BASE, names.frame(FOOTPRINT): BASE, names.frame(ODOM): ODOM}


class _EventTap(Subscription[Event]):
    """Subscription whose events go to a function at once."""

    def __init__(self, take: Callable[[Event], None]) -> None:
        super().__init__(1)
        self._take = take

    def put(self, item: Event) -> None:
        if not self.closed:
            self._take(item)


class Fleet:
    """All robots on the bus, or some of them; belongs to the event loop."""

    def __init__(
        self,
        server: SdkServer,
        open_bus: Callable[[], Bus],
        operator: str,
        *,
        may_drive: bool,
        only: Collection[str] = (),
    ) -> None:
        """`open_bus` opens one more session; `only` names the robots that are shown."""
        self.operator = operator[:LONGEST_OPERATOR]
        self.sources: dict[str, RobotSource] = {}
        self._server, self._open_bus, self._only = server, open_bus, frozenset(only)
        self._services = may_drive
        self._alive: dict[str, int] = {}
        self._known: dict[str, int] = {}
        self._numbers = 0
        self._locks: dict[str, asyncio.Lock] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._loop = asyncio.get_running_loop()

    def watch(self, bus: Bus) -> None:
        """Show each robot as long as its node is on the bus."""
        bus.subscribe_liveliness(topics.alive_key("*"), self._on_liveliness)

    async def close(self) -> None:
        """Leave all robots."""
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for source in self.sources.values():
            await source.close()

    def robot_of(self, topic: str) -> tuple[RobotSource, str] | None:
        """Return the robot that a topic or service belongs to, and its relative name."""
        for source in self.sources.values():
            if source.names is not None:
                for name in (CMD_VEL.name, *SERVICES):
                    if topic == source.names.topic(name):
                        return source, name
        return None

    def _on_liveliness(self, key: str, lives: bool) -> None:
        with contextlib.suppress(BusError, RuntimeError):  # No id; or the loop is closed.
            self._loop.call_soon_threadsafe(self._note, topics.robot_of(key), lives)

    def _note(self, robot: str, lives: bool) -> None:
        if self._only and robot not in self._only:
            return
        if lives and robot not in self._alive and len(self._alive) >= MOST_ROBOTS:
            _LOG.warning("%s is not shown: %d robots are", robot, MOST_ROBOTS)
            return
        if lives:
            self._numbers += 1
            self._alive[robot] = self._numbers
        else:
            self._alive.pop(robot, None)
        task = asyncio.create_task(self._settle(robot))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _settle(self, robot: str) -> None:
        """Bring what is shown of a robot to what is on the bus."""
        async with self._locks.setdefault(robot, asyncio.Lock()):
            if self._known.get(robot) == self._alive.get(robot):
                return
            source = self.sources.pop(robot, None)
            self._known.pop(robot, None)
            if source is not None:
                source.rename(None, self._services)
                await source.close()
            while (number := self._alive.get(robot)) is not None:
                try:
                    link = await asyncio.to_thread(self._connect, robot)
                    source = RobotSource(self._server, link, self.operator)
                    break
                except TwinError as error:
                    _LOG.warning("%s cannot be shown: %s", robot, error)
                    await asyncio.sleep(_RETRY_S)
            else:
                self._rename()
                return
            self.sources[robot], self._known[robot] = source, number
            self._rename()

    def _connect(self, robot: str) -> BusLink:
        bus = self._open_bus()
        try:
            return BusLink(bus, robot)
        except BaseException:
            bus.close()
            raise

    def _rename(self) -> None:
        names = namespaces(self.sources)
        changed = [each for each in self.sources.values() if each.names != names[each.id]]
        for source in changed:  # All old names are gone before the first new one.
            source.rename(None, self._services)
        for source in changed:
            try:
                source.rename(names[source.id], self._services)
            except TwinError as error:
                _LOG.warning("%s cannot be shown: %s", source.id, error)


class LiveOperator:
    """Operator behind one client: a driver for each robot that it drives."""

    def __init__(self, fleet: Fleet, say: Callable[[str], None]) -> None:
        """`say` tells the client a sentence."""
        self._fleet, self._say = fleet, say
        self._name = f"{fleet.operator}-{secrets.token_hex(4)}"
        self._drivers: dict[str, tuple[RobotSource, RobotDriver]] = {}
        self._closing: asyncio.Task[None] | None = None

    def publish(
        self, topic: str, encoding: str, schema: str, payload: bytes, sent_after_s: float
    ) -> None:
        """Act on a twist."""
        now_s = time.monotonic()
        found = self._fleet.robot_of(topic)
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
        if source.names is not None and message.frame in _frames(source.names):
            message = replace(message, frame=_frames(source.names)[message.frame])
        self._driver(source).on_cmd_vel(message, now_s, sent_after_s)

    async def call(self, service: str) -> tuple[bool, str]:
        """Carry out a service."""
        found = self._fleet.robot_of(service)
        if found is None:
            return False, f"there is no service {service}"
        return await self._driver(found[0]).call(found[1])

    async def close(self) -> None:
        """Bring all that it drives to rest, and release it."""
        drivers, self._drivers = self._drivers, {}
        await asyncio.gather(*(driver.close() for _, driver in drivers.values()))

    def _driver(self, source: RobotSource) -> RobotDriver:
        made = self._drivers.get(source.id)
        if made is None or made[0] is not source:
            if made is not None:  # The robot was restarted.
                self._closing = asyncio.create_task(made[1].close())
            made = source, RobotDriver(source.client, self._name, partial(self._tell, source.id))
            self._drivers[source.id] = made
        return made[1]

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
    fleet = Fleet(server, open_bus, operator, may_drive=may_drive, only=only)
    make = partial(LiveOperator, fleet) if may_drive else None
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
