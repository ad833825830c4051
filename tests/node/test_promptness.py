"""A robot node accepts every command and answers each request within one period."""

from __future__ import annotations

import time

from tests.support.bus_operator import BusOperator
from tests.support.robot_node import RunningNode
from tests.support.withheld import WithheldTime
from tsd_twin.messages.topics import Service
from tsd_twin.node.robot_node import PERIOD_S

COMMANDS = 10
REQUESTS = 20
TRANSPORT_S = 0.004
"""Upper bound for a request and its reply on a local bus."""


def test_every_command_counts_including_the_first(node: RunningNode) -> None:
    with BusOperator(node) as pilot:
        assert pilot.acquire()["granted"]
        before = pilot.status.command
        for count in range(1, 1 + COMMANDS):
            pilot.send((0.0, 0.0, 0.0))
            # Only the latest command in a period counts.
            accepted = before.accepted + count
            pilot.wait_until(lambda number=accepted: pilot.status.command.accepted >= number)
        pilot.wait_for_news()
        command = pilot.status.command
    assert command.accepted - before.accepted == COMMANDS
    assert command.dropped == before.dropped


def test_a_request_is_answered_within_one_period(node: RunningNode) -> None:
    late_s: list[float] = []
    with BusOperator(node) as pilot:
        assert pilot.acquire()["granted"]
        for count in range(REQUESTS):
            time.sleep(PERIOD_S * (1.0 + count / REQUESTS))  # At each phase of a period.
            with WithheldTime() as withheld:
                began_s = time.monotonic()
                renewed = pilot.ask(Service.LEASE, op="renew", operator="alice", lease=pilot.lease)
                took_s = time.monotonic() - began_s
            assert renewed["granted"]
            late_s.append(took_s - PERIOD_S - withheld.total_s)
    assert max(late_s) < TRANSPORT_S
