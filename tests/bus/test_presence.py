"""Liveliness tokens: present peers, arrivals and departures."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from tests.support.robot_node import ANY_PORT, Mailbox, matched
from tests.support.withheld import PATIENCE_S
from tsd_twin.bus import Bus, client_config, node_config
from tsd_twin.messages.topics import QoS

KEY = "twin/r1/state/odom"


def test_who_lives_is_known_until_the_session_ends(robot: Bus, connect: Callable[[], Bus]) -> None:
    """A client of the first robot also sees a second robot, whose node joined the first node."""
    box, late = Mailbox(), Mailbox()
    connect().subscribe_liveliness("twin/*/alive", box)
    other = Bus(node_config([ANY_PORT], robot.endpoints()))
    other.declare_token("twin/r2/alive")  # No reference is kept, and the token remains.
    assert box.next() == ("twin/r2/alive", True)
    assert robot.living_tokens("twin/*/alive") == ["twin/r2/alive"]
    connect().subscribe_liveliness("twin/*/alive", late)
    assert late.next() == ("twin/r2/alive", True)
    other.close()
    assert box.next() == ("twin/r2/alive", False)
    assert robot.living_tokens("twin/*/alive") == []


def test_a_token_can_be_taken_back(robot: Bus, connect: Callable[[], Bus]) -> None:
    box = Mailbox()
    connect().subscribe_liveliness("twin/*/alive", box)
    token = robot.declare_token("twin/r1/alive")
    assert box.next() == ("twin/r1/alive", True)
    token.close()
    assert box.next() == ("twin/r1/alive", False)


def test_a_router_that_joins_another_hears_of_those_who_live_there(robot: Bus) -> None:
    """Two robots on two machines: the second must see the first before it takes the same id."""
    robot.declare_token("twin/r1/alive")
    with Bus(node_config([ANY_PORT], robot.endpoints())) as other:
        assert other.living_tokens("twin/r1/alive", PATIENCE_S) == ["twin/r1/alive"]


MANY = 400
"""More than 256, the default queue size of a Zenoh query."""


def test_many_that_live_on_one_router_are_all_found_by_it_and_by_others(
    robot: Bus, connect: Callable[[], Bus]
) -> None:
    keys = {f"twin/t{i}/alive" for i in range(MANY)}
    for key in keys:
        robot.declare_token(key)
    found: list[str] = []
    # A daemon, because the tested defect is that this never returns.
    asking = threading.Thread(
        target=lambda: found.extend(robot.living_tokens("twin/*/alive")), daemon=True
    )
    asking.start()
    asking.join(PATIENCE_S)
    assert not asking.is_alive()
    assert set(found) == keys
    box = Mailbox()
    client = connect()
    client.subscribe_liveliness("twin/*/alive", box)
    assert {box.next() for _ in keys} == {(key, True) for key in keys}
    # A session that has just joined may receive only the first tokens.
    end_s = time.monotonic() + PATIENCE_S
    while set(client.living_tokens("twin/*/alive")) != keys:
        assert time.monotonic() < end_s


def test_nobody_lives_where_nobody_is(robot: Bus) -> None:
    assert robot.living_tokens("twin/*/alive") == []


def test_a_client_finds_a_robot_that_comes_later() -> None:
    with Bus(node_config([ANY_PORT])) as first:
        (endpoint,) = first.endpoints()
    with Bus(client_config([endpoint])) as client:
        assert not client.wait_for_peer(0.3)  # It has tried and was refused.
        box = Mailbox()
        client.subscribe(KEY, box)
        with Bus(node_config([endpoint])) as robot:
            assert client.wait_for_peer(PATIENCE_S)
            matched(robot.publisher(KEY, QoS.DATA)).put(b"here")
            assert box.next().payload == b"here"


def test_a_client_finds_a_robot_that_comes_back() -> None:
    box = Mailbox()
    with Bus(node_config([ANY_PORT])) as first:
        (endpoint,) = first.endpoints()
        client = Bus(client_config([endpoint]))
        client.subscribe(KEY, box)
        matched(first.publisher(KEY, QoS.DATA)).put(b"before")
        assert box.next().payload == b"before"
    with client, Bus(node_config([endpoint])) as again:
        matched(again.publisher(KEY, QoS.DATA)).put(b"after")
        assert box.next().payload == b"after"
