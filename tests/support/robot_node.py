"""Robot node on a real bus in a separate thread, like in mock and bridge."""

from __future__ import annotations

import contextlib
import functools
import queue
import tempfile
import threading
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from typing import Any, cast

import pytest
import zenoh

from tests.support.withheld import IN_PROCESS, PATIENCE_S, budget, this_thread_is_a_robot
from tsd_twin import robots
from tsd_twin.bus import Bus, Config, Publisher, as_client, client_config, node_config
from tsd_twin.hardware.robot_io import RobotIO
from tsd_twin.messages.services import Description
from tsd_twin.node import RobotNode
from tsd_twin.robots import RobotDescription
from tsd_twin.simulation import SimRobot

ANY_PORT = "tcp/127.0.0.1:0"
URDF = '<robot name="tsd"/>'
QUICK = robots.read_description("tsd").replace("[motor]", "[motor]\narming_hold_s = 0.1", 1)
"""Shipped robot with speed controllers that arm at once."""
PATIENT = (
    QUICK.replace("[limits]", "[limits]\ncommand_timeout_s = 1.0", 1)
    .replace("max_command_age_s = 0.21", "max_command_age_s = 1.0")
    .replace("stop_allowance_m = 0.35", "stop_allowance_m = 2.0")
)
"""`QUICK` with commands up to 1 s old at full speed, so that delays do not stop it."""


@functools.cache
def _patient_file() -> Any:
    """Return a file that exists until this process ends."""
    file = tempfile.NamedTemporaryFile("w", suffix=".toml", encoding="utf-8")  # noqa: SIM115
    file.write(PATIENT)
    file.flush()
    return file


def patient_robot() -> list[str]:
    """Return the flags of a program that simulates `PATIENT`."""
    return ["--robot", str(_patient_file().name)]


@dataclass(slots=True)
class RunningNode:
    """Running node and its endpoint."""

    id: str
    toml: str
    robot: RobotDescription
    bus: Bus
    endpoint: str
    io: RobotIO
    stopping: threading.Event = field(default_factory=threading.Event)
    failure: BaseException | None = None
    """Error that ended the node, or None."""

    def client(self) -> Bus:
        """Return a session connected to the node."""
        bus = Bus(client_config([self.endpoint]))
        assert bus.wait_for_peer(PATIENCE_S)
        return bus

    def raw_client(self) -> zenoh.Session:
        """Return a session of a third-party program, connected to the node."""
        return raw_session(client_config([self.endpoint]))


def behind(endpoint: str, robot_id: str = "tsd", robot_name: str = "tsd") -> RunningNode:
    """Return the connection data of a shipped robot at an endpoint."""
    nothing = cast("Any", None)
    return RunningNode(
        robot_id,
        robots.read_description(robot_name),
        robots.load_robot(robot_name),
        nothing,
        endpoint,
        nothing,
    )


@contextlib.contextmanager
def running(
    robot_id: str = "tsd", toml: str = PATIENT, io: RobotIO | None = None
) -> Generator[RunningNode]:
    """Run a node, by default with a simulated robot, until the context ends.

    Tests of the shipped command timeout use `QUICK`.
    """
    robot = robots.parse_description(toml, robot_id)
    io = SimRobot(robot) if io is None else io
    with Bus(node_config([ANY_PORT])) as bus:
        node = RobotNode(bus, robot_id, robot, io, Description(toml, URDF))
        (endpoint,) = bus.endpoints()
        it = RunningNode(robot_id, toml, robot, bus, endpoint, io)

        def run() -> None:
            this_thread_is_a_robot()
            try:
                node.run(it.stopping)
            except OSError as error:  # A failed device; other errors are bugs and propagate.
                it.failure = error

        thread = threading.Thread(target=run, name=robot_id)
        followed = budget.follow(IN_PROCESS)
        thread.start()
        try:
            yield it
        finally:
            followed.end()
            it.stopping.set()
            thread.join(PATIENCE_S)
            assert not thread.is_alive()


class Mailbox:
    """Queue of callback arguments with a blocking read."""

    def __init__(self) -> None:
        self._queue: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def __call__(self, *item: Any) -> None:
        self._queue.put(item[0] if len(item) == 1 else item)

    def next(self) -> Any:
        return self._queue.get(timeout=PATIENCE_S)


def matched(publisher: Publisher) -> Publisher:
    """Wait until the publisher has a matching subscriber."""
    poll_until(lambda: publisher.has_subscribers)
    return publisher


def poll_until(condition: Callable[[], bool]) -> None:
    """Wait for a condition of a session."""
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.002)


def raw_session(config: Config) -> zenoh.Session:
    """Open a session of a third-party program."""
    return zenoh.open(config.parsed())


def raw_client(endpoints: list[str]) -> zenoh.Session:
    """Open a session of a third-party program; unlike a peer, it hears the robot's peers."""
    return raw_session(as_client(client_config(endpoints), PATIENCE_S))


@contextlib.contextmanager
def bus_and_session(config: Config) -> Generator[tuple[Bus, zenoh.Session]]:
    """Open a bus; also return its session, for declarations that only Zenoh offers."""
    opened: list[zenoh.Session] = []
    real = zenoh.open

    def record(settings: zenoh.Config) -> zenoh.Session:
        opened.append(real(settings))
        return opened[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(zenoh, "open", record)
        bus = Bus(config)
    with bus:
        yield bus, opened[0]
