"""A stream delivers everything in order, with the delays of TCP."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tests.link_emulation.link_runs import ROUNDING_S, Sent, journeys, link, paced, specs, travel
from tsd_twin.link_emulation import LinkSpec, Stall
from tsd_twin.link_emulation.link import MAX_TIMEOUT_S, LinkModel, Segment, Stream


class Connection:
    """A stream over a separate link, in virtual time."""

    def __init__(self, spec: LinkSpec) -> None:
        self.link: LinkModel[Segment[Sent]] = LinkModel(spec, np.random.default_rng(spec.seed), 0.0)
        self.released: list[tuple[Sent, float]] = []
        self.lost_at_first: set[int] = set()
        self._now_s = 0.0
        self.stream: Stream[Sent] = Stream(
            self.link, lambda payload: self.released.append((payload, self._now_s))
        )

    def due_s(self) -> float | None:
        times_s = (self.link.next_s(), self.stream.next_s())
        return min((time_s for time_s in times_s if time_s is not None), default=None)

    def run_until(self, until_s: float) -> None:
        while (due_s := self.due_s()) is not None and due_s <= until_s:
            self._now_s = max(self._now_s, due_s)
            self.stream.retransmit(self._now_s)
            for segment in self.link.receive(self._now_s):
                segment.stream.arrived(segment)
        self._now_s = until_s

    def send(self, packet: Sent) -> None:
        self.run_until(packet.at_s)
        lost_before = self.link.counters.lost
        self.stream.send(packet, packet.size_bytes, packet.at_s)
        if self.link.counters.lost > lost_before:
            self.lost_at_first.add(packet.number)

    def cut(self) -> None:
        for segment in self.link.cut():
            segment.stream.lost(segment)


def carried(spec: LinkSpec, packets: list[Sent]) -> Connection:
    connection = Connection(spec)
    for packet in packets:
        connection.send(packet)
    connection.run_until(1e9)
    return connection


@given(specs(), journeys())
def test_everything_arrives_once_and_in_order_and_nothing_waits_at_the_end(
    spec: LinkSpec, packets: list[Sent]
) -> None:
    connection = carried(spec, packets)
    assert [packet for packet, _ in connection.released] == packets
    assert connection.stream.waiting_bytes == 0
    assert connection.due_s() is None


# The sum of running time and stalls rounds to a time just before the second was sent.
ROUNDED_DOWN = (
    LinkSpec(stall=Stall(length_s=0.7722291142775198, period_s=1.0222291142775197)),
    [Sent(0, 1, 1.0), Sent(1, 1, 1.968368858284362)],
)


@example(*ROUNDED_DOWN)
@given(specs(loss=0.0), journeys())
def test_without_loss_a_payload_waits_for_its_own_segment_and_those_before(
    spec: LinkSpec, packets: list[Sent]
) -> None:
    alone_s = {packet.number: at_s for packet, at_s in travel(link(spec), packets)}
    expected_s = list(itertools.accumulate((alone_s[p.number] for p in packets), max))
    assert [at_s for _, at_s in carried(spec, packets).released] == expected_s


@given(specs(), journeys())
def test_a_lost_segment_costs_a_time_out_at_least(spec: LinkSpec, packets: list[Sent]) -> None:
    timeout_s = max(0.2, 4.0 * (spec.delay_s + spec.jitter_s))
    connection = carried(spec, packets)
    for packet, at_s in connection.released:
        late_s = timeout_s if packet.number in connection.lost_at_first else 0.0
        assert at_s >= packet.at_s + late_s + spec.delay_s - ROUNDING_S


@pytest.mark.parametrize(
    ("spec", "timeout_s"),
    [
        (LinkSpec(), 0.2),
        (LinkSpec(delay_s=0.05), 0.2),
        (LinkSpec(delay_s=0.15), 0.6),
        (LinkSpec(delay_s=0.1, jitter_s=0.05), 0.6),
        (LinkSpec(delay_s=300.0), MAX_TIMEOUT_S),
    ],
)
def test_the_time_out_is_twice_the_round_trip_and_no_less_than_0_2_s(
    spec: LinkSpec, timeout_s: float
) -> None:
    connection = Connection(spec)
    connection.link.cut()
    connection.send(Sent(0, 100, 0.0))
    assert connection.stream.next_s() == pytest.approx(timeout_s)


def test_a_lost_segment_holds_up_all_behind_it_and_then_all_are_there_at_once() -> None:
    connection = Connection(LinkSpec(delay_s=0.02))
    first, second, *rest = paced(8, 0.02)
    connection.send(first)
    connection.run_until(second.at_s)
    connection.link.cut()
    connection.send(second)
    connection.link.restore()
    for packet in rest:
        connection.send(packet)
    connection.run_until(10.0)
    assert [packet.number for packet, _ in connection.released] == list(range(8))
    assert connection.released[0][1] == pytest.approx(0.02)
    for _, at_s in connection.released[1:]:
        assert at_s == pytest.approx(second.at_s + 0.2 + 0.02)


@pytest.mark.parametrize("cut_s", [0.1, 0.3, 1.0, 2.0, 5.0, 20.0, 2000.0])
@pytest.mark.parametrize("delay_s", [0.0, 0.02, 0.15])
def test_after_a_cut_all_arrives_with_the_first_time_out_that_ends_after_it(
    cut_s: float, delay_s: float
) -> None:
    timeout_s = max(0.2, 4.0 * delay_s)
    tries_s, wait_s = timeout_s, timeout_s
    while tries_s < cut_s:  # Timeouts double up to the maximum.
        wait_s = min(MAX_TIMEOUT_S, 2.0 * wait_s)
        tries_s += wait_s
    connection = Connection(LinkSpec(delay_s=delay_s))
    connection.link.cut()
    lost = [Sent(number, 100, 0.02 * number) for number in range(int(cut_s / 0.02))][:500]
    for packet in lost:
        connection.send(packet)
    connection.run_until(cut_s)
    assert connection.released == []
    connection.link.restore()
    connection.run_until(cut_s + 1000.0)
    assert [packet.number for packet, _ in connection.released] == [p.number for p in lost]
    overdue = [at_s for packet, at_s in connection.released if packet.at_s + timeout_s <= tries_s]
    assert overdue[0] == pytest.approx(tries_s + delay_s)
    assert overdue[-1] == pytest.approx(tries_s + delay_s)
    # The remainder is resent after its own timeout, when the earlier data has arrived.
    for packet, at_s in connection.released[len(overdue) :]:
        due_s = max(tries_s, packet.at_s + timeout_s)
        assert due_s + delay_s - ROUNDING_S <= at_s <= due_s + 2.0 * delay_s + ROUNDING_S


def test_what_was_on_its_way_when_the_link_was_cut_arrives_too() -> None:
    connection = Connection(LinkSpec(delay_s=1.0))
    connection.send(Sent(0, 100, 0.0))
    connection.run_until(0.5)
    connection.cut()
    connection.link.restore()
    connection.run_until(100.0)
    assert connection.released == [(Sent(0, 100, 0.0), pytest.approx(4.0 + 1.0))]


def test_progress_takes_the_time_out_back_to_the_first() -> None:
    connection = Connection(LinkSpec())
    connection.link.cut()
    connection.send(Sent(0, 100, 0.0))
    connection.run_until(2.0)
    connection.link.restore()
    connection.run_until(10.0)
    assert len(connection.released) == 1
    connection.link.cut()
    connection.send(Sent(1, 100, 10.0))
    connection.link.restore()
    connection.run_until(20.0)
    assert connection.released[1][1] == pytest.approx(10.2)


@given(st.lists(st.integers(1, 1500), max_size=20))
def test_what_waits_is_counted_in_bytes(sizes: list[int]) -> None:
    connection = Connection(LinkSpec(delay_s=1.0))
    for number, size_bytes in enumerate(sizes):
        connection.send(Sent(number, size_bytes, 0.0))
    assert connection.stream.waiting_bytes == sum(sizes)
    connection.run_until(2.0)
    assert connection.stream.waiting_bytes == 0


def test_streams_on_one_link_share_its_bandwidth_and_not_their_losses() -> None:
    shared: LinkModel[Segment[int]] = LinkModel(
        LinkSpec(bandwidth_bit_per_s=8000.0), np.random.default_rng(0), 0.0
    )
    released: list[tuple[str, int]] = []
    one = Stream(shared, lambda payload: released.append(("one", payload)))
    other = Stream(shared, lambda payload: released.append(("other", payload)))
    shared.cut()
    one.send(0, 100, 0.0)
    shared.restore()
    one.send(1, 100, 0.0)
    other.send(0, 100, 0.0)
    assert shared.next_s() == pytest.approx(0.1)
    for segment in shared.receive(0.15):
        segment.stream.arrived(segment)
    assert released == []  # The second part of `one` has arrived, and waits for the first.
    for segment in shared.receive(0.2):
        segment.stream.arrived(segment)
    assert released == [("other", 0)]
