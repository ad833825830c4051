"""A dashboard that no page watches hears statuses only and draws nothing; a page wakes it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager

import pytest
import viser

from tests.support.page_client import robot_on_a_bus
from tests.support.robot_node import PATIENCE_S
from tests.support.withheld import WithheldTime
from tsd_twin.bus import Bus, client_config
from tsd_twin.client.monitor import Snapshot
from tsd_twin.dashboard.discovery import RobotDiscovery
from tsd_twin.dashboard.scene.scene import Scene
from tsd_twin.dashboard.update_loop import UpdateLoop
from tsd_twin.messages import topics
from tsd_twin.messages.events import Event
from tsd_twin.messages.topics import QoS

AT_ONCE_S = 0.1


class RunningLoop:
    """The update loop of a dashboard beside one robot, watched when `watched` is set."""

    def __init__(self, bus: Bus, scene: Scene) -> None:
        self.discovery = RobotDiscovery(bus)
        self.watched = threading.Event()
        self.statuses: list[str] = []
        self._stop = threading.Event()
        self.loop = UpdateLoop(
            self.discovery, scene, self.statuses.append, self._ignore, self.watched.is_set
        )
        self._thread = threading.Thread(target=self.loop.run, args=(self._stop,))
        self._thread.start()

    @property
    def snapshot(self) -> Snapshot:
        link = self.discovery.links.get("tsd")
        return Snapshot() if link is None else link.snapshot

    def close(self) -> None:
        self._stop.set()
        self.loop.wake()
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()

    @staticmethod
    def _ignore(robot_id: str, event: Event) -> None:
        pass


def until(condition: Callable[[], bool]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s, "what was waited for has not come"
        time.sleep(0.001)


@pytest.fixture(scope="module")
def bus() -> Generator[Bus]:
    with robot_on_a_bus() as endpoint, Bus(client_config([endpoint])) as client:
        assert client.wait_for_peer(PATIENCE_S)
        yield client


@contextmanager
def running(bus: Bus, server: viser.ViserServer) -> Generator[RunningLoop]:
    it = RunningLoop(bus, Scene(server))
    try:
        yield it
    finally:
        it.close()


def test_unwatched_it_subscribes_to_the_status_only(bus: Bus, server: viser.ViserServer) -> None:
    streams = (topics.JOINTS, topics.SETPOINT, topics.ODOM, topics.TRUTH)
    with running(bus, server) as it:
        # Of the same session, so what matches is what this dashboard subscribes to.
        puts = [bus.publisher(topic.key("tsd"), QoS.DATA) for topic in streams]
        status = bus.publisher(topics.STATUS.key("tsd"), QoS.DATA)
        until(lambda: len(it.statuses) >= 5)
        assert status.has_subscribers
        assert not any(put.has_subscribers for put in puts)
        heard = it.snapshot
        assert heard.status is not None
        assert heard.joints is heard.setpoint is heard.odom is heard.truth is None
        it.watched.set()
        it.loop.wake()
        until(lambda: all(put.has_subscribers for put in puts))
        for put in (*puts, status):
            put.close()


def test_a_page_that_opens_has_the_state_at_once(bus: Bus, server: viser.ViserServer) -> None:
    with running(bus, server) as it:
        until(lambda: bool(it.statuses))
        it.watched.set()
        start_s = time.monotonic()
        with WithheldTime() as withheld:
            it.loop.wake()
            until(lambda: None not in (it.snapshot.joints, it.snapshot.odom, it.snapshot.truth))
            took_s = time.monotonic() - start_s
    assert took_s < AT_ONCE_S + withheld.total_s
