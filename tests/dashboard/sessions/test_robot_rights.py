"""Pages of users limited to some robots, in virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.support.virtual_fleet import FleetPage, VirtualFleet, until
from tests.support.virtual_time import VirtualClock
from tsd_twin.lie import SE2
from tsd_twin.messages.services import LeaseRequest, StopRequest
from tsd_twin.security.router_rules import EVERY_ROBOT, RobotRights

OWN, SEEN, HIDDEN = "kiwi", "lab-x7", "lab-y9"
HERS = RobotRights(frozenset({OWN}), frozenset({SEEN}))
Work = Callable[[FleetPage], Any]


@pytest.fixture
def fleet(monkeypatch: pytest.MonkeyPatch) -> VirtualFleet:
    return VirtualFleet(VirtualClock(monkeypatch), [HIDDEN, OWN, SEEN])


def run(fleet: VirtualFleet, work: Work, rights: RobotRights = HERS) -> None:
    async def opened() -> None:
        async with fleet.running(), fleet.page(rights=rights) as page:
            await work(page)

    fleet.clock.run(opened())


async def answer(page: FleetPage, to: str, **message: Any) -> dict[str, Any]:
    before = len(page.all("reply"))
    page.send(**message)
    await until(lambda: [m for m in page.all("reply")[before:] if m["to"] == to])
    return next(m for m in page.all("reply")[before:] if m["to"] == to)


async def select(page: FleetPage, robot: str) -> None:
    """Select a robot; a page that shows it already gets no reply."""
    page.send(t="robot", id=robot)
    await asyncio.sleep(0.3)


async def everything(page: FleetPage) -> None:
    """Request all data that a page can show, for all robots."""
    page.send(t="fleet", on=True)
    page.send(t="map", on=True)
    for robot in (HIDDEN, SEEN, OWN):
        await select(page, robot)
        page.send(t="plot_fields", names=["status.mode"])
        page.send(t="look_back", history_offset_s=0.5)
        await asyncio.sleep(0.5)


def test_no_message_to_a_page_names_a_hidden_robot(fleet: VirtualFleet) -> None:
    async def work(page: FleetPage) -> None:
        await everything(page)
        hidden = fleet.nodes[HIDDEN]
        hidden.supervisor.stop(StopRequest("bob"), fleet.clock.now_s)
        hidden.set_pose(SE2(np.array([1.0, 2.0, 0.5])))
        fleet.manager.on_robots_changed()
        fleet.manager._map_data.show_route(HIDDEN, np.zeros((3, 3)))
        await select(page, OWN)
        await asyncio.sleep(2.0)
        texts = [text for text in page.texts if '"reply"' not in text]
        assert not [text for text in texts if HIDDEN in text or fleet.replay in text]
        assert set(page.fleet) == {OWN, SEEN}
        assert {each["id"] for each in page.all("welcome")[-1]["robots"]} == {OWN, SEEN}
        assert all(each["robot"] != HIDDEN for each in page.all("welcome"))

    run(fleet, work)


def test_the_same_steps_show_all_robots_to_others(fleet: VirtualFleet) -> None:
    async def work(page: FleetPage) -> None:
        await everything(page)
        assert {HIDDEN, OWN, SEEN} <= set(page.fleet)
        assert HIDDEN in {each["id"] for each in page.all("welcome")[-1]["robots"]}
        points = [each for each in page.all("state") if each["map"]]
        assert {HIDDEN, OWN, SEEN} <= {row["id"] for row in points[-1]["map"]["robots"]}

    run(fleet, work, EVERY_ROBOT)


def test_a_hidden_robot_is_answered_like_one_that_does_not_exist(fleet: VirtualFleet) -> None:
    async def work(page: FleetPage) -> None:
        whys = [
            (await answer(page, "robot", t="robot", id=robot))["why"] for robot in (HIDDEN, "none")
        ]
        assert whys[0]["code"] == whys[1]["code"] == "unknown_robot"
        assert set(whys[0]["params"]) == set(whys[1]["params"])
        for robot in (HIDDEN, "none"):
            page.send(t="stop", robot=robot)
            await until(lambda robot=robot: page.outcomes().get(robot) == ["not_reached"])
        stops = {each["robot"]: each for each in page.all("stop_result")}
        assert stops[HIDDEN]["why"]["code"] == stops["none"]["why"]["code"] == "unknown_robot"
        assert fleet.stops == []

    run(fleet, work)


def test_a_stop_of_all_reaches_all_that_the_page_shows_and_no_other(fleet: VirtualFleet) -> None:
    async def work(page: FleetPage) -> None:
        page.send(t="stop", all=True)
        await until(lambda: page.outcomes() == {r: ["sent", "acknowledged"] for r in (OWN, SEEN)})
        assert set(fleet.stops) == {OWN, SEEN}

    run(fleet, work)


def test_a_stop_without_a_visible_robot_reaches_no_other(fleet: VirtualFleet) -> None:
    """STOP on a page without a robot stops all live robots that its user may watch."""

    async def work(page: FleetPage) -> None:
        reply = await answer(page, "stop", t="stop")
        assert not reply["ok"]
        assert fleet.stops == []

    run(fleet, work, RobotRights(frozenset({"other"})))


def test_a_robot_that_may_only_be_watched_gives_no_control(fleet: VirtualFleet) -> None:
    async def work(page: FleetPage) -> None:
        await select(page, SEEN)
        for op in ("acquire", "request"):
            reply = await answer(page, "lease", t="lease", op=op)
            assert reply["why"]["code"] == "watch_only"
        for what in ("arm", "reset", "disarm"):
            assert not (await answer(page, what, t=what))["ok"]
        assert fleet.links[SEEN].snapshot.status.lease.holder is None
        assert not [each for each in fleet.nodes if fleet.links[each].snapshot.status.lease.holder]

    run(fleet, work)


def test_control_of_an_own_robot_does_not_extend_to_a_watched_one(fleet: VirtualFleet) -> None:
    async def work(page: FleetPage) -> None:
        await select(page, OWN)
        assert (await answer(page, "lease", t="lease", op="acquire"))["ok"]
        await select(page, SEEN)
        reply = await answer(page, "lease", t="lease", op="acquire")
        assert reply["why"]["code"] == "watch_only"
        assert not (await answer(page, "arm", t="arm"))["ok"]

    run(fleet, work)


@pytest.mark.parametrize(("shown", "driven"), [(False, False), (True, False), (False, True)])
def test_poses_of_robots_that_nobody_shows_or_drives_come_once_a_second(
    fleet: VirtualFleet, shown: bool, driven: bool
) -> None:
    async def work(page: FleetPage) -> None:
        page.send(t="fleet", on=True)
        await select(page, SEEN if shown else OWN)
        node = fleet.nodes[SEEN]
        if driven:
            request = LeaseRequest(op="acquire", operator="script")
            lease = node.supervisor.lease(request, fleet.clock.now_s).lease
        await asyncio.sleep(1.0)
        before = len(page.all("fleet"))
        for step in range(160):
            node.set_pose(SE2(np.array([0.1 * step, 0.0, 0.0])))
            await asyncio.sleep(0.05)
            if driven and step % 10 == 0:
                renewal = LeaseRequest(op="renew", operator="script", lease=lease)
                node.supervisor.lease(renewal, fleet.clock.now_s)
        poses = [m for m in page.all("fleet")[before:] if SEEN in m["poses"]]
        if shown or driven:
            assert len(poses) >= 28
        else:
            assert 7 <= len(poses) <= 9

    run(fleet, work, EVERY_ROBOT)
