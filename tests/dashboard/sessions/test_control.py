"""Control and its end, over real sockets, a real bus and a real node."""

from __future__ import annotations

import threading
from collections.abc import Generator

import numpy as np
import pytest

from tests.dashboard.recorders import CommandRecorder, settle
from tests.support.page_client import Site, site

OTHER = "fedcba9876543210"


@pytest.fixture(scope="module")
def served() -> Generator[Site]:
    with site() as made:
        yield made


def test_commands_of_a_page_without_control_go_nowhere(served: Site) -> None:
    with served.page() as page:
        commands = CommandRecorder(served, page)
        page.holds = {"vx": 0.5, "vy": 0.0, "omega": 0.0}
        page.until(lambda: len(page.all("state")) >= 5)
        assert commands.take() == []
        for button in ("arm", "disarm", "reset"):
            assert page.answer(button, t=button) == {
                "t": "reply",
                "to": button,
                "ok": False,
                "why": {"code": "take_control_first"},
            }


def test_with_control_and_armed_the_robot_goes_where_the_stick_says(served: Site) -> None:
    with served.page() as page:
        page.make_ready()
        commands = CommandRecorder(served, page)
        page.drive(0.3, -0.1, 0.4)
        page.until(lambda: np.allclose(page.state["commanded"], [0.3, -0.1, 0.4], atol=0.02))
        sent = commands.take()
        assert all(np.allclose(c.twist, [0.3, -0.1, 0.0, 0.0, 0.0, 0.4]) for c in sent)
        seen = {state["status_seq"] for state in page.all("state")}
        assert {command.status_seq for command in sent} <= seen
        page.holds = None
        page.send(t="release")
        page.until(lambda: page.mode == "ready")
        assert commands.is_put_to_rest()


def test_a_second_release_says_nothing_new(served: Site) -> None:
    with served.page() as page:
        page.make_ready()
        page.drive()
        commands = CommandRecorder(served, page)
        page.holds = None
        page.send(t="release")
        page.send(t="release")
        settle(page)
        assert commands.is_put_to_rest()


def test_a_page_that_falls_silent_while_it_drives_is_taken_to_have_let_go(served: Site) -> None:
    with served.page() as page:
        page.make_ready()
        page.drive()
        commands = CommandRecorder(served, page)
        page.holds = None
        why = page.until(lambda: page.last("released"))["why"]
        # The order depends on the age of the status echoed by the last command.
        assert why["code"] in ("page_stalled", "mode_only")
        page.until(lambda: page.mode == "ready")
        assert commands.is_put_to_rest()


def test_after_that_it_drives_again_only_when_its_controls_have_been_centred(served: Site) -> None:
    with served.page() as page:
        page.make_ready()
        page.drive()
        page.holds = None
        page.until(lambda: page.last("released"))
        page.until(lambda: page.mode == "ready")
        commands = CommandRecorder(served, page)
        page.holds = {"vx": 0.2, "vy": 0.0, "omega": 0.0}
        settle(page)
        # A zero may be repeated until acknowledged; no other command is sent.
        assert not any(command.twist.any() for command in commands.take())
        assert page.mode == "ready"
        page.send(t="release")
        page.drive()


def test_a_page_that_is_no_longer_in_front_lets_go(served: Site) -> None:
    with served.page() as page:
        page.make_ready()
        page.drive()
        page.focus = False
        why = page.until(lambda: page.last("released"))["why"]
        assert why["code"] == "page_not_in_front"
        page.until(lambda: page.mode == "ready")


def test_a_socket_that_is_closed_puts_the_robot_at_rest_and_gives_control_back(
    served: Site,
) -> None:
    with served.page(OTHER) as witness:
        with served.page() as page:
            page.make_ready()
            page.drive()
            commands = CommandRecorder(served, page)
        witness.until(lambda: witness.state["status"]["lease"]["holder"] is None)
        witness.until(lambda: witness.mode == "ready")
        assert commands.is_put_to_rest()


def test_a_page_without_a_beat_loses_control(served: Site) -> None:
    with served.page() as page, served.page(OTHER) as witness:
        page.make_ready()
        page.beats = False
        witness.until(lambda: witness.state["status"]["lease"]["holder"] == page.operator)
        witness.until(lambda: witness.state["status"]["lease"]["holder"] is None)
        page.beats = True
        page.until(lambda: not page.state["has_control"])


def test_control_is_kept_for_as_long_as_the_page_beats(served: Site) -> None:
    with served.page() as page:
        page.until(lambda: page.state)
        assert page.take()["ok"]
        page.until(lambda: page.state["has_control"])
        count = len(page.all("state"))
        page.until(lambda: len(page.all("state")) > count + 60)  # Longer than a lease (2 s).
        assert all(state["has_control"] for state in page.all("state")[count:])


def test_another_gets_control_by_taking_over_only_and_the_holder_is_told(served: Site) -> None:
    with served.page() as page, served.page(OTHER) as other:
        page.make_ready()
        page.drive()
        other.until(lambda: other.state)
        refusal = other.take()
        assert not refusal["ok"]
        assert page.operator == refusal["why"]["params"]["holder"]
        assert other.take(take_over=True)["ok"]
        page.until(lambda: not page.state["has_control"])
        page.until(lambda: page.last("event")["why"]["code"] == "control_is_lost")
        other.until(lambda: other.state["has_control"])
        commands = CommandRecorder(served, page)
        settle(page)
        assert commands.take() == []


def test_a_control_that_is_held_while_the_robot_arms_does_not_set_it_off(served: Site) -> None:
    with served.page() as page:
        page.make_ready()
        assert page.answer("disarm", t="disarm")["ok"]
        page.until(lambda: page.mode == "disarmed")
        page.holds = {"vx": 0.2, "vy": 0.0, "omega": 0.0}
        page.until(lambda: page.last("released"))
        assert page.answer("arm", t="arm")["ok"]
        page.until(lambda: page.mode == "ready")
        settle(page)
        assert page.mode == "ready"


def test_the_end_of_the_gateway_lets_go_of_the_robot_and_of_control() -> None:
    with site() as ending, ending.page() as page:
        page.make_ready()
        page.drive()
        commands = CommandRecorder(ending, page)
        ending.run(ending.gateway.stop())
        assert page.until(lambda: page.closed) == 1001
        assert commands.is_put_to_rest()
        done = threading.Event()
        while ending.link.snapshot.status is not None and not done.wait(0.01):
            lease = ending.link.snapshot.status.lease
            if lease.holder is None and ending.link.snapshot.status.mode == "ready":
                done.set()


def test_control_that_is_asked_for_anew_is_let_go_of_first(served: Site) -> None:
    with served.page() as page:
        page.make_ready()
        before = len(page.all("released"))
        commands = CommandRecorder(served, page)
        page.drive()
        assert page.take()["ok"]
        page.until(lambda: page.all("released")[before:])
        page.until(lambda: page.mode == "ready")
        settle(page)  # The stick is still held.
        assert commands.is_put_to_rest()
