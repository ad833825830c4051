"""Robots that are neither shown nor driven only send summaries; a page wakes the dashboard."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager

import pytest
import viser

from tests.support.page_client import robot_on_a_bus
from tests.support.withheld import PATIENCE_S, WithheldTime
from tsd_twin.bus import Bus, client_config
from tsd_twin.client.monitor import Snapshot
from tsd_twin.dashboard import update_loop
from tsd_twin.dashboard.discovery import RobotDiscovery
from tsd_twin.dashboard.scene.scene import STALE_S, Scene
from tsd_twin.dashboard.update_loop import UpdateLoop
from tsd_twin.messages import topics
from tsd_twin.messages.events import Event
from tsd_twin.messages.topics import QoS, Service

AT_ONCE_S = 0.1


class RunningLoop:
    """Update loop of a dashboard with one robot.

    Setting `watched` simulates a page, and `shown` that it has the robot selected.
    """

    def __init__(self, bus: Bus, scene: Scene, *, shown: bool = True) -> None:
        self.discovery = RobotDiscovery(bus)
        self.scene = scene
        self.watched, self.shown = threading.Event(), threading.Event()
        if shown:
            self.shown.set()
        self.statuses: list[str] = []
        self._stop = threading.Event()
        self.loop = UpdateLoop(
            self.discovery,
            scene,
            self.statuses.append,
            self._ignore,
            self.watched.is_set,
            lambda _robot: self.shown.is_set(),
        )
        self._thread = threading.Thread(target=self.loop.run, args=(self._stop,))
        self._thread.start()

    @property
    def follows(self) -> bool:
        return self.discovery.links["tsd"].is_streaming

    @property
    def snapshot(self) -> Snapshot:
        link = self.discovery.links.get("tsd")
        return Snapshot() if link is None else link.snapshot

    def close(self) -> None:
        self._stop.set()
        self.loop.wake()
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()
        for link in self.discovery.links.values():
            link.close()

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
def running(bus: Bus, server: viser.ViserServer, *, shown: bool = True) -> Generator[RunningLoop]:
    it = RunningLoop(bus, Scene(server), shown=shown)
    try:
        yield it
    finally:
        it.close()


STREAMS = (topics.JOINTS, topics.SETPOINT, topics.ODOM, topics.TRUTH, topics.STATUS)


def is_complete(snapshot: Snapshot) -> bool:
    known = (snapshot.joints, snapshot.setpoint, snapshot.odom, snapshot.truth, snapshot.status)
    return None not in known


@pytest.mark.parametrize("watched", [False, True])
def test_without_page_or_on_another_robot_a_robot_sends_summaries_only(
    bus: Bus, server: viser.ViserServer, watched: bool
) -> None:
    with running(bus, server, shown=False) as it:
        if watched:
            it.watched.set()
        # In the same session, so matching subscribers belong to this dashboard.
        puts = [bus.publisher(topic.key("tsd"), QoS.DATA) for topic in STREAMS]
        summary = bus.publisher(topics.SUMMARY.key("tsd"), QoS.DATA)
        until(lambda: it.snapshot.in_summary and not any(put.has_subscribers for put in puts))
        assert summary.has_subscribers
        heard = len(it.statuses)
        until(lambda: len(it.statuses) >= heard + 2)
        assert is_complete(it.snapshot)
        it.shown.set()
        it.watched.set()
        it.loop.wake()
        until(lambda: all(put.has_subscribers for put in puts))
        for put in (*puts, summary):
            put.close()


def test_summaries_neither_age_nor_reverse_the_state(
    bus: Bus, server: viser.ViserServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(update_loop, "IDLE_TIMEOUT_S", 0.1)
    with running(bus, server) as it:
        it.watched.set()
        until(lambda: bool(it.statuses))
        link = it.discovery.links["tsd"]
        numbers: list[int] = []
        overdue_s: list[float] = []
        with WithheldTime() as withheld:
            for shown in (True, False, True, False):
                (it.shown.set if shown else it.shown.clear)()
                end_s = time.monotonic() + 0.8
                while time.monotonic() < end_s:
                    numbers.append(link.snapshot.status_seq)
                    overdue_s.append(link.snapshot.overdue_s(time.monotonic()))
                    time.sleep(0.001)
    assert numbers == sorted(numbers)
    assert max(overdue_s) < STALE_S + withheld.total_s


def test_a_driven_robot_sends_all_streams_although_no_page_shows_it(
    bus: Bus, server: viser.ViserServer
) -> None:
    with running(bus, server, shown=False) as it:
        it.watched.set()
        until(lambda: it.snapshot.in_summary)
        assert not it.follows
        bus.query(Service.LEASE.key("tsd"), b'{"op": "acquire", "operator": "alice"}')
        until(lambda: it.follows and not it.snapshot.in_summary)


def test_states_arrive_while_the_scene_is_being_changed(
    bus: Bus, server: viser.ViserServer
) -> None:
    """A driver whose states are late has to release the controls."""
    with running(bus, server) as it:
        it.watched.set()
        it.loop.wake()
        until(lambda: "tsd" in it.scene.visuals and it.follows)
        with it.scene.lock:  # As while viewers connect.
            heard = len(it.statuses)
            until(lambda: len(it.statuses) >= heard + 10)


def test_a_page_that_opens_has_the_state_at_once(bus: Bus, server: viser.ViserServer) -> None:
    with running(bus, server) as it:
        # Drawing new meshes takes the interpreter from the loop; this test excludes it.
        until(lambda: bool(it.statuses) and "tsd" in it.scene.visuals)
        it.watched.set()
        start_s = time.monotonic()
        with WithheldTime() as withheld:
            it.loop.wake()
            until(lambda: None not in (it.snapshot.joints, it.snapshot.odom, it.snapshot.truth))
            took_s = time.monotonic() - start_s
    assert took_s < AT_ONCE_S + withheld.total_s
