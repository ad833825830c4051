"""Robots on the bus for an adapter, each shown under ROS names while its node is alive."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Coroutine
from dataclasses import replace
from functools import partial
from typing import Any

import msgspec

from tsd_twin.adapters.cmd_vel import CmdVel
from tsd_twin.adapters.frames import FOOTPRINT
from tsd_twin.adapters.ros_messages import RobotMapping, RosMessage
from tsd_twin.adapters.ros_topics import SOURCES, RosNames, namespaces
from tsd_twin.bus import Bus
from tsd_twin.client import AsyncRobotClient
from tsd_twin.client.bus_port import BusLink
from tsd_twin.client.state import CallbackSubscription
from tsd_twin.errors import BusError, TwinError
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import BASE, ODOM
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.events import Event
from tsd_twin.messages.topics import Sample, Topic
from tsd_twin.models import load_parts, robot_urdf
from tsd_twin.models.solids import Part
from tsd_twin.robots import RobotDescription

_LOG = logging.getLogger(__name__)
MOST_ROBOTS = 16
"""Maximum number of robots; each needs a separate bus session."""
LONGEST_OPERATOR = 32 - 9
"""Maximum length of the operator name without its suffix `-<8 digits>`."""
_RETRY_S = 5.0
_STREAMS = tuple(topic for topic in SOURCES if topic is not topics.EVENT)


class MeshFiles:
    """Mesh files of a robot, generated from its description on first use."""

    def __init__(self, robot: RobotDescription) -> None:
        # The path is only valid on the robot's computer.
        body = msgspec.structs.replace(robot.body, meshes=None)
        self.robot = msgspec.structs.replace(robot, body=body)
        self._parts: dict[str, Part] | None = None
        self._lock = threading.Lock()

    def get(self, name: str) -> bytes | None:
        """Return a file by name, or None for unknown parts."""
        with self._lock:
            if self._parts is None:
                several = load_parts(self.robot).values()
                self._parts = {part.file: part for parts in several for part in parts}
            part = self._parts.get(name)
        if part is None:
            return None
        mesh: Any = part.mesh
        return bytes(mesh.export(file_type="stl"))


class RobotSource(ABC):
    """Robot on the bus, shown under its current names."""

    def __init__(self, link: BusLink, operator: str) -> None:
        """Create on the event loop; `operator` is the operator name without the digits."""
        self.client = AsyncRobotClient(link, operator)
        self.id = link.id
        self.names: RosNames | None = None
        self.meshes = MeshFiles(link.robot)
        own_meshes = link.robot.body.meshes is not None
        self._urdf = robot_urdf(self.meshes.robot) if own_meshes else link.description.urdf
        self._mapping: RobotMapping | None = None
        self._lock = threading.Lock()
        for topic in _STREAMS:
            link.subscribe(topic, partial(self._feed, topic))
        link.subscribe_events(CallbackSubscription(self._feed_event))

    async def rename(self, names: RosNames | None) -> None:
        """Show the robot under new names; None withdraws it.

        Raises:
            TwinError: If its URDF is invalid or it cannot be shown.
        """
        if self.names == names:
            return
        with self._lock:
            before, self.names, self._mapping = self.names, names, None
        if before is not None:
            await self.withdraw(before)
        if names is None:
            return
        mapping = RobotMapping(self.id, names, self._urdf, self.mesh_uri(names), self.input_problem)
        try:
            await self.show(names)
        except TwinError:
            self.names = None
            raise
        for message in mapping.static():
            self.publish(message)
        with self._lock:
            self._mapping = mapping

    def say(self, text: str) -> None:
        """Publish a message of the adapter on the robot's events topic."""
        self._feed_event(Event("adapter", text))

    def input_problem(self) -> str:
        """Return the reason why the robot ignores `cmd_vel`, or ""."""
        return ""

    def to_bus_frame(self, message: CmdVel) -> CmdVel:
        """Replace the ROS name of the frame of a twist by its name on the bus, if it has one."""
        names = self.names
        if names is None:
            return message
        frames = {names.frame(BASE): BASE, names.frame(FOOTPRINT): BASE, names.frame(ODOM): ODOM}
        return replace(message, frame=frames.get(message.frame, message.frame))

    async def close(self) -> None:
        """Disconnect from the robot."""
        with contextlib.suppress(TwinError):  # A lost robot stops automatically.
            await self.client.close()

    @abstractmethod
    async def show(self, names: RosNames) -> None:
        """Declare all topics under these names."""

    @abstractmethod
    async def withdraw(self, names: RosNames) -> None:
        """Withdraw the topics declared by `show`."""

    @abstractmethod
    def mesh_uri(self, names: RosNames) -> str:
        """Return the URI prefix of mesh files."""

    # On bus threads.

    @abstractmethod
    def wants(self, topic: str) -> bool:
        """Return whether a topic has a subscriber."""

    @abstractmethod
    def publish(self, message: RosMessage) -> None:
        """Publish a message."""

    def _feed(self, topic: Topic, sample: Sample) -> None:
        if not sample.is_put:
            return
        with self._lock, contextlib.suppress(MessageError):  # The age of the state reveals it.
            if self._mapping is not None:
                for message in self._mapping.convert(topic, sample.payload, self.wants):
                    self.publish(message)

    def _feed_event(self, event: Event) -> None:
        with self._lock:
            if self._mapping is not None:
                self.publish(self._mapping.event(event))


def package_of(names: RosNames) -> str:
    """Return the URI prefix of mesh files in a ROS package."""
    return f"package://{names.namespace}_description/meshes/"


class Fleet:
    """All or selected robots on the bus; used from the event loop."""

    def __init__(
        self,
        make_source: Callable[[BusLink], RobotSource],
        open_bus: Callable[[], Bus],
        only: Collection[str] = (),
        shows: Callable[[RobotDescription], bool] = lambda _robot: True,
    ) -> None:
        """`open_bus` opens another session; `only` restricts the robots shown.

        Robots for which `shows` returns False are skipped.
        """
        self.sources: dict[str, RobotSource] = {}
        self._make_source, self._open_bus, self._only = make_source, open_bus, frozenset(only)
        self._shows = shows
        self._alive: dict[str, int] = {}
        self._known: dict[str, int] = {}
        self._numbers = 0
        self._locks: dict[str, asyncio.Lock] = {}
        self._naming = asyncio.Lock()
        self._tasks: set[asyncio.Task[None]] = set()
        self._loop = asyncio.get_running_loop()

    def watch(self, bus: Bus) -> None:
        """Show each robot while its node is on the bus."""
        bus.subscribe_liveliness(topics.alive_key("*"), self._on_liveliness)

    async def close(self) -> None:
        """Disconnect from all robots."""
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await asyncio.gather(*(source.close() for source in self.sources.values()))

    def _on_liveliness(self, key: str, lives: bool) -> None:
        with contextlib.suppress(BusError, RuntimeError):  # Invalid id, or the loop is closed.
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
        self._start(self._settle(robot))

    async def _settle(self, robot: str) -> None:
        """Show or withdraw a robot to match the bus."""
        async with self._locks.setdefault(robot, asyncio.Lock()):
            if self._known.get(robot) == self._alive.get(robot):
                return
            source = self.sources.pop(robot, None)
            self._known.pop(robot, None)
            if source is not None:
                async with self._naming:
                    await source.rename(None)
                await source.close()
            while (number := self._alive.get(robot)) is not None:
                try:
                    link = await asyncio.to_thread(self._connect, robot)
                    if not self._shows(link.robot):
                        await asyncio.to_thread(link.close)
                        self._known[robot] = number
                        return
                    source = self._make_source(link)
                    break
                except TwinError as error:
                    _LOG.warning("%s cannot be shown: %s", robot, error)
                    await asyncio.sleep(_RETRY_S)
            else:
                await self._rename()
                return
            self.sources[robot], self._known[robot] = source, number
            await self._rename()

    def _connect(self, robot: str) -> BusLink:
        bus = self._open_bus()
        try:
            return BusLink(bus, robot)
        except BaseException:
            bus.close()
            raise

    async def _rename(self) -> None:
        async with self._naming:
            names = namespaces(self.sources)
            changed = [each for each in self.sources.values() if each.names != names[each.id]]
            for source in changed:  # Withdraw all old names before showing the first new one.
                await source.rename(None)
            for source in changed:
                try:
                    await source.rename(names[source.id])
                except TwinError as error:
                    _LOG.warning("%s cannot be shown: %s", source.id, error)
                    if isinstance(error, BusError):
                        self._start(self._rename_later())

    async def _rename_later(self) -> None:
        await asyncio.sleep(_RETRY_S)
        await self._rename()

    def _start(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
