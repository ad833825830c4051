"""Handover of control between two dashboards that share only the bus."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import ExitStack
from typing import Any, NamedTuple

import pytest

from tests.dashboard.recorders import CommandRecorder, settle
from tests.support.page_client import Page, Site, robot_on_a_bus
from tsd_twin.bus import Bus, client_config

ALICE, BOB, CAROL = "a" * 16, "b" * 16, "c" * 16
NO_VISER = 1


class Two(NamedTuple):
    """Two gateways with separate buses."""

    here: Site
    there: Site


@pytest.fixture(scope="module")
def two() -> Generator[Two]:
    with ExitStack() as stack:
        endpoint = stack.enter_context(robot_on_a_bus())
        sites: list[Site] = []
        for _ in range(2):
            bus = stack.enter_context(Bus(client_config([endpoint])))
            sites.append(Site(bus, NO_VISER, None))
            stack.callback(sites[-1].close)
        yield Two(*sites)


def lease(page: Page) -> dict[str, Any]:
    return page.state["status"]["lease"]


def press(page: Page, op: str, **fields: Any) -> dict[str, Any]:
    return page.answer("lease", t="lease", op=op, **fields)


def ask(bob: Page, alice: Page) -> None:
    """Request control as Bob, and wait until Alice sees the request."""
    bob.until(lambda: lease(bob)["holder"] == alice.operator)
    bob.until(lambda: press(bob, "request")["ok"])
    alice.until(lambda: lease(alice)["requested_by"] == bob.operator)


def told(page: Page, code: str, **params: str) -> Any:
    why = {"code": code, "params": params}
    return page.until(lambda: [e for e in page.all("event") if e["why"] == why and not e["past"]])[
        -1
    ]


def test_a_grant_moves_control_to_another_dashboard_and_stops_the_robot(two: Two) -> None:
    with two.here.page(ALICE) as alice, two.there.page(BOB) as bob:
        alice.make_ready()
        alice.drive()
        ask(bob, alice)
        settle(alice)
        assert alice.state["has_control"], "a request changes nothing"
        told(alice, "control_requested", operator=bob.operator, holder=alice.operator)
        from_alice, from_bob = CommandRecorder(two.here, alice), CommandRecorder(two.there, bob)
        bob.holds = {"vx": 0.2, "vy": 0.0, "omega": 0.0}  # Too early.
        assert press(alice, "grant", requester=bob.operator)["ok"]
        bob.until(lambda: bob.state["has_control"])
        bob.until(lambda: bob.mode == "ready")
        settle(bob)
        assert bob.mode == "ready", "control never moves with a stick that is held"
        assert not alice.state["has_control"]
        assert not any(command.twist.any() for command in from_bob.take())
        assert not any(command.twist.any() for command in from_alice.take()[-1:])
        bob.send(t="release")
        bob.until(lambda: bob.mode == "driving")


def test_control_that_is_kept_stays_where_it_is(two: Two) -> None:
    with two.here.page(ALICE) as alice, two.there.page(BOB) as bob:
        alice.make_ready()
        alice.drive()
        ask(bob, alice)
        assert press(alice, "deny", requester=bob.operator)["ok"]
        told(bob, "request_denied", operator=alice.operator, asker=bob.operator)
        bob.until(lambda: lease(bob)["requested_by"] is None)
        settle(bob)
        assert alice.state["has_control"]
        assert press(bob, "request")["why"]["code"] == "denied_lately"


def test_a_request_is_withdrawn_by_hand_and_when_its_page_goes(two: Two) -> None:
    with two.here.page(ALICE) as alice:
        alice.make_ready()
        with two.there.page(BOB) as bob:
            ask(bob, alice)
            assert press(bob, "withdraw")["ok"]
            alice.until(lambda: lease(alice)["requested_by"] is None)
            ask(bob, alice)
        alice.until(lambda: lease(alice)["requested_by"] is None)
        assert not press(alice, "grant", requester=bob.operator)["ok"]
        assert alice.state["has_control"]


def test_who_asks_and_falls_asleep_asks_no_longer(two: Two) -> None:
    with two.here.page(ALICE) as alice, two.there.page(BOB) as bob:
        alice.make_ready()
        ask(bob, alice)
        bob.beats = False
        told(alice, "request_withdrawn", operator=bob.operator)


def test_a_holder_who_leaves_leaves_control_to_who_asks(two: Two) -> None:
    with two.there.page(BOB) as bob:
        with two.here.page(ALICE) as alice:
            alice.make_ready()
            alice.drive()
            ask(bob, alice)
        bob.until(lambda: bob.state["has_control"])
        bob.until(lambda: bob.mode == "ready")


def test_nobody_else_answers_and_nobody_else_gets_it(two: Two) -> None:
    with (
        two.here.page(ALICE) as alice,
        two.there.page(BOB) as bob,
        two.here.page(CAROL) as carol,
    ):
        alice.make_ready()
        ask(bob, alice)
        carol.until(lambda: carol.state)
        assert press(carol, "request")["why"]["code"] == "other_request"
        for op in ("grant", "deny"):
            assert press(carol, op, requester=bob.operator)["why"]["code"] == "take_control_first"
            assert not press(alice, op, requester=carol.operator)["ok"]
        assert alice.state["has_control"]


def test_a_take_over_tells_everybody_why(two: Two) -> None:
    with two.here.page(ALICE) as alice, two.there.page(BOB) as bob:
        alice.make_ready()
        bob.until(lambda: lease(bob)["holder"] == alice.operator)
        assert press(bob, "acquire", take_over=True, reason="it is my shift")["ok"]
        for page in (alice, bob):
            told(
                page,
                "lease_taken_over",
                operator=bob.operator,
                other=alice.operator,
                text="it is my shift",
            )


def test_a_control_that_is_held_before_control_is_taken_does_nothing(two: Two) -> None:
    with two.here.page(ALICE) as alice, two.there.page(BOB) as bob:
        alice.make_ready()
        bob.until(lambda: bob.state)
        bob.holds = {"vx": 0.2, "vy": 0.0, "omega": 0.0}
        bob.until(lambda: bob.last("released")["why"]["code"] == "take_control_first")
        commands = CommandRecorder(two.there, bob)
        assert bob.take(take_over=True)["ok"]
        bob.until(lambda: bob.state["has_control"] and bob.mode == "ready")
        settle(bob)
        assert commands.take() == []
        assert bob.mode == "ready"
