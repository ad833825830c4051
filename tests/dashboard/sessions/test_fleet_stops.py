"""STOP of a robot or of all: immediate, confirmed per robot, and never sent to a replay."""

from __future__ import annotations

import json

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.support.virtual_fleet import VirtualFleet, until
from tests.support.virtual_time import VirtualClock
from tsd_twin.client.monitor import Snapshot
from tsd_twin.dashboard.gateway.socket_limits import TELEOP, LimitDecision, SocketLimiter
from tsd_twin.dashboard.sessions.stops import STOP_LIMIT_S, StopWitness
from tsd_twin.messages.modes import LATCHED, Mode
from tsd_twin.messages.services import LeaseRequest, StopRequest
from tsd_twin.messages.status import RobotStatus

IDS = ["kiwi", "left", "right"]
FATES = ("alive", "stopped", "lost", "killed")
"""States before the stop: running, already stopped, link lost, node killed."""


def bring_to(fleet: VirtualFleet, robot_id: str, fate: str) -> None:
    node = fleet.nodes[robot_id]
    match fate:
        case "stopped":
            node.supervisor.stop(StopRequest("bob"), fleet.clock.now_s)
        case "lost":
            fleet.lose(robot_id)
        case "killed":
            node.kill()
        case _:
            node.supervisor.lease(LeaseRequest(op="acquire", operator="ann"), fleet.clock.now_s)


@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    fates=st.tuples(*[st.sampled_from(FATES)] * 3),
    named=st.sampled_from([None, *IDS]),
    presses=st.integers(1, 3),
)
def test_a_stop_latches_the_robots_it_names_and_says_which_it_did_not_reach(
    fates: tuple[str, ...], named: str | None, presses: int
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        fleet = VirtualFleet(VirtualClock(patch), IDS)
        fate = dict(zip(IDS, fates, strict=True))
        addressed = IDS if named is None else [named]

        async def press() -> None:
            async with fleet.running(), fleet.page() as page:
                for each in IDS:
                    bring_to(fleet, each, fate[each])
                modes = {each: node.supervisor.mode for each, node in fleet.nodes.items()}
                for _ in range(presses):
                    page.send(t="stop", robot=named, all=named is None)
                await until(lambda: len(page.outcomes()) == len(addressed))
                await until(
                    lambda: all(
                        len(each) == 2 * min(presses, 2) + max(presses - 2, 0)
                        for each in page.outcomes().values()
                    ),
                    STOP_LIMIT_S + 4.0,
                )
                reached = {each: fate[each] in ("alive", "stopped") for each in addressed}
                for robot_id, outcomes in page.outcomes().items():
                    ends = {each for each in outcomes if each != "sent"}
                    assert outcomes[0] == "sent"
                    assert ends == {"acknowledged" if reached[robot_id] else "not_reached"}
                for robot_id, node in fleet.nodes.items():
                    mode = node.supervisor.mode
                    if reached.get(robot_id, False):
                        assert mode is Mode.STOPPED
                    elif robot_id not in addressed:
                        assert mode is modes[robot_id], "nobody stopped it"
                for each in page.all("stop_result"):
                    assert (each["why"] is not None) is (each["outcome"] == "not_reached")

        fleet.clock.run(press())
        assert set(fleet.stops) == {each for each in addressed if fate[each] != "lost"}


@settings(max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(silent_s=st.floats(0.1, 1.5))
def test_a_robot_whose_link_comes_back_in_time_is_stopped(silent_s: float) -> None:
    with pytest.MonkeyPatch.context() as patch:
        fleet = VirtualFleet(VirtualClock(patch), ["kiwi"])

        async def press() -> None:
            async with fleet.running(), fleet.page() as page:
                fleet.lose("kiwi")
                page.send(t="stop", robot="kiwi")
                end_s = fleet.clock.now_s + silent_s
                await until(lambda: fleet.clock.now_s >= end_s)
                fleet.find("kiwi")
                await until(lambda: page.outcomes() == {"kiwi": ["sent", "acknowledged"]})
                assert fleet.nodes["kiwi"].supervisor.mode is Mode.STOPPED

        fleet.clock.run(press())


def test_the_first_thing_that_happens_is_that_all_robots_are_sent_a_stop() -> None:
    """Before a reply, and before a robot could delay the others."""
    with pytest.MonkeyPatch.context() as patch:
        fleet = VirtualFleet(VirtualClock(patch), IDS)

        async def press() -> None:
            async with fleet.running(), fleet.page() as page:
                fleet.lose("kiwi")
                fleet.network.is_held = lambda _key: False  # To receive the messages sent to it.
                now_s = fleet.clock.now_s
                page.send(t="stop", all=True)
                await until(lambda: len(fleet.stops) >= len(IDS))
                assert fleet.stops[: len(IDS)] == IDS
                assert fleet.stop_times_s[len(IDS) - 1] - now_s < 0.02

        fleet.clock.run(press())


@pytest.mark.parametrize("robot_id", [VirtualFleet.replay, "nobody"])
def test_a_replay_or_an_unknown_robot_is_not_reached_and_nobody_is_stopped(robot_id: str) -> None:
    with pytest.MonkeyPatch.context() as patch:
        fleet = VirtualFleet(VirtualClock(patch), ["kiwi"])

        async def press() -> None:
            async with fleet.running(), fleet.page() as page:
                page.send(t="robot", id=VirtualFleet.replay)
                page.send(t="stop", robot=robot_id)
                await until(lambda: page.outcomes() == {robot_id: ["not_reached"]})
                code = page.all("stop_result")[0]["why"]["code"]
                assert code == ("unknown_robot" if robot_id == "nobody" else "recording")

        fleet.clock.run(press())
        assert fleet.stops == []


def test_with_a_replay_in_view_a_robot_is_stopped_by_its_name() -> None:
    with pytest.MonkeyPatch.context() as patch:
        fleet = VirtualFleet(VirtualClock(patch), IDS)

        async def press() -> None:
            async with fleet.running(), fleet.page() as page:
                page.send(t="robot", id=VirtualFleet.replay)
                page.send(t="stop", robot="left")
                await until(lambda: page.outcomes() == {"left": ["sent", "acknowledged"]})

        fleet.clock.run(press())
        assert set(fleet.stops) == {"left"}


def test_a_page_that_may_not_stop_stops_nothing() -> None:
    with pytest.MonkeyPatch.context() as patch:
        fleet = VirtualFleet(VirtualClock(patch), IDS)

        async def press() -> None:
            async with fleet.running(), fleet.page(may_stop=False) as page:
                page.send(t="stop", all=True)
                page.send(t="stop", robot="kiwi")
                await until(lambda: len(page.all("reply")) == 2)
                assert {each["why"]["code"] for each in page.all("reply")} == {"viewer"}

        fleet.clock.run(press())
        assert fleet.stops == []


def test_a_stop_of_another_robot_leaves_the_controls_of_this_page_alone() -> None:
    with pytest.MonkeyPatch.context() as patch:
        fleet = VirtualFleet(VirtualClock(patch), ["kiwi", "left"])

        async def press() -> None:
            async with fleet.running(), fleet.page() as page:
                page.send(t="lease", op="acquire")
                await until(lambda: page.all("state")[-1]["has_control"])
                page.send(t="stop", robot="left")
                await until(lambda: page.outcomes() == {"left": ["sent", "acknowledged"]})
                assert page.all("released") == []
                assert fleet.nodes["kiwi"].supervisor.mode is Mode.DISARMED

        fleet.clock.run(press())


@given(
    before=st.sampled_from(list(Mode)),
    after=st.sampled_from(list(Mode)),
    newer=st.booleans(),
    replied=st.booleans(),
)
def test_only_a_new_status_that_shows_the_robot_latched_confirms_a_stop(
    before: Mode, after: Mode, newer: bool, replied: bool
) -> None:
    witness = StopWitness.of(Snapshot(status=RobotStatus(before), status_seq=7))
    seen = Snapshot(status=RobotStatus(after), status_seq=8 if newer else 7)
    sure = replied or before not in LATCHED
    assert witness.confirms(seen, replied=replied) is (newer and after in LATCHED and sure)


@pytest.mark.parametrize("message", [{"robot": "x" * 32}, {"all": True}])
def test_a_stop_of_any_robot_is_never_dropped_in_a_flood(message: dict[str, object]) -> None:
    limiter = SocketLimiter(TELEOP)
    flood = json.dumps({"t": "robot", "id": "x" * 32})
    while limiter.decide(flood, 0.0) is not LimitDecision.DROP:
        pass
    text = json.dumps({"t": "stop"} | message)
    assert [limiter.decide(text, 0.0) for _ in range(9)] == [LimitDecision.PASS] * 9
