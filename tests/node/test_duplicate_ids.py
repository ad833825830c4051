"""Two robots with the same id that meet after starting; and queries to patterns."""

from __future__ import annotations

import json
from collections.abc import Generator

import numpy as np
import pytest

from tests.support.bus_operator import BusOperator
from tests.support.robot_node import ANY_PORT, RunningNode, matched, running
from tests.support.withheld import PATIENCE_S
from tsd_twin.bus import Bus, node_config
from tsd_twin.errors import SeveralAnswersError
from tsd_twin.messages import topics
from tsd_twin.messages.topics import QoS, Service

WORDS = "another robot with the id 'tsd' is on the bus: end one, or choose another id"
MET, PARTED = f"{WORDS.capitalize()}.", "No other robot has the id 'tsd' any more."
PATTERNS = ("**", "twin/**", "twin/*/stop", "twin/tsd/*", "twin/t$*/stop", "twin/tsd/srv/*")


@pytest.fixture
def two() -> Generator[tuple[RunningNode, RunningNode]]:
    """Two robots on separate networks."""
    with running() as first, running() as second:
        yield first, second


def join(*nodes: RunningNode) -> Bus:
    """Return the router that joins the networks."""
    return Bus(node_config([ANY_PORT], [node.endpoint for node in nodes]))


def test_two_robots_with_one_id_that_meet_both_stop_and_say_why(
    two: tuple[RunningNode, RunningNode],
) -> None:
    with BusOperator(two[0], "alice") as alice, BusOperator(two[1], "bob") as bob:
        bob.get_ready()
        alice.get_ready()
        alice.drive((1.0, 0.0, 0.0), until=lambda: alice.truth.twist[0] > 0.9)
        with join(*two):
            for pilot in (alice, bob):
                pilot.wait_for("fault")
                pilot.wait_until(lambda pilot=pilot: MET in pilot.texts)
                assert pilot.status.stop_reason == WORDS
            # From here on both receive each request, and a client accepts neither reply.
            key, request = Service.ARM.key("tsd"), json.dumps({"lease": alice.lease}).encode()
            answers = alice.bus.query_all(key, request, PATIENCE_S)
            assert [json.loads(answer)["ok"] for answer in answers] == [False, False]
            with pytest.raises(SeveralAnswersError):
                alice.bus.query(key, request, PATIENCE_S)
        for pilot in (alice, bob):
            pilot.wait_until(lambda pilot=pilot: PARTED in pilot.texts)
            assert pilot.status.mode == "fault"  # Latched until its operator resets it.
        alice.wait_until(lambda: np.abs(alice.truth.twist).max() < 1e-3)


def test_a_robot_that_stands_is_not_armed_while_another_has_its_id(
    two: tuple[RunningNode, RunningNode],
) -> None:
    with BusOperator(two[0], "alice") as alice:
        assert alice.acquire()["granted"]
        token = two[0].bus.declare_token(topics.instance_key("tsd", "0123456789abcdef"))
        alice.wait_until(lambda: MET in alice.texts)
        refused = alice.ask(Service.ARM, lease=alice.lease)
        assert (refused["ok"], refused["why"]["code"]) == (False, "duplicate_id")
        assert alice.status.mode == "disarmed"
        token.close()
        alice.wait_until(lambda: PARTED in alice.texts)
        assert alice.ask(Service.ARM, lease=alice.lease)["ok"]
        assert [alice.texts.count(text) for text in (MET, PARTED)] == [1, 1]


def test_a_node_is_no_namesake_of_itself_nor_of_others(node: RunningNode) -> None:
    with running("tsd-2"), Bus(node_config([ANY_PORT], [node.endpoint])) as other:
        other.declare_token(topics.instance_key("tsd-2", "0123456789abcdef"))
        assert len(other.living_tokens(topics.instance_key("tsd", "*"), PATIENCE_S)) == 1
        with BusOperator(node) as alice:
            alice.get_ready()
            assert MET not in alice.texts


def test_exploring_the_bus_with_queries_has_no_effect(
    node: RunningNode, pilot: BusOperator
) -> None:
    pilot.get_ready()
    lease = f'{{"lease": "{pilot.lease}", "op": "release", "operator": "alice"}}'.encode()
    with node.raw_client() as eve:
        for pattern in PATTERNS:
            for payload in (b"", lease):
                replies = eve.get(pattern, payload=payload, timeout=PATIENCE_S)
                answered = {str(reply.ok.key_expr) for reply in replies if reply.ok}
                assert answered <= {"twin/tsd/desc"} | {k for k in answered if "/event/" in k}
    pilot.wait_for_news()
    assert (pilot.status.mode, pilot.status.lease.holder) == ("ready", "alice")


def test_a_put_on_a_pattern_that_has_the_stop_in_it_stops(
    node: RunningNode, pilot: BusOperator
) -> None:
    """A put is not exploration: a stop to all robots is intended."""
    pilot.get_ready()
    with node.client() as eve:
        matched(eve.publisher("twin/*/stop", QoS.REAL_TIME)).put(b'{"reason": "fire"}')
        pilot.wait_for("stopped")
    assert pilot.status.stop_reason == "fire"
