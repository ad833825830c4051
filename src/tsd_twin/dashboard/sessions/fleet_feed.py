"""States of all robots for the pages that show the fleet, computed and encoded once for all."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial

import msgspec

from tsd_twin.client.monitor import RobotMonitor
from tsd_twin.dashboard.sessions.robot_directory import LIVE_TIMEOUT_S, KnownRobot, RobotDirectory
from tsd_twin.dashboard.sessions.send_queue import SendQueue
from tsd_twin.dashboard.wire.fleet import Fleet, FleetBattery, FleetEvent, FleetRobot
from tsd_twin.dashboard.wire.from_page import Triple
from tsd_twin.dashboard.wire.to_page import RobotInfo, encode_message
from tsd_twin.lie import SE2
from tsd_twin.messages.codes import Reason
from tsd_twin.messages.commands import why_of
from tsd_twin.messages.modes import LATCHED
from tsd_twin.messages.status import LeaseStatus, RobotStatus
from tsd_twin.security.router_rules import EVERY_ROBOT, RobotRights

FLEET_PERIOD_S = 0.25
IDLE_PERIODS = 4
"""Periods between poses of a robot that is neither shown nor driven: 1 s."""
_VOLTS_STEP = 0.15
"""A smaller change of the voltage is not sent."""


class FleetFeed:
    """Feed of the fleet view; event loop only, and idle without subscribers.

    Subscribers with the same rights share each encoded message. A slow one is sent the whole fleet
    instead of the changes that it has missed.
    """

    def __init__(
        self,
        directory: RobotDirectory,
        is_shown: Callable[[str], bool] = lambda _robot: True,
    ) -> None:
        """`is_shown` returns whether a page has a robot selected."""
        self._directory, self._is_shown = directory, is_shown
        self._pages: dict[SendQueue, RobotRights] = {}
        self._infos: dict[str, tuple[KnownRobot, RobotInfo]] = {}
        self._robots: dict[str, FleetRobot] = {}
        self._poses: dict[str, Triple] = {}
        self._ticks = 0
        self._timer: asyncio.TimerHandle | None = None

    @property
    def has_subscribers(self) -> bool:
        """Whether a page shows the fleet; thread-safe."""
        return bool(self._pages)

    def subscribe(self, queue: SendQueue, rights: RobotRights = EVERY_ROBOT) -> None:
        """Send a page its whole fleet, then the changes."""
        self.update()  # So that the changes that the others get next apply to this page, too.
        self._pages[queue] = rights
        queue.put_fleet(self._whole(rights), partial(self._whole, rights))
        if self._timer is None:
            self._schedule()

    def unsubscribe(self, queue: SendQueue) -> None:
        """Send a page no further changes."""
        self._pages.pop(queue, None)

    def update(self, *, all_poses: bool = True) -> None:
        """Send all subscribers the changes since the last call.

        Without `all_poses`, robots that are neither shown on a page nor driven keep their poses.
        """
        robots = self._rows()
        poses = self._poses_of(
            each for each, row in robots.items() if all_poses or self._is_followed(row)
        )
        changed = [row for row in robots.values() if not _is_same(row, self._robots.get(row.id))]
        moved = {each: pose for each, pose in poses.items() if pose != self._poses.get(each)}
        self._robots, self._poses = robots, self._poses | poses
        if changed or moved:
            texts: dict[RobotRights, str] = {}
            for queue, rights in self._pages.items():
                if rights not in texts:
                    texts[rights] = _encoded(changed, moved, rights, whole=False)
                if texts[rights]:
                    queue.put_fleet(texts[rights], partial(self._whole, rights))

    def _is_followed(self, row: FleetRobot) -> bool:
        return row.driver is not None or self._is_shown(row.id)

    def _whole(self, rights: RobotRights) -> str:
        return _encoded(self._robots.values(), self._poses, rights, whole=True)

    def _schedule(self) -> None:
        self._timer = asyncio.get_running_loop().call_later(FLEET_PERIOD_S, self._tick)

    def _tick(self) -> None:
        self._timer = None
        if self._pages:
            self._schedule()  # First, so that a robot that cannot be shown ends nothing.
            self._ticks += 1
            self.update(all_poses=self._ticks % IDLE_PERIODS == 0)

    def _rows(self) -> dict[str, FleetRobot]:
        rows: dict[str, FleetRobot] = {}
        for name in self._directory.robot_names():
            if (known := self._directory.robot(name.id)) is not None:
                rows[name.id] = self._row(known, name.colour)
        return rows

    def _row(self, known: KnownRobot, colour: str) -> FleetRobot:
        link, info = known.link, self._info(known)
        snapshot, status = link.snapshot, link.snapshot.status
        now_s = time.monotonic()
        age_s = now_s - snapshot.received_s
        lease = status.lease if status else LeaseStatus()
        return FleetRobot(
            id=link.id,
            title=info.title,
            colour=colour,
            panel=info.panel,
            wheel_count=len(info.modules or info.wheels),
            space=info.space,
            source="recording" if link.is_recording else snapshot.source,
            silent=snapshot.overdue_s(now_s) > LIVE_TIMEOUT_S,
            age_s=round(age_s, 3) if math.isfinite(age_s) else None,
            mode=status.mode if status else None,
            latched=status is not None and status.mode in LATCHED,
            why=status.stop if status else None,
            driver=lease.holder,
            requested_by=lease.requested_by,
            operators=status.operators if status else {},
            battery=self._battery(link, status),
            event=self._event(link.id),
        )

    def _info(self, known: KnownRobot) -> RobotInfo:
        """Return the constant data of a robot, computed again after its restart."""
        cached = self._infos.get(known.link.id)
        if cached is None or cached[0] is not known:
            cached = self._infos[known.link.id] = known, known.telemetry.info()
        return cached[1]

    def _battery(self, link: RobotMonitor, status: RobotStatus | None) -> FleetBattery | None:
        volts = None if status is None else status.hardware.get("battery_v")
        if not isinstance(volts, int | float) or not math.isfinite(volts):
            return None  # Not measured, or no number: the field comes from the bus.
        low = volts < link.robot.battery.warn_v
        row = self._robots.get(link.id)
        sent = row.battery if row is not None else None
        if sent is not None and sent.low is low and abs(volts - sent.volts) < _VOLTS_STEP:
            return sent
        return FleetBattery(round(float(volts), 1), low)

    def _event(self, robot_id: str) -> FleetEvent | None:
        latest = self._directory.latest_event(robot_id)
        if latest is None:
            return None
        age_s, event = latest
        return FleetEvent(why_of(event) or Reason(event.kind), round(age_s, 3))

    def _poses_of(self, robot_ids: Iterable[str]) -> dict[str, Triple]:
        """Return the poses of robots on the floor, to a centimetre and half a degree."""
        poses: dict[str, Triple] = {}
        for robot_id in robot_ids:
            known = self._directory.robot(robot_id)
            odom = known.link.snapshot.odom if known is not None else None
            if known is None or odom is None or known.link.kinematics.pose_type is not SE2:
                continue
            x, y, heading = (float(number) for number in odom.xy_heading)
            if math.isfinite(x + y + heading):
                poses[robot_id] = round(x, 2), round(y, 2), round(heading, 2)
        return poses


def _encoded(
    robots: Iterable[FleetRobot], poses: Mapping[str, Triple], rights: RobotRights, *, whole: bool
) -> str:
    """Return a message with the robots that may be watched, or "" if it would be empty."""
    rows = [row for row in robots if rights.may_watch(row.id)]
    places = {each: pose for each, pose in poses.items() if rights.may_watch(each)}
    if not (whole or rows or places):
        return ""
    return encode_message(Fleet(whole=whole, robots=rows, poses=places))


def _is_same(row: FleetRobot, sent: FleetRobot | None) -> bool:
    """Return whether a row differs only in its ages, which the page continues."""
    if sent is None:
        return False
    event, before = row.event, sent.event
    if event is not None and before is not None and event.age_s >= before.age_s:
        event = msgspec.structs.replace(event, age_s=before.age_s)  # Not another like it.
    return msgspec.structs.replace(row, age_s=sent.age_s, event=event) == sent
