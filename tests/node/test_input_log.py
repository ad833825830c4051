"""Input log of a node: from its start or a recorder's arrival, and off without a recorder."""

from __future__ import annotations

import itertools
from collections.abc import Generator

import pytest

from tests.support.robot_node import ANY_PORT, QUICK, Mailbox, RunningNode, running
from tests.support.withheld import WithheldTime
from tsd_twin import robots
from tsd_twin.bus import Bus, client_config, node_config
from tsd_twin.control import LoggedController
from tsd_twin.control.logged_controller import InputBatch, StepCall, decode_batch
from tsd_twin.messages import topics
from tsd_twin.node.input_log import InputLogPublisher
from tsd_twin.recording.rerun import Rerun, stretches

KEY = topics.INPUTS.key("tsd")


def batches(box: Mailbox, count: int) -> list[InputBatch]:
    return [decode_batch(box.next().payload) for _ in range(count)]


def test_a_recorder_that_comes_soon_has_all_from_the_first_period() -> None:
    with running() as node, node.client() as client:
        box = Mailbox()
        client.subscribe(KEY, box)
        found = batches(box, 8)
    assert found[0].first == 0
    (stretch,) = stretches(found)
    result = Rerun(stretch, node.toml).run()
    assert result.difference is None
    assert len(result.t_s) == 8 * 20


class Hand:
    """A manually driven log publisher."""

    def __init__(self, bus: Bus) -> None:
        self.controller = LoggedController(robots.parse_description(QUICK, "tsd"), bytes)
        self.publisher = InputLogPublisher(bus, "tsd", self.controller)
        self._times = itertools.count()

    def run(self, batches: int) -> None:
        for _ in range(20 * batches):
            self.controller.step(0.01 * next(self._times), None, ())
            self.publisher.step()


@pytest.fixture
def hand() -> Generator[tuple[Hand, str]]:
    with Bus(node_config([ANY_PORT])) as bus:
        yield Hand(bus), bus.endpoints()[0]


def test_without_a_recorder_nothing_is_logged_after_ten_seconds(hand: tuple[Hand, str]) -> None:
    node, _ = hand
    node.run(50)
    assert node.controller.logs
    node.run(1)
    assert not node.controller.logs
    node.run(50)
    assert node.controller.take_log().calls == []


def test_a_recorder_that_comes_late_begins_with_a_state_and_gets_one_again(
    hand: tuple[Hand, str],
) -> None:
    node, endpoint = hand
    node.run(60)
    with Bus(client_config([endpoint])) as client:
        box = Mailbox()
        client.subscribe(KEY, box)
        while not node.controller.logs:
            node.run(1)
        found: list[InputBatch] = []
        for _ in range(320):  # One by one, because a log drops entries when rushed.
            node.run(1)
            found += batches(box, 1)
    assert found[0].first > 0
    states = [number for number, batch in enumerate(found) if batch.snapshot is not None]
    assert states[0] == 0
    assert set(states[2:]) - {states[1] + 150} == set()
    (stretch,) = stretches(found)
    assert all(sum(isinstance(call, StepCall) for call in batch.calls) == 20 for batch in stretch)
    assert Rerun(stretch, QUICK).run().difference is None


def test_a_log_that_fails_ends_and_the_robot_goes_on(
    hand: tuple[Hand, str], caplog: pytest.LogCaptureFixture
) -> None:
    node, endpoint = hand
    node.run(60)
    node.controller.__dict__["no_state"] = lambda: None  # No snapshot can hold this.
    with Bus(client_config([endpoint])) as client:
        client.subscribe(KEY, Mailbox())
        while "logged no longer" not in caplog.text:
            node.run(1)
        node.run(200)
    assert not node.controller.logs
    assert len(caplog.records) == 1


def test_a_node_with_a_recorder_keeps_its_rate(node: RunningNode) -> None:
    """A state takes 2 ms of a period, twice a minute."""
    with node.client() as client, WithheldTime() as withheld:
        box, statuses = Mailbox(), Mailbox()
        client.subscribe(KEY, box)
        client.subscribe(topics.STATUS.key("tsd"), statuses)
        found = batches(box, 10)
    steps = [call for batch in found for call in batch.calls if isinstance(call, StepCall)]
    gaps_s = [b.now_s - a.now_s for a, b in itertools.pairwise(steps)]
    # Half of them are as late as the median, or later.
    late_s = withheld.total_s / (len(gaps_s) // 2)
    assert 0.008 < sorted(gaps_s)[len(gaps_s) // 2] < 0.012 + late_s
