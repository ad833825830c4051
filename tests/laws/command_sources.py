"""All real command sources, connected to a robot in virtual time."""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, ClassVar, cast

import msgspec
import numpy as np

from tests.support.memory_bus import MemoryBus
from tests.support.scene_doubles import EmptyScene
from tests.support.virtual_fleet import FleetPage
from tests.support.virtual_robot import VirtualRobot
from tsd_twin.adapters.fleet import Fleet
from tsd_twin.adapters.foxglove.live import FoxgloveSource, LiveOperator
from tsd_twin.adapters.ros.adapter import serve_ros
from tsd_twin.adapters.ros.port import Origin, PortCallbacks
from tsd_twin.adapters.ros_topics import CMD_VEL, namespaces
from tsd_twin.client import AsyncRobotClient, AsyncRobotControl
from tsd_twin.client.bus_port import BusLink
from tsd_twin.client.monitor import RobotMonitor
from tsd_twin.client.protocol import ControlProtocol
from tsd_twin.dashboard.sessions.page_session import PageSocket
from tsd_twin.dashboard.sessions.principal import Principal
from tsd_twin.dashboard.sessions.session_manager import SessionManager
from tsd_twin.errors import TwinError
from tsd_twin.hardware.controller_board import obstacle_word
from tsd_twin.hardware.dynamixel.control_table import BoardMode
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import BASE, TwistStamped, encode_twist
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.modes import LATCHED
from tsd_twin.messages.sentences import sentence
from tsd_twin.messages.services import HolderRequest, LeaseRequest
from tsd_twin.messages.topics import Sample, Service
from tsd_twin.recording import open_recording
from tsd_twin.recording.channels import EntryMaker
from tsd_twin.recording.mcap_file import RecordingFile
from tsd_twin.recording.player import Replay
from tsd_twin.security import BusIdentity, Role

PERIOD_S = 0.02
"""Inputs come 50 times a second."""
_PATIENCE_S = 8.0
_STAMPED = "geometry_msgs/msg/TwistStamped"


class CommandSource(ABC):
    """One source of commands; all inputs are at most as old as it knows."""

    on_bus: ClassVar[bool] = True
    """Whether its commands go over the bus."""
    bus_servos: ClassVar[bool] = False
    """Whether the servos are at the computer."""

    def __init__(self, robot: VirtualRobot) -> None:
        self.robot = robot
        self.said: list[str] = []
        """Sentences that it received."""

    @abstractmethod
    async def open(self) -> None:
        """Connect."""

    @abstractmethod
    async def get_ready(self, *, reset: bool = True) -> str:
        """Do all that a person can do to make the robot ready; return the refusal, or empty."""

    @abstractmethod
    def push(self, vx_mps: float, age_s: float = 0.0) -> None:
        """Give one input, which was made some time ago."""

    @abstractmethod
    async def close(self) -> None:
        """Leave."""

    async def hold(self, seconds: float, vx_mps: float) -> None:
        """Give the same input for some time."""
        end_s = self.robot.clock.now_s + seconds
        while self.robot.clock.now_s < end_s - 1e-9:
            self.push(vx_mps)
            await asyncio.sleep(PERIOD_S)

    def open_bus(self) -> MemoryBus:
        """Return one more session."""
        return MemoryBus(self.robot.network)

    def seen_at(self, age_s: float) -> int:
        """Return the sequence number of the latest status at an earlier time."""
        then_s = self.robot.clock.now_s - age_s
        sent_s = self.robot.status_sent_s
        return max((seq for seq, at_s in sent_s.items() if at_s <= then_s), default=0)

    @property
    def _is_latched(self) -> bool:
        return self.robot.supervisor.mode in LATCHED

    def _until(self) -> float:
        return self.robot.clock.now_s + _PATIENCE_S


class _Link(BusLink):
    """Link that keeps the protocol of its latest operator."""

    def protocol(self, operator: str, name: str = "") -> ControlProtocol:
        self.newest = super().protocol(operator, name)
        return self.newest


class ScriptSource(CommandSource):
    """A program with the client library."""

    _control: AsyncRobotControl

    async def open(self) -> None:
        self._link = _Link(self.open_bus(), self.robot.id)
        self._client = AsyncRobotClient(self._link, "script")
        self._control = self._client.control(arm=False)
        await self._control.acquire()

    async def get_ready(self, *, reset: bool = True) -> str:
        try:
            if reset and self._is_latched:
                await self._control.reset()
            await self._control.arm()
        except TwinError as error:
            return str(error)
        return ""

    def push(self, vx_mps: float, age_s: float = 0.0) -> None:
        try:
            if age_s:  # A script has no old input, but its command may be delayed.
                command = self._link.newest.command(
                    (vx_mps, 0.0, 0.0), BASE, self.robot.clock.now_s, self.seen_at(age_s)
                )
                self._client.link.send(command)
            else:
                self._control.set_velocity(vx_mps=vx_mps)
        except TwinError as error:
            self.said.append(str(error))

    async def close(self) -> None:
        with contextlib.suppress(TwinError):
            await self._client.close()


class ServosAtComputer(ScriptSource):
    """As a script, at a robot whose servos are at a U2D2."""

    bus_servos = True


class PageSource(CommandSource):
    """A page of the dashboard: its session, lease client and dead-man switch."""

    async def open(self) -> None:
        self._link = RobotMonitor(self.open_bus(), self.robot.id)
        self._manager = SessionManager({self._link.id: self._link}, EmptyScene())
        self._manager.open()
        self._page = FleetPage()
        self._tasks = [asyncio.create_task(self._poll()), asyncio.create_task(self._beat())]
        await self._link_is_up()
        principal = Principal(BusIdentity("page", Role.OPERATOR), may_stop=True)
        session = self._manager.run_session(
            PageSocket(
                "0" * 16,
                principal,
                cast("Any", self._page),
                self._page.messages(),
                contextlib.nullcontext(),
            )
        )
        self._tasks.append(asyncio.create_task(session))
        await self._answer("lease", t="lease", op="acquire")

    async def _link_is_up(self) -> None:
        while self._link.snapshot.status is None:
            await asyncio.sleep(PERIOD_S)

    async def _poll(self) -> None:
        while True:
            if self._link.poll(self.robot.clock.now_s):
                self._manager.on_status(self.robot.id)
            await asyncio.sleep(PERIOD_S)

    async def _beat(self) -> None:
        while True:
            self._page.send(t="heartbeat", status_seq=self._link.snapshot.status_seq, sent_ms=0.0)
            await asyncio.sleep(0.2)

    async def _answer(self, to: str, **message: Any) -> str:
        """Send a request; return the refusal, or empty."""
        self._page.received.clear()
        self._page.send(**message)
        end_s = self._until()
        while self.robot.clock.now_s < end_s:
            for each in self._page.received:
                if each["t"] == "reply" and each["to"] == to:
                    if each["ok"]:
                        return ""
                    return sentence(msgspec.convert(each["why"], Reason))
            await asyncio.sleep(PERIOD_S)
        return "no answer"

    async def get_ready(self, *, reset: bool = True) -> str:
        if reset and self._is_latched:
            await self._answer("reset", t="reset")
        if refusal := await self._answer("arm", t="arm"):
            return refusal
        refusal = await armed(self.robot)
        await self.hold(0.1, 0.0)  # The page hears of it before a stick is moved.
        return refusal

    def push(self, vx_mps: float, age_s: float = 0.0) -> None:
        seen = self.seen_at(age_s) if age_s else self._link.snapshot.status_seq
        if vx_mps == 0.0:
            self._page.send(t="release")
        else:
            self._page.send(t="drive", vx=vx_mps, vy=0.0, omega=0.0, status_seq=seen)

    async def close(self) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._manager.close()


class _NoServer:
    """Server of Foxglove without clients that watch."""

    def __getattr__(self, name: str) -> Any:
        return lambda *_args, **_more: name != "wants"


class FoxglovePanel(CommandSource):
    """A client of Foxglove that publishes `cmd_vel`."""

    async def open(self) -> None:
        bus = self.open_bus()
        server = cast("Any", _NoServer())
        fleet = Fleet(lambda link: FoxgloveSource(server, True, "foxglove", link), self.open_bus)
        fleet.watch(cast("Any", bus))
        while not any(each.names for each in fleet.sources.values()):
            await asyncio.sleep(PERIOD_S)
        self._fleet, self._names = fleet, namespaces([self.robot.id])[self.robot.id]
        self._operator = LiveOperator(fleet, "foxglove", self.said.append, lambda: 0.0)

    async def get_ready(self, *, reset: bool = True) -> str:
        if reset and self._is_latched:
            await self._operator.call(self._names.topic("reset"))
        done, text = await self._operator.call(self._names.topic("arm"))
        return "" if done else text

    def push(self, vx_mps: float, age_s: float = 0.0) -> None:
        twist = {"twist": {"linear": {"x": vx_mps}, "angular": {}}}
        self._operator.publish(
            self._names.topic(CMD_VEL.name),
            "json",
            _STAMPED,
            json.dumps(twist).encode(),
            self.robot.clock.now_s - age_s,
        )

    async def close(self) -> None:
        await self._operator.close()
        await self._fleet.close()


class _Graph:
    """Graph of ROS with one publisher of `cmd_vel`, and no subscriber."""

    inputs: PortCallbacks

    def __init__(self) -> None:
        self.entered = asyncio.Event()

    def enter(self, _names: object, inputs: PortCallbacks | None) -> _Graph:
        assert inputs is not None
        self.inputs = inputs
        self.entered.set()
        return self

    def publishers(self, _topic: str) -> list[str]:
        return []

    def subscribers(self, _topic: str) -> list[str]:
        return []

    def wants(self, _topic: str) -> bool:
        return False

    def publish(self, _message: object) -> None:
        """Nobody listens."""

    def close(self) -> None:
        """Nothing is open."""


class RosPublisher(CommandSource):
    """ROS node with a separate clock that publishes `cmd_vel`."""

    _AHEAD_NS = 12_345_678_901

    async def open(self) -> None:
        self._graph, self._sequence, self._ends = _Graph(), 0, threading.Event()
        work = serve_ros(
            cast("Any", self.open_bus),
            cast("Any", self._graph.enter),
            "package://tsd/",
            self._ends,
            lambda: None,
            operator="ros",
        )
        self._serving = asyncio.create_task(work)
        await self._graph.entered.wait()
        await self.hold(2.5, 0.0)  # Its clock becomes known.

    async def get_ready(self, *, reset: bool = True) -> str:
        if reset and self._is_latched:
            await self._call("reset")
        refusal = await self._call("arm")
        await self.hold(0.6, 0.0)
        return refusal

    async def _call(self, service: str) -> str:
        answer: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        self._graph.inputs.on_call(
            service, lambda done, text: answer.set_result("" if done else text)
        )
        return await answer

    def push(self, vx_mps: float, age_s: float = 0.0) -> None:
        self._sequence += 1
        clock = self.robot.clock
        sent_ns = clock.wall_ns() - round(1e9 * age_s) + self._AHEAD_NS
        twist = TwistStamped(BASE, np.array([vx_mps, 0.0, 0.0, 0.0, 0.0, 0.0]))
        self._graph.inputs.on_message(
            CMD_VEL, _STAMPED, encode_twist(twist), Origin(b"a" * 16, self._sequence, sent_ns)
        )

    async def close(self) -> None:
        self._ends.set()
        await self._serving


class RadioControl(CommandSource):
    """The transmitter of the radio control, in the hands of a person."""

    on_bus = False
    _is_lost = False

    async def open(self) -> None:
        await asyncio.sleep(0.1)

    async def get_ready(self, *, reset: bool = True) -> str:
        del reset  # It has none.
        self._send(0.0, speed=0.0, manual=False)
        await asyncio.sleep(2.5)  # The board requires 2 s of zero throttle.
        self._send(0.0, speed=0.0, manual=True)
        await asyncio.sleep(0.1)
        seen = self.robot.telemetry
        if seen.mode == BoardMode.RC:
            return ""
        return sentence(because(Code.ARMING_OBSTACLE, what=obstacle_word(seen.refusal)))

    def push(self, vx_mps: float, age_s: float = 0.0) -> None:
        # The receiver sends pulses, which have no age: an old input is a lost one.
        self._is_lost = self._is_lost or age_s > 0.0
        self._send(0.5 * float(np.sign(vx_mps)), speed=1.0, manual=True)

    def _send(self, forward: float, *, speed: float, manual: bool) -> None:
        firmware = self.robot.firmware
        firmware.set_sticks(forward, 0.0, 0.0, speed)
        firmware.set_switches(manual=manual)
        if self._is_lost:
            firmware.lose_receiver()

    async def close(self) -> None:
        self.robot.firmware.set_switches(manual=False)


class ReplayedDrive(CommandSource):
    """Recording of a drive with all its commands, replayed next to the robot."""

    async def open(self) -> None:
        """Record a script that drives this robot, and bring the robot to rest."""
        file = RecordingFile(self.path)
        make, network = EntryMaker(), self.robot.network
        wall_ns = self.robot.clock.wall_ns

        def record(sample: Sample) -> None:
            for entry in make.of_sample(sample, wall_ns()):
                file.add(entry)

        file.add(make.of_json(topics.alive_key(self.robot.id), {"alive": True}, wall_ns()))
        description = msgspec.to_builtins(self.robot.description)
        file.add(make.of_json(Service.DESC.key(self.robot.id), description, wall_ns()))
        network.takers.append(("twin/**", record))
        script = ScriptSource(self.robot)
        await script.open()
        assert not await script.get_ready()
        await script.hold(1.0, 0.5)
        await script.close()
        network.takers = [each for each in network.takers if each[1] is not record]
        file.close()
        await asyncio.sleep(0.5)
        recording = open_recording(self.path)
        bus = cast("Any", self.open_bus())
        self._replay = Replay(bus, recording, self.robot.id, "replayed")
        self.counted = self.robot.supervisor.gate.accepted
        self.commands = sum(t.count for name, t in recording.topics.items() if "/cmd/" in name)

    path: Path
    """File to record to."""

    async def get_ready(self, *, reset: bool = True) -> str:
        """Ask the replay, as a person at a page would."""
        del reset
        bus = self.open_bus()
        self._serve_soon()
        lease = LeaseRequest(op="acquire", operator="alice")
        asked = {Service.LEASE: lease, Service.ARM: HolderRequest("00")}
        reasons = {
            json.loads(bus.query(service.key("replayed"), msgspec.json.encode(request)))["reason"]
            for service, request in asked.items()
        }
        (reason,) = reasons
        return str(reason)

    def _serve_soon(self) -> None:
        self.robot.clock.machines.append(lambda _now_s: self._replay.serve())

    def push(self, vx_mps: float, age_s: float = 0.0) -> None:
        """It has no inputs: what was recorded is all it has."""

    async def hold(self, seconds: float, vx_mps: float) -> None:
        """Replay the recording at its original speed."""
        del vx_mps
        end_s = self.robot.clock.now_s + seconds
        self._replay.run(cast("Any", _Until(self.robot, end_s)))

    async def close(self) -> None:
        self._replay.close()


class _Until:
    """Event that is set at a time."""

    def __init__(self, robot: VirtualRobot, end_s: float) -> None:
        self._clock, self._end_s = robot.clock, end_s

    def is_set(self) -> bool:
        return self._clock.now_s >= self._end_s

    def wait(self, timeout: float) -> bool:
        self._clock.wait(timeout)
        return self.is_set()


async def armed(robot: VirtualRobot) -> str:
    """Wait for the end of arming; return why it ended elsewhere, or empty."""
    await asyncio.sleep(0.1)
    while robot.supervisor.mode == "arming":
        await asyncio.sleep(PERIOD_S)
    return "" if robot.supervisor.mode == "ready" else robot.supervisor.reason
