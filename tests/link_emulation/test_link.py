"""A link treats packets as specified, for any traffic."""

from __future__ import annotations

import dataclasses
import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.link_emulation.link_runs import (
    ROUNDING_S,
    Sent,
    bandwidths,
    delays_s,
    journeys,
    link,
    paced,
    specs,
    stalls,
    travel,
)
from tsd_twin.link_emulation import LinkSpec, Stall, Wander
from tsd_twin.link_emulation.link import DETOUR_S


@given(specs(), journeys())
def test_each_packet_arrives_once_or_is_lost(spec: LinkSpec, packets: list[Sent]) -> None:
    tried = link(spec)
    numbers = [packet.number for packet, _ in travel(tried, packets)]
    assert len(set(numbers)) == len(numbers)
    counters = tried.counters
    assert counters.packets == len(packets)
    assert counters.delivered == len(numbers)
    assert counters.lost == len(packets) - len(numbers)


@given(specs(loss=0.0), journeys())
def test_without_loss_nothing_is_lost_whatever_else_happens(
    spec: LinkSpec, packets: list[Sent]
) -> None:
    assert len(travel(link(spec), packets)) == len(packets)


@given(specs(), journeys())
def test_no_packet_is_faster_than_the_delay(spec: LinkSpec, packets: list[Sent]) -> None:
    for packet, at_s in travel(link(spec), packets):
        assert at_s - packet.at_s >= spec.delay_s - ROUNDING_S


@given(specs(reorder=0.0), journeys())
def test_order_is_kept_without_reordering(spec: LinkSpec, packets: list[Sent]) -> None:
    numbers = [packet.number for packet, _ in travel(link(spec), packets)]
    assert numbers == sorted(numbers)


@given(specs(), journeys())
def test_no_span_of_time_sees_more_than_the_bandwidth(spec: LinkSpec, packets: list[Sent]) -> None:
    arrived = travel(link(spec), packets)
    until = list(itertools.accumulate((packet.size_bytes for packet, _ in arrived), initial=0))
    for first, last in itertools.combinations(range(len(arrived)), 2):
        bits = 8.0 * (until[last + 1] - until[first + 1])  # Bits of all packets after the first.
        span_s = arrived[last][1] - arrived[first][1]
        assert bits / spec.bandwidth_bit_per_s <= span_s + ROUNDING_S


@given(delays_s, stalls, journeys(), st.floats(-1e5, 1e5))
def test_a_stall_delivers_nothing_while_it_lasts_and_everything_after(
    delay_s: float, stall: Stall, packets: list[Sent], start_s: float
) -> None:
    tried = link(LinkSpec(delay_s=delay_s, stall=stall), start_s)
    arrived = travel(tried, [dataclasses.replace(p, at_s=start_s + p.at_s) for p in packets])
    assert len(arrived) == len(packets)
    for _, at_s in arrived:
        periods, into_s = divmod(at_s - start_s, stall.period_s)
        stalled = periods >= 1.0 and ROUNDING_S < into_s < stall.length_s - ROUNDING_S
        assert not stalled


@given(delays_s, bandwidths, journeys(), st.floats(0.0, 5.0), st.floats(0.01, 5.0))
def test_a_stall_at_will_shifts_what_is_on_its_way_by_its_length(
    delay_s: float, bandwidth: float, packets: list[Sent], from_s: float, length_s: float
) -> None:
    spec = LinkSpec(delay_s=delay_s, bandwidth_bit_per_s=bandwidth)
    before = [packet for packet in packets if packet.at_s < from_s]
    undisturbed, tried = link(spec), link(spec)
    for packet in before:
        undisturbed.send(packet, packet.size_bytes, packet.at_s)
        tried.send(packet, packet.size_bytes, packet.at_s)
    undisturbed.receive(from_s)
    tried.receive(from_s)
    tried.stall(length_s, from_s)
    assert tried.receive(from_s + 0.5 * length_s) == []
    for (packet, at_s), (same, later_s) in zip(
        travel(undisturbed, []), travel(tried, []), strict=True
    ):
        assert same == packet
        assert later_s == pytest.approx(at_s + length_s, abs=ROUNDING_S)


@pytest.mark.parametrize("loss", [0.0, 0.02, 0.3, 1.0])
@pytest.mark.parametrize("seed", range(3))
def test_the_share_that_is_lost_is_within_the_bounds_of_chance(loss: float, seed: int) -> None:
    count = 10_000
    tried = link(LinkSpec(loss=loss, seed=seed))
    travel(tried, paced(count, 0.01))
    deviation = math.sqrt(count * loss * (1.0 - loss))
    assert tried.counters.lost == pytest.approx(count * loss, abs=5.0 * deviation)


def test_losses_do_not_depend_on_each_other() -> None:
    """After a loss, the next packet has the usual loss probability."""
    count, loss = 20_000, 0.2
    arrived = {p.number for p, _ in travel(link(LinkSpec(loss=loss)), paced(count, 0.01))}
    pairs = sum(n not in arrived and n + 1 not in arrived for n in range(count - 1))
    assert pairs == pytest.approx(count * loss**2, abs=5.0 * math.sqrt(3.0 * count * loss**2))


@pytest.mark.parametrize("loss", [0.0, 0.5])
@pytest.mark.parametrize("jitter_s", [0.001, 0.03])
def test_jitter_has_the_standard_deviation_that_was_asked_for(jitter_s: float, loss: float) -> None:
    """The bounds are five standard errors, for an exponential distribution."""
    spec = LinkSpec(delay_s=0.15, jitter_s=jitter_s, loss=loss)
    arrived = travel(link(spec), paced(20_000, 10.0))
    extra_s = [at_s - packet.at_s - 0.15 for packet, at_s in arrived]
    count = len(arrived)
    mean_s = math.fsum(extra_s) / count
    deviation_s = math.sqrt(math.fsum((each - mean_s) ** 2 for each in extra_s) / count)
    assert mean_s == pytest.approx(jitter_s, rel=5.0 * math.sqrt(1.0 / count))
    assert deviation_s == pytest.approx(jitter_s, rel=5.0 * math.sqrt(2.0 / count))


@pytest.mark.parametrize("share", [0.05, 0.5])
def test_the_share_that_takes_the_detour_is_overtaken(share: float) -> None:
    count, gap_s = 10_000, 0.02
    arrived = travel(link(LinkSpec(delay_s=0.1, reorder=share)), paced(count, gap_s))
    detours = [packet for packet, at_s in arrived if at_s - packet.at_s > 0.1 + 0.5 * DETOUR_S]
    deviation = math.sqrt(count * share * (1.0 - share))
    assert len(detours) == pytest.approx(count * share, abs=5.0 * deviation)
    place = {packet.number: index for index, (packet, _) in enumerate(arrived)}
    on_detour = {packet.number for packet in detours}
    for number in range(count - 1):
        overtaken = place[number + 1] < place[number]
        assert overtaken is (number in on_detour and number + 1 not in on_detour)


@given(st.integers(1, 1500), st.floats(1e4, 1e8))
def test_packets_in_a_row_arrive_as_far_apart_as_the_bandwidth_makes_them(
    size_bytes: int, bandwidth: float
) -> None:
    arrived = travel(link(LinkSpec(bandwidth_bit_per_s=bandwidth)), paced(10, 0.0, size_bytes))
    for number, (packet, at_s) in enumerate(arrived, start=1):
        assert packet.number == number - 1
        assert at_s == pytest.approx(number * 8 * size_bytes / bandwidth, abs=ROUNDING_S)


@given(specs(), journeys())
def test_the_same_seed_gives_the_same_journey(spec: LinkSpec, packets: list[Sent]) -> None:
    assert travel(link(spec), packets) == travel(link(spec), packets)


@pytest.mark.parametrize("seed", range(3))
def test_a_delay_wanders_between_periods_and_is_constant_within_one(seed: int) -> None:
    """Both directions share the random drift of the delay, independent of their jitter."""
    spec = LinkSpec(delay_s=0.02, wander=Wander(0.01, 1.0), seed=seed)
    extra_ms: dict[int, set[float]] = {}
    for packet, at_s in travel(link(spec), paced(20_000, 0.1)):
        extra_ms.setdefault(int(packet.at_s + ROUNDING_S), set()).add(
            round(1e3 * (at_s - packet.at_s - 0.02), 6)
        )
    assert all(len(each) == 1 for each in extra_ms.values())
    found = [each.pop() for each in extra_ms.values()]
    assert 0.0 <= min(found) < 0.1
    assert 9.9 < max(found) <= 10.0
    assert math.fsum(found) / len(found) == pytest.approx(5.0, abs=5.0 * 2.9 / len(found) ** 0.5)


def test_another_seed_gives_another_journey() -> None:
    journeys = [
        tuple(packet.number for packet, _ in travel(link(spec), paced(100, 0.01)))
        for spec in (LinkSpec(loss=0.5, seed=seed) for seed in range(20))
    ]
    assert len(set(journeys)) == 20


@given(specs(loss=0.3), delays_s, journeys())
def test_what_is_lost_does_not_depend_on_how_late_the_rest_is(
    spec: LinkSpec, jitter_s: float, packets: list[Sent]
) -> None:
    def survivors(spec: LinkSpec) -> set[int]:
        return {packet.number for packet, _ in travel(link(spec), packets)}

    other = dataclasses.replace(spec, jitter_s=jitter_s, delay_s=0.0, reorder=0.0)
    assert survivors(spec) == survivors(other)


@given(specs(loss=0.0), journeys())
def test_more_than_the_capacity_is_never_on_the_way(spec: LinkSpec, packets: list[Sent]) -> None:
    capacity_bytes = 2000
    tried = link(spec, capacity_bytes=capacity_bytes)
    inside: dict[int, int] = {}
    for packet in packets:
        for arrived in tried.receive(packet.at_s):
            del inside[arrived.number]
        fits = sum(inside.values()) + packet.size_bytes <= capacity_bytes
        assert tried.send(packet, packet.size_bytes, packet.at_s) is fits
        if fits:
            inside[packet.number] = packet.size_bytes


@given(specs(loss=0.0), journeys(), st.floats(0.0, 10.0))
def test_a_cut_loses_what_is_on_its_way_and_what_comes_until_it_is_mended(
    spec: LinkSpec, packets: list[Sent], cut_s: float
) -> None:
    tried = link(spec)
    before = [packet for packet in packets if packet.at_s < cut_s]
    for packet in before:
        tried.send(packet, packet.size_bytes, packet.at_s)
    arrived = tried.receive(cut_s)
    lost = tried.cut()
    assert sorted(p.number for p in [*arrived, *lost]) == [p.number for p in before]
    assert [p.number for p in lost] == sorted(p.number for p in lost)
    assert not tried.send(Sent(-1, 100, cut_s), 100, cut_s)
    assert tried.next_s() is None
    assert tried.counters.lost == len(lost) + 1
    tried.restore()
    afterwards = travel(tried, [Sent(-2, 100, cut_s + 10.0)])
    assert [packet.number for packet, _ in afterwards] == [-2]


def test_what_is_lost_in_a_cut_holds_up_nobody_afterwards() -> None:
    tried = link(LinkSpec(delay_s=100.0))
    tried.send(Sent(0, 100, 0.0), 100, 0.0)
    tried.cut()
    tried.restore()
    tried.change(LinkSpec(delay_s=1.0), 1.0)
    assert travel(tried, [Sent(1, 100, 1.0)]) == [(Sent(1, 100, 1.0), 2.0)]


def test_a_packet_that_nobody_has_taken_when_a_stall_begins_comes_after_it() -> None:
    tried = link(LinkSpec(delay_s=0.1))
    tried.send(Sent(0, 100, 0.0), 100, 0.0)
    tried.stall(1.0, 0.2)
    assert tried.receive(0.5) == []
    assert tried.receive(1.2) == [Sent(0, 100, 0.0)]


@given(specs(loss=0.0, reorder=0.0), specs(loss=0.0, reorder=0.0), journeys(), journeys())
def test_order_and_everything_is_kept_when_a_link_becomes_another(
    first: LinkSpec, then: LinkSpec, before: list[Sent], after: list[Sent]
) -> None:
    tried = link(first)
    for packet in before:
        tried.send(packet, packet.size_bytes, packet.at_s)
    change_s = before[-1].at_s if before else 0.0
    arrived = [packet.number for packet in tried.receive(change_s)]
    tried.change(then, change_s)
    assert tried.spec == then
    moved = [Sent(1000 + p.number, p.size_bytes, change_s + p.at_s) for p in after]
    numbers = arrived + [packet.number for packet, _ in travel(tried, moved)]
    assert numbers == [p.number for p in before] + [p.number for p in moved]
