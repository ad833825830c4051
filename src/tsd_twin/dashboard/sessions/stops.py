"""Stops of any robots: published at once, then confirmed by the status of each robot."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass
from typing import Any

from tsd_twin.client import procedures
from tsd_twin.client.monitor import RobotMonitor, Snapshot
from tsd_twin.dashboard.sessions.fleet_feed import FleetFeed
from tsd_twin.dashboard.sessions.lease import RpcExecutor
from tsd_twin.dashboard.sessions.permitted_robots import PermittedRobots
from tsd_twin.dashboard.sessions.robot_directory import LIVE_TIMEOUT_S, RobotDirectory
from tsd_twin.dashboard.wire.fleet import StopResult
from tsd_twin.dashboard.wire.from_page import StopCommand
from tsd_twin.dashboard.wire.to_page import ActionReply
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.commands import why_of
from tsd_twin.messages.modes import LATCHED
from tsd_twin.messages.services import Reply

STOP_LIMIT_S = 2.5
"""Time after which a robot that has not confirmed a stop counts as not reached."""
_POLL_S = 0.02
_RETRY_S = 0.25
"""Minimum time between series of stops; without a robot, a series ends at once."""
MAX_CONCURRENT_STOPS = 2
"""A second stop starts after the first, so a third would add nothing."""


@dataclass(frozen=True, slots=True)
class StopWitness:
    """Decides whether a robot has stopped, from its state when the stop was sent."""

    status_seq: int
    was_latched: bool

    @staticmethod
    def of(snapshot: Snapshot) -> StopWitness:
        """Begin with the state at the time of the stop."""
        return StopWitness(snapshot.status_seq, _is_latched(snapshot))

    def confirms(self, snapshot: Snapshot, *, replied: bool) -> bool:
        """Return whether a state confirms the stop; `replied` means that the robot did.

        A robot that was latched before must also reply, since another operator may have reset it
        after this state. If several robots share an id, only their replies count.
        """
        if snapshot.source == "several":
            return replied
        is_new = snapshot.status_seq != self.status_seq
        return is_new and _is_latched(snapshot) and (replied or not self.was_latched)


def _is_latched(snapshot: Snapshot) -> bool:
    return snapshot.status is not None and snapshot.status.mode in LATCHED


@dataclass(frozen=True, slots=True)
class LiveRobots:
    """The robots of the bus, for all pages; pages with a recording stop and list them, too."""

    directory: RobotDirectory | PermittedRobots
    executor: RpcExecutor
    feed: FleetFeed


class PageStops:
    """Stops that one page requests; event loop only.

    Each is published before anything else happens, then repeated on separate threads.
    """

    def __init__(self, live: LiveRobots, operator: str, send: Callable[[Any], None]) -> None:
        self.name = ""
        """Display name of the operator."""
        self._live, self._operator, self._send = live, operator, send
        self._running: dict[str, set[asyncio.Task[None]]] = {}

    def stop(self, message: StopCommand, shown: str | None) -> list[RobotMonitor]:
        """Publish a stop and return the robots addressed; the page gets the results later.

        The page shows robot `shown`, or none that is live.
        """
        if message.robot is None and not message.all:
            links = self._live.directory.links_to_stop(shown)
            self._publish(links)
            self._start("", self._stop_view(links))
            return links
        links = self._named(None if message.all else message.robot)
        self._publish(links)
        for link in links:
            self._send(StopResult(robot=link.id, outcome="sent"))
            self._start(link.id, self._stop_robot(link, StopWitness.of(link.snapshot)))
        return links

    def _named(self, robot_id: str | None) -> list[RobotMonitor]:
        """Return one robot or all; report one that cannot be addressed."""
        links = self._live.directory.links
        if robot_id is None:
            return [link for link in links.values() if not link.is_recording]
        link = links.get(robot_id)
        if link is not None and not link.is_recording:
            return [link]
        code = Code.UNKNOWN_ROBOT if link is None else Code.RECORDING
        why = because(code, robot=robot_id)
        self._send(StopResult(robot=robot_id, outcome="not_reached", why=why))
        return []

    def _publish(self, links: Sequence[RobotMonitor]) -> None:
        payload = procedures.stop_payload(self._operator, name=self.name)
        for link in links:
            link.send_stop(payload)

    def _start(self, key: str, work: Coroutine[Any, Any, None]) -> None:
        running = self._running.setdefault(key, set())
        if len(running) >= MAX_CONCURRENT_STOPS:
            work.close()
            return
        task = asyncio.create_task(work)
        running.add(task)
        task.add_done_callback(running.discard)

    async def _stop_view(self, links: Sequence[RobotMonitor]) -> None:
        reply = await self._live.executor.stop_all(links, self._operator, self.name)
        self._send(ActionReply(to="stop", ok=reply.ok, why=why_of(reply)))

    async def _stop_robot(self, link: RobotMonitor, witness: StopWitness) -> None:
        why = await self._confirm(link.id, witness)
        outcome = "acknowledged" if why is None else "not_reached"
        self._send(StopResult(robot=link.id, outcome=outcome, why=why))

    async def _confirm(self, robot_id: str, witness: StopWitness) -> Reason | None:
        """Repeat a stop until the status confirms it; return why it does not."""
        links, now_s = self._live.directory.links, time.monotonic()
        end_s, retry_s = now_s + STOP_LIMIT_S, -math.inf
        stopping: asyncio.Task[Reply] | None = None
        while True:
            link = links[robot_id]  # Another object after a restart of the robot.
            replied = stopping is not None and stopping.done() and stopping.result().ok
            if witness.confirms(link.snapshot, replied=replied):
                return None
            if (now_s := time.monotonic()) >= end_s:
                break
            if (stopping is None or stopping.done()) and not replied and now_s >= retry_s:
                retry_s = now_s + _RETRY_S
                stop = self._live.executor.stop(link, self._operator, self.name)
                stopping = asyncio.create_task(stop)
            await asyncio.sleep(_POLL_S)
        snapshot = links[robot_id].snapshot
        if snapshot.overdue_s(now_s) < LIVE_TIMEOUT_S:
            return because(Code.NO_ANSWER)
        age_s = now_s - snapshot.received_s
        return because(Code.ROBOT_SILENT, **({"s": age_s} if math.isfinite(age_s) else {}))
