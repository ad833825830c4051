"""States of all robots for a page: complete at first, then changes only, encoded once."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import AsyncExitStack
from typing import Any

import numpy as np
import pytest

from tests.support.virtual_fleet import FleetPage, VirtualFleet, until
from tests.support.virtual_time import VirtualClock
from tsd_twin.dashboard.sessions import fleet_feed
from tsd_twin.dashboard.sessions.send_queue import MAX_UNACKNOWLEDGED, SendQueue
from tsd_twin.lie import SE2
from tsd_twin.messages.events import Event
from tsd_twin.messages.services import LeaseRequest, StopRequest

IDS = ["kiwi", "left", "right"]


@pytest.fixture
def fleet(monkeypatch: pytest.MonkeyPatch) -> VirtualFleet:
    return VirtualFleet(VirtualClock(monkeypatch), IDS)


async def open_view(page: FleetPage) -> None:
    page.send(t="fleet", on=True)
    await until(lambda: page.fleet)


async def quiet(page: FleetPage, seconds: float) -> list[dict[str, Any]]:
    """Return the fleet messages of a time interval."""
    before = len(page.all("fleet"))
    await asyncio.sleep(seconds)
    return page.all("fleet")[before:]


def run(fleet: VirtualFleet, work: Callable[[FleetPage], Any]) -> None:
    async def opened() -> None:
        async with fleet.running(), fleet.page(name="Ольга") as page:
            await open_view(page)
            await work(page)

    fleet.clock.run(opened())


def test_every_robot_and_every_replay_is_listed(fleet: VirtualFleet) -> None:
    async def work(page: FleetPage) -> None:
        await until(lambda: all(row["mode"] for row in page.fleet.values()))
        assert set(page.fleet) == {*IDS, fleet.replay}
        assert page.fleet[fleet.replay]["source"] == "recording"
        kiwi = page.fleet["kiwi"]
        assert (kiwi["source"], kiwi["silent"], kiwi["latched"]) == ("robot", False, False)
        assert (kiwi["panel"], kiwi["wheel_count"], kiwi["space"]) == ("gimbals", 3, "floor")
        assert kiwi["battery"]["volts"] > 0.0

    run(fleet, work)


def test_robots_at_rest_send_nothing(fleet: VirtualFleet) -> None:
    async def work(page: FleetPage) -> None:
        await asyncio.sleep(1.0)
        assert await quiet(page, 3.0) == []

    run(fleet, work)


def test_a_change_of_one_robot_sends_that_robot_alone(fleet: VirtualFleet) -> None:
    async def work(page: FleetPage) -> None:
        await asyncio.sleep(1.0)
        stop = StopRequest("bob", name="Боб")
        fleet.nodes["left"].supervisor.stop(stop, fleet.clock.now_s)
        changes = await quiet(page, 1.0)
        assert {each["id"] for message in changes for each in message["robots"]} == {"left"}
        left = page.fleet["left"]
        assert left["latched"]
        assert left["why"] == {"code": "stop_requested", "params": {"by": "bob"}}
        assert left["operators"] == {"bob": "Боб"}
        assert left["event"]["why"]["code"] == "mode_changed"

    run(fleet, work)


def test_a_robot_that_moves_sends_its_pose_and_nothing_else(fleet: VirtualFleet) -> None:
    async def work(page: FleetPage) -> None:
        await asyncio.sleep(1.0)
        pose = SE2(np.array([1.0, 2.0, 0.5]))
        fleet.nodes["kiwi"].set_pose(pose)
        changes = await quiet(page, 1.0)
        assert [each["robots"] for each in changes] == [[]] * len(changes)
        assert page.fleet["kiwi"]["pose"] == [1.0, 2.0, 0.5]

    run(fleet, work)


def test_a_silent_robot_stays_listed_with_its_age(fleet: VirtualFleet) -> None:
    async def work(page: FleetPage) -> None:
        fleet.lose("right")
        await until(lambda: page.fleet["right"]["silent"])
        assert 1.0 < page.fleet["right"]["age_s"] < 1.5
        assert await quiet(page, 2.0) == [], "the page counts on"
        fleet.find("right")
        await until(lambda: not page.fleet["right"]["silent"])

    run(fleet, work)


def test_the_driver_and_the_one_who_asks_are_named(fleet: VirtualFleet) -> None:
    async def work(page: FleetPage) -> None:
        own = page.all("welcome")[-1]["operator"]
        page.send(t="lease", op="acquire")
        await until(lambda: page.fleet["kiwi"]["driver"] == own)
        asks = LeaseRequest(op="request", operator="bob", name="王小明")
        fleet.nodes["kiwi"].supervisor.lease(asks, fleet.clock.now_s)
        await until(lambda: page.fleet["kiwi"]["requested_by"] == "bob")
        assert page.fleet["kiwi"]["operators"] == {own: "Ольга", "bob": "王小明"}
        page.send(t="name", name="Оля")
        await until(lambda: page.fleet["kiwi"]["operators"][own] == "Оля")
        assert page.all("welcome")[-1]["name"] == "Оля"

    run(fleet, work)


def test_a_repeated_event_is_sent_again(fleet: VirtualFleet) -> None:
    async def work(page: FleetPage) -> None:
        await asyncio.sleep(1.0)
        for _ in range(2):
            fleet.manager.on_event("kiwi", Event("id", "", robot_s=1.0))
            assert len(await quiet(page, 1.0)) == 1

    run(fleet, work)


def test_a_closed_view_and_a_closed_page_are_sent_nothing(fleet: VirtualFleet) -> None:
    async def work() -> None:
        async with fleet.running():
            async with fleet.page("a" * 16) as page:
                await open_view(page)
                page.send(t="fleet", on=False)
                await asyncio.sleep(0.5)
                fleet.nodes["kiwi"].supervisor.stop(StopRequest(), fleet.clock.now_s)
                assert await quiet(page, 1.0) == []
                page.send(t="fleet", on=True)
                await until(lambda: page.fleet["kiwi"]["latched"])
            assert not fleet.manager.live.feed.has_subscribers

    fleet.clock.run(work())


def test_twenty_viewers_share_what_is_encoded_once(
    fleet: VirtualFleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    encoded: list[str] = []
    encode = fleet_feed.encode_message

    def count(message: Any) -> str:
        encoded.append(encode(message))
        return encoded[-1]

    async def work() -> None:
        async with fleet.running(), AsyncExitStack() as stack:
            pages = [
                await stack.enter_async_context(fleet.page(f"{number:016x}"))
                for number in range(20)
            ]
            for page in pages:
                await open_view(page)
            await asyncio.sleep(1.0)
            monkeypatch.setattr(fleet_feed, "encode_message", count)
            fleet.nodes["kiwi"].supervisor.stop(StopRequest(), fleet.clock.now_s)
            await until(lambda: all(page.fleet["kiwi"]["latched"] for page in pages))
            assert 0 < len(encoded) <= 3
            assert all(any(text is encoded[-1] for text in page.texts) for page in pages)
            assert len({str(page.fleet["kiwi"]) for page in pages}) == 1

    fleet.clock.run(work())


def test_a_slow_page_gets_the_whole_fleet_in_place_of_what_it_missed() -> None:
    queue = SendQueue()
    queue.put_fleet("first change", lambda: "whole")
    assert queue._next() == "first change"
    queue.put_fleet("second change", lambda: "whole")
    queue.put_fleet("third change", lambda: "whole")
    assert queue._next() == "whole"
    assert queue._next() is None


def test_a_page_that_confirms_no_state_is_not_flooded_with_the_fleet() -> None:
    queue = SendQueue()
    for number in range(MAX_UNACKNOWLEDGED):
        queue.put_state(number, "state")
        assert queue._next() == "state"
    queue.put_fleet("change", lambda: "whole")
    assert queue._next() is None
    queue.acknowledge(0)
    assert queue._next() == "change"
