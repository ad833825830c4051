"""Simulated robots on an in-memory bus, and dashboard pages, in virtual time."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
from collections.abc import AsyncGenerator, AsyncIterator, Callable
from typing import Any, cast

import msgspec
from aiohttp import WSMessage, WSMsgType

from tests.support.memory_bus import MemoryBus, Network, Queue
from tests.support.robot_node import QUICK
from tests.support.scene_doubles import EmptyScene
from tests.support.virtual_time import VirtualClock
from tsd_twin import robots
from tsd_twin.client.monitor import RobotMonitor
from tsd_twin.dashboard.sessions.page_session import PageSocket
from tsd_twin.dashboard.sessions.principal import Principal
from tsd_twin.dashboard.sessions.session_manager import SessionManager
from tsd_twin.lie import SE2
from tsd_twin.messages import topics
from tsd_twin.messages.events import Event
from tsd_twin.messages.services import Description, decode_json
from tsd_twin.messages.status import RECORDING, RobotStatus, encode_stamp, encode_status
from tsd_twin.messages.topics import Service
from tsd_twin.node import RobotNode
from tsd_twin.node.timing import RateKeeper
from tsd_twin.safety import SafetySupervisor
from tsd_twin.security import BusIdentity, Role
from tsd_twin.security.router_rules import EVERY_ROBOT, RobotRights
from tsd_twin.simulation import SimRobot

_PERIOD_S = 0.01
_POLL_S = 0.02


class FleetRobotNode:
    """Node with its simulator and a network link that can fail."""

    def __init__(self, network: Network, robot_id: str, toml: str = QUICK) -> None:
        self.id, self._network = robot_id, network
        self.robot = robots.parse_description(toml, robot_id)
        before = len(network.servers)
        self._bus = MemoryBus(network)
        self._node = RobotNode(
            cast("Any", self._bus),
            robot_id,
            self.robot,
            SimRobot(self.robot),
            Description(toml, ""),
        )
        self._servers = network.servers[before:]
        self._rate = RateKeeper(_PERIOD_S)
        self.runs = True

    @property
    def supervisor(self) -> SafetySupervisor:
        return self._node.supervisor

    def set_pose(self, pose: SE2) -> None:
        """Set the estimate without a request, which would need control and change the status."""
        self._node._controller._estimator.set_pose(pose)  # noqa: SLF001  Nothing else does that.

    def tick(self, now_s: float) -> None:
        if self.runs:
            self._node.step(now_s, self._rate)

    def kill(self) -> None:
        """End the node without notice, like SIGKILL."""
        self.runs = False
        self._serve(None)
        self._bus.close()

    def lose(self) -> None:
        """Cut the link: the node keeps running but answers no requests."""
        self._serve(Queue(64, lambda _: None))

    def find(self) -> None:
        """Restore the link."""
        others = [each for each in self._network.servers if each[0] not in self._keys]
        self._network.servers[:] = [*others, *self._servers]

    @property
    def _keys(self) -> set[str]:
        return {key for key, _ in self._servers}

    def _serve(self, queue: Queue | None) -> None:
        others = [each for each in self._network.servers if each[0] not in self._keys]
        dead = [(key, queue) for key in self._keys] if queue is not None else []
        self._network.servers[:] = [*others, *dead]


class Periods:
    """Virtual time with node periods of 10 ms."""

    def __init__(self, clock: VirtualClock, tick: Callable[[float], None]) -> None:
        self._clock, self._tick = clock, tick
        self._ticking, self._next_s = False, clock.now_s
        clock.wait = self.wait

    def wait(self, seconds: float) -> None:
        """Advance the time."""
        clock = self._clock
        end_s = clock.now_s + max(seconds, 1e-6)
        while clock.now_s < end_s - 1e-9:
            if self._ticking or clock.now_s < self._next_s - 1e-9:
                until_s = end_s if self._ticking else min(end_s, self._next_s)
                clock.advance(max(until_s - clock.now_s, 1e-6))
                continue
            self._ticking, self._next_s = True, clock.now_s + _PERIOD_S
            self._tick(clock.now_s)
            self._ticking = False


class VirtualNode:
    """Node in virtual time on an in-memory bus, used like a `RunningNode`."""

    def __init__(self, clock: VirtualClock, robot_id: str = "tsd", toml: str = QUICK) -> None:
        self.id, self._network = robot_id, Network(clock)
        node = FleetRobotNode(self._network, robot_id, toml)
        self.robot = node.robot
        Periods(clock, node.tick)

    def client(self) -> Any:
        """Return a new session on the bus."""
        return MemoryBus(self._network)


class VirtualFleet:
    """Robots, a replay on the same bus, and a dashboard for all of them."""

    replay = "replay"

    def __init__(self, clock: VirtualClock, robot_ids: list[str]) -> None:
        self.clock, self.network = clock, Network(clock)
        self.lost: set[str] = set()
        self.network.is_held = lambda key: topics.robot_of(key) in self.lost
        self.nodes = {each: FleetRobotNode(self.network, each) for each in robot_ids}
        self.stops: list[str] = []
        """Ids of the robots and replays that received a stop."""
        self.bus = MemoryBus(self.network)
        self.stop_times_s: list[float] = []
        """Times of these stops."""
        self.bus.subscribe(topics.STOP.key("*"), self._note_stop)
        for key in (topics.STOP.key(self.replay), *(s.key(self.replay) for s in Service)):
            self.bus.queryable(key)
        self._status = self.bus.publisher(topics.STATUS.key(self.replay))
        self._numbers = itertools.count(1)
        answer = msgspec.json.encode(Description(QUICK, ""))
        self.links = {
            each: RobotMonitor(cast("Any", self.bus), each, answer)
            for each in (*robot_ids, self.replay)
        }
        self.wait = Periods(clock, self._tick).wait
        self.bus.subscribe(topics.EVENT.key("*"), self._on_event)
        self.manager = SessionManager(self.links, cast("Any", EmptyScene()))

    def lose(self, robot_id: str) -> None:
        """Cut the link of a robot."""
        self.lost.add(robot_id)
        self.nodes[robot_id].lose()

    def find(self, robot_id: str) -> None:
        """Restore the link of a robot; missed messages stay lost."""
        self.lost.discard(robot_id)
        self.network.held.clear()
        self.nodes[robot_id].find()

    def _tick(self, now_s: float) -> None:
        for node in self.nodes.values():
            node.tick(now_s)
        number = next(self._numbers)
        if number % 5 == 0:
            status = RobotStatus("ready", hardware={"kind": RECORDING})
            self._status.put(encode_status(status), encode_stamp(number, 0))

    def _note_stop(self, sample: Any) -> None:
        self.stops.append(topics.robot_of(sample.key))
        self.stop_times_s.append(self.clock.now_s)

    def _on_event(self, sample: Any) -> None:
        event = decode_json(sample.payload, Event, "an event")
        self.manager.on_event(topics.robot_of(sample.key), event)

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncGenerator[None]:
        """Wait for all robots, then poll them like a dashboard."""
        self.manager.open()
        polling = asyncio.create_task(self._poll())
        await until(lambda: all(each.snapshot.status for each in self.links.values()))
        try:
            yield
        finally:
            polling.cancel()
            await asyncio.gather(polling, return_exceptions=True)
            self.manager.close()

    async def _poll(self) -> None:
        while True:
            for robot_id, link in self.links.items():
                if link.poll(self.clock.now_s):
                    self.manager.on_status(robot_id)
            await asyncio.sleep(_POLL_S)

    @contextlib.asynccontextmanager
    async def page(
        self,
        page: str = "0" * 16,
        *,
        may_stop: bool = True,
        name: str = "",
        rights: RobotRights = EVERY_ROBOT,
    ) -> AsyncGenerator[FleetPage]:
        """Open a page with an operator name."""
        opened = FleetPage()
        identity = BusIdentity("web", Role.OPERATOR)
        principal = Principal(identity, may_stop=may_stop, rights=rights)
        session = asyncio.create_task(
            self.manager.run_session(
                PageSocket(
                    page,
                    principal,
                    cast("Any", opened),
                    opened.messages(),
                    contextlib.nullcontext(),
                    name,
                )
            )
        )
        beating = asyncio.create_task(opened.beat())
        await until(lambda: opened.all("welcome"))
        try:
            yield opened
        finally:
            for task in (session, beating):
                task.cancel()
            await asyncio.gather(session, beating, return_exceptions=True)


class FleetPage:
    """WebSocket of a page, and the page."""

    def __init__(self) -> None:
        self.received: list[dict[str, Any]] = []
        self.texts: list[str] = []
        self._inbox = asyncio.Queue[WSMessage]()

    def send(self, **message: Any) -> None:
        self._inbox.put_nowait(WSMessage(WSMsgType.TEXT, json.dumps(message), None))

    def all(self, kind: str) -> list[dict[str, Any]]:
        return [each for each in self.received if each["t"] == kind]

    async def beat(self) -> None:
        while True:
            seen = self.all("state")[-1]["status_seq"] if self.all("state") else 0
            self.send(t="heartbeat", status_seq=seen, sent_ms=0.0)
            await asyncio.sleep(0.1)

    async def messages(self) -> AsyncIterator[WSMessage]:
        while True:
            yield await self._inbox.get()

    async def send_str(self, text: str) -> None:
        self.texts.append(text)
        self.received.append(json.loads(text))

    async def close(self, **_: Any) -> None:
        """Do nothing, because there is no peer."""

    @property
    def fleet(self) -> dict[str, dict[str, Any]]:
        """Return robots and poses, as shown by a page that follows the protocol."""
        robots: dict[str, dict[str, Any]] = {}
        poses: dict[str, Any] = {}
        for message in self.all("fleet"):
            if message["whole"]:
                robots, poses = {}, {}
            robots |= {each["id"]: each for each in message["robots"]}
            poses |= message["poses"]
        return {each: row | {"pose": poses.get(each)} for each, row in robots.items()}

    def outcomes(self) -> dict[str, list[str]]:
        """Return the outcomes of stops by robot, in order of arrival."""
        found: dict[str, list[str]] = {}
        for each in self.all("stop_result"):
            found.setdefault(each["robot"], []).append(each["outcome"])
        return found


async def until(condition: Callable[[], Any], patience_s: float = 8.0) -> None:
    """Wait in virtual time until a condition holds."""
    end_s = asyncio.get_running_loop().time() + patience_s
    while not condition():
        assert asyncio.get_running_loop().time() < end_s, "it did not come"
        await asyncio.sleep(0.01)
