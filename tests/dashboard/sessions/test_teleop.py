"""Messages between page and gateway over real sockets, a real bus and a real node."""

from __future__ import annotations

import json
from collections.abc import Generator
from typing import Any

import pytest

from tests.dashboard.recorders import CommandRecorder, settle
from tests.support.page_client import Page, Site, site
from tsd_twin.dashboard.sessions.send_queue import MAX_UNACKNOWLEDGED
from tsd_twin.messages.events import Event

OTHER = "fedcba9876543210"


@pytest.fixture(scope="module")
def served() -> Generator[Site]:
    with site() as made:
        yield made


def test_a_page_learns_who_it_is_which_robots_there_are_and_how_its_robot_is(served: Site) -> None:
    with served.page() as page:
        page.until(lambda: page.state)
        welcome, robot = page.last("welcome"), page.last("robot")
        assert welcome["operator"] == "web-01234567"
        assert welcome["robots"] == [
            {"id": "tsd", "title": "Triple singularity drive", "colour": "#1f9ce6"}
        ]
        assert welcome["robot"] == "tsd" == robot["id"]
        assert robot["modules"] == ["module1", "module2", "module3"]
        assert robot["max_speed_mps"] == 1.0
        page.until(lambda: len(page.all("state")) >= 5)
        numbers = [state["status_seq"] for state in page.all("state")]
        assert numbers == sorted(set(numbers))
        assert len(page.state["modules"]) == 3
        assert page.state["truth"] is not None


def test_no_state_arrives_twice_also_when_robots_change_and_the_loop_is_late(served: Site) -> None:
    with served.page() as page:
        for _ in range(20):
            count = len(page.all("robot"))
            served.sessions.on_robots_changed()
            served.repeat_status()
            page.until(lambda count=count: len(page.all("robot")) > count)
        numbers = [state["status_seq"] for state in page.all("state")]
        assert numbers == sorted(set(numbers))


def test_the_round_trip_to_the_robot_is_measured(served: Site) -> None:
    with served.page() as page:
        assert 0.0 < page.until(lambda: page.state["rtt_ms"]) < 1000.0


def test_a_beat_comes_back(served: Site) -> None:
    with served.page() as page:
        page.beats = False
        page.send(t="heartbeat", status_seq=0, sent_ms=1234.5, focus=True)
        page.until(lambda: page.last("heartbeat")["sent_ms"] == 1234.5)


def test_anybody_may_stop_and_it_takes_a_reset_and_arming_to_go_on(served: Site) -> None:
    with served.page() as page, served.page(OTHER) as bystander:
        page.make_ready()
        page.drive()
        assert bystander.answer("stop", t="stop")["ok"]
        page.until(lambda: page.mode == "stopped")
        assert page.state["status"]["stop"]["params"]["by"] == bystander.operator
        page.until(lambda: page.last("released"))
        settle(page)
        assert page.mode == "stopped"
        page.holds = None
        page.send(t="release")
        assert not page.answer("arm", t="arm")["ok"]
        page.make_ready()


def test_stops_that_come_in_a_flood_are_all_heard_and_answered(served: Site) -> None:
    with served.page() as page:
        page.until(lambda: page.state)
        for _ in range(200):
            page.send(t="stop")
        page.until(lambda: page.mode == "stopped")
        settle(page)
        answers = [reply for reply in page.all("reply") if reply["to"] == "stop"]
        assert answers
        assert all(reply["ok"] for reply in answers)


@pytest.mark.parametrize(
    "garbage",
    [
        "",
        "{",
        "[]",
        "null",
        '{"t": "fly"}',
        '{"t": "drive"}',
        '{"t": "drive", "vx": NaN, "vy": 0, "omega": 0, "status_seq": 1}',
        '{"t": "drive", "vx": 1e999, "vy": 0, "omega": 0, "status_seq": 1}',
        '{"t": "drive", "vx": "1", "vy": 0, "omega": 0, "status_seq": 1}',
        '{"t": "drive", "vx": 1, "vy": 0, "omega": 0, "status_seq": -1}',
        '{"t": "drive", "vx": 1, "vy": 0, "omega": 0, "status_seq": 18446744073709551616}',
        '{"t": "drive", "vx": 1, "vy": 0, "omega": 0, "status_seq": 1, "frame": "map"}',
        '{"t": "lease", "op": "steal"}',
        '{"t": "robot", "id": 5}',
        "\x00\ud7ff",
        b"\x00\xff",
        "[" * 8000,
        '{"t": "drive", "a": ' + '{"a": ' * 2000,
    ],
)
def test_what_is_no_message_is_counted_and_answered_once(
    served: Site, garbage: str | bytes
) -> None:
    with served.page() as page:
        page.make_ready()
        commands = CommandRecorder(served, page)
        before = served.sessions.rejected
        times = 50 if len(garbage) < 1000 else 10  # More bytes would count as a flood.
        for _ in range(times):
            page.send_raw(garbage)
        page.until(lambda: served.sessions.rejected == before + times)
        settle(page)
        assert [reply["to"] for reply in page.all("reply")].count("message") == 1
        assert commands.take() == []
        assert page.closed is None
        page.drive()  # Driving still works.


def test_a_message_of_unreasonable_length_closes_the_socket(served: Site) -> None:
    with served.page() as page:
        page.until(lambda: page.state)
        page.send_raw(json.dumps({"t": "robot", "id": "x" * 100_000}))
        assert page.until(lambda: page.closed) == 1009


def test_an_unknown_robot_is_refused(served: Site) -> None:
    with served.page() as page:
        page.until(lambda: page.state)
        refusal = page.answer("robot", t="robot", id="nobody")
        assert refusal["why"] == {"code": "unknown_robot", "params": {"robot": "nobody"}}


def test_a_page_that_comes_back_takes_the_place_of_its_lost_socket(served: Site) -> None:
    with served.page() as lost:
        lost.make_ready()
        with served.page() as back:
            back.until(lambda: back.state)
            assert lost.until(lambda: lost.closed) == 1001
            back.until(lambda: back.state["status"]["lease"]["holder"] is None)
            assert not back.state["has_control"]


def test_a_page_that_does_not_say_what_it_has_seen_gets_a_handful_of_states_only(
    served: Site,
) -> None:
    with served.page(OTHER) as witness, served.page(acknowledge=False) as page:
        page.until(lambda: page.state)
        count = len(witness.all("state"))
        witness.until(lambda: len(witness.all("state")) > count + 2 * MAX_UNACKNOWLEDGED)
        assert len(page.all("state")) == MAX_UNACKNOWLEDGED


def test_events_reach_those_who_watch_and_those_who_come_later(served: Site) -> None:
    def told(page: Page) -> Any:
        rain = {"code": "text", "params": {"text": "It rains."}}
        return next((event for event in page.all("event") if event["why"] == rain), None)

    with served.page() as page:
        page.until(lambda: page.state)
        served.tell("tsd", Event("test", "It rains.", robot_s=1.5))
        event = page.until(lambda: told(page))
        assert event == {
            "t": "event",
            "kind": "test",
            "why": {"code": "text", "params": {"text": "It rains."}},
            "past": False,
            "age_s": 0.0,
        }
    with served.page() as page:
        event = page.until(lambda: told(page))
        assert event["past"] is True
        assert 0.0 < event["age_s"] < 60.0
