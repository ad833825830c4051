"""Message age from ROS is never underestimated, and one publisher at a time is accepted."""

from __future__ import annotations

import math
import pickle
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from tsd_twin.adapters.cmd_vel import MAX_AGE_S, PAUSE_S
from tsd_twin.adapters.ros.arrivals import (
    CONFIRM_S,
    DRIFT,
    FASTER_S,
    JITTER_S,
    MOST_ECHOES,
    MOST_PUBLISHERS,
    SILENT_S,
    STEADY_S,
    Arrival,
    Echoes,
    Origin,
    PublisherArbiter,
    PublisherTracker,
)

A, B = b"a" * 16, b"b" * 16
CLOCK_S = 1.7e9
"""Publisher clock when this clock shows zero."""
PERIOD_S = 0.05
LINK_JITTER_S = 0.01
RUNS = 400


def origin(sequence: int, sent_s: float, publisher: bytes = A) -> Origin:
    return Origin(publisher, sequence, round((CLOCK_S + sent_s) * 1e9))


def counts(arrival: Arrival | None, now_s: float) -> bool:
    """Return whether a non-zero twist may move the robot."""
    return (
        arrival is not None and not arrival.unproven and now_s - arrival.sent_after_s <= MAX_AGE_S
    )


@dataclass
class Stream:
    """A publisher with a link, as seen by the adapter."""

    arrivals: PublisherTracker
    sequence: int = 0

    def send(self, sent_s: float, arrived_s: float, publisher: bytes = A) -> Arrival:
        self.sequence += 1
        arrival = self.arrivals.note(origin(self.sequence, sent_s, publisher), arrived_s)
        assert arrival is not None
        return arrival

    def drive(self, start_s: float, end_s: float, delay_s: float = 0.0) -> list[bool]:
        """Send at a steady rate; return which messages are accepted."""
        times_s = np.arange(start_s, end_s, PERIOD_S) + delay_s
        return [counts(self.send(at_s - delay_s, at_s), at_s) for at_s in times_s]


def known(delay_s: float = 0.0) -> Stream:
    """A stream with an estimated clock offset, ending at time 0."""
    stream = Stream(PublisherTracker())
    assert stream.drive(-2.0 * STEADY_S, 0.0, delay_s)[-1]
    return stream


def drained(backlog_s: float, rate: float) -> Iterator[tuple[float, float]]:
    """Send and arrival times after a stall that ends at 0."""
    for sent_s in np.arange(-backlog_s, 0.0, PERIOD_S):
        yield sent_s, (sent_s + backlog_s) / rate


def test_a_new_clock_is_known_after_half_a_second_at_a_steady_rate() -> None:
    counted = Stream(PublisherTracker()).drive(0.0, 2.0)
    late = round(STEADY_S / PERIOD_S)
    assert not any(counted[:late])
    assert all(counted[late + 1 :])


@pytest.mark.parametrize("rate", [1.25, 3.0, 20.0, math.inf])
def test_what_a_stalled_link_held_back_of_a_new_publisher_does_not_count(rate: float) -> None:
    stream = Stream(PublisherTracker())
    for sent_s, arrived_s in drained(4.0, rate):
        assert not counts(stream.send(sent_s, arrived_s), arrived_s)


@pytest.mark.parametrize("rate", [1.25, 3.0, 20.0, math.inf])
def test_other_publishers_do_not_evict_the_clock_of_a_stalled_one(rate: float) -> None:
    stream = known()
    for i in range(2 * MOST_PUBLISHERS):
        stream.arrivals.note(origin(1, 3.0, i.to_bytes(16, "big")), 3.0)
    for sent_s, arrived_s in drained(4.0, rate):
        at_s = arrived_s + 4.1
        assert not counts(stream.send(sent_s + 4.1, at_s), at_s) or at_s - sent_s - 4.1 <= MAX_AGE_S


@pytest.mark.parametrize("rate", [1.25, 3.0, 20.0, math.inf])
def test_a_clock_set_forward_as_the_link_stalls_makes_old_twists_no_younger(rate: float) -> None:
    stream = known()
    for sent_s, arrived_s in drained(2.0, rate):
        at_s = arrived_s + 2.0
        assert not counts(stream.send(sent_s + 4.0, at_s), at_s)


def test_further_publishers_are_refused_with_a_sentence_until_others_are_silent() -> None:
    arrivals = PublisherTracker()
    for i in range(MOST_PUBLISHERS):
        arrivals.note(origin(1, 0.0, i.to_bytes(16, "big")), 0.0)
    refused = arrivals.note(origin(1, 1.0), 1.0)
    assert refused is not None
    assert str(MOST_PUBLISHERS) in refused.unproven
    assert Stream(arrivals).drive(SILENT_S + 0.1, SILENT_S + 2.0)[-1]
    unused = PublisherTracker()
    assert Stream(unused).drive(SILENT_S + 0.1, SILENT_S + 2.0)[-1]
    assert pickle.dumps(arrivals) == pickle.dumps(unused), "silent publishers are forgotten"


def test_a_push_after_a_pause_counts_after_a_moment() -> None:
    counted = known().drive(10.0, 11.0)
    late = round(CONFIRM_S / PERIOD_S)
    assert not any(counted[:late])
    assert all(counted[late + 1 :])


def test_messages_seldom_sent_never_count() -> None:
    stream = Stream(PublisherTracker())
    assert not any(counts(stream.send(0.35 * i, 0.35 * i), 0.35 * i) for i in range(100))


def test_clocks_that_drift_apart_are_followed() -> None:
    for drift in (-0.8 * DRIFT, 0.8 * DRIFT):
        stream = Stream(PublisherTracker())
        counted = [
            counts(stream.send((1.0 + drift) * at_s, at_s), at_s)
            for at_s in np.arange(0.0, 600.0, PERIOD_S)
        ]
        assert all(counted[20:])


def test_a_constant_delay_cannot_be_seen_without_an_echo() -> None:
    """One-way traffic looks the same with any constant delay."""
    assert Stream(PublisherTracker()).drive(0.0, 2.0, 3.0)[-1]
    echoes = Echoes()
    for i in range(100):
        echoes.sent(i, 0.02 * i)
    assert echoes.sent_after_s(40) == pytest.approx(0.8)
    assert echoes.sent_after_s(12345) is None


def test_echoes_of_long_ago_are_not_kept() -> None:
    echoes = Echoes()
    for i in range(3 * MOST_ECHOES):
        echoes.sent(i, float(i))
    assert echoes.sent_after_s(0) is None
    assert echoes.sent_after_s(3 * MOST_ECHOES - 1) is not None


def journey(rng: np.random.Generator) -> Iterator[tuple[float, float, float]]:
    """Yield send times, arrival times and publisher clock, with random faults.

    The link has a constant delay, counted into the send time, because no age estimate can see it.
    """
    period_s = rng.choice([0.01, 0.02, 0.05, 0.1, 0.2])
    stalls = np.sort(rng.uniform(0.0, 15.0, rng.integers(0, 4)))
    if rng.random() < 0.3:
        stalls = np.array([0.0, *stalls])  # Begins with a stall.
    lengths = rng.uniform(0.2, 5.0, len(stalls))
    # The publisher's clock jumps at times, also by about the length of a stall at its start.
    sizes = np.where(
        rng.random(len(stalls)) < 0.5, lengths + rng.uniform(-0.1, 0.1, len(stalls)),
        rng.uniform(-4.0, 4.0, len(stalls)),
    )  # fmt: skip
    when = stalls + rng.choice([0.0, 1.0], len(stalls)) * rng.uniform(-1.0, 4.0, len(stalls))
    jumps = list(zip(when, sizes, strict=True)) if rng.random() < 0.6 else []
    pauses = rng.uniform(0.0, 15.0, 3)
    skew, rate, before_s, arrived_s = rng.uniform(-0.9, 0.9) * DRIFT, math.inf, 0.0, -math.inf
    for sent_s in np.arange(0.0, 20.0, period_s):
        if any(pause <= sent_s < pause + 0.7 for pause in pauses):
            continue
        nominal_s = sent_s + rng.uniform(0.0, LINK_JITTER_S)
        next_s = max(nominal_s, arrived_s + (sent_s - before_s) / rate)
        if next_s == nominal_s:
            rate = math.inf
        for stall_s, length_s in zip(stalls, lengths, strict=True):
            if stall_s <= next_s < stall_s + length_s:
                next_s, rate = stall_s + length_s, rng.choice([1.25, 1.5, 3.0, 10.0, 1e6])
        before_s, arrived_s = sent_s, next_s
        jumped_s = sum(size_s for at_s, size_s in jumps if at_s <= sent_s)
        yield sent_s, arrived_s, (1.0 + skew) * sent_s + jumped_s


def oldest_counted_s(seed: int) -> float:
    """Maximum age of an accepted twist in a run with random faults."""
    rng = np.random.default_rng(seed)
    stream, oldest_s = Stream(PublisherTracker()), 0.0
    for sent_s, arrived_s, clock_s in journey(rng):
        if rng.random() < 0.05:
            other = rng.bytes(16)
            stream.arrivals.note(origin(1, arrived_s, other), arrived_s)
        if counts(stream.send(clock_s, arrived_s), arrived_s):
            oldest_s = max(oldest_s, arrived_s - sent_s)
    return oldest_s


def test_no_twist_counts_that_is_older_than_the_limit_apart_from_a_constant_delay() -> None:
    slack_s = JITTER_S + FASTER_S + LINK_JITTER_S + DRIFT * 20.0
    oldest = [oldest_counted_s(seed) for seed in range(RUNS)]
    assert max(oldest) <= MAX_AGE_S + slack_s, int(np.argmax(oldest))
    assert max(oldest) > 0.5 * MAX_AGE_S, "no run has a delay"


def test_a_message_that_comes_twice_or_late_is_dropped() -> None:
    arrivals = PublisherTracker()
    assert arrivals.note(origin(5, 0.0), 0.0) is not None
    assert arrivals.note(origin(5, 0.0), 0.1) is None
    assert arrivals.note(origin(4, -0.1), 0.2) is None
    assert arrivals.note(origin(6, 0.2), 0.3) is not None
    assert arrivals.note(origin(1, 0.2, B), 0.3) is not None, "another publisher"


def test_one_publisher_drives_and_another_has_to_wait_and_to_pause() -> None:
    turn = PublisherArbiter()
    assert turn.admits(A, True, 0.0)
    assert not turn.admits(B, True, 0.1)
    assert not turn.admits(B, False, 0.15), "its zeros do not stop the other"
    assert turn.admits(A, True, 0.2)
    now_s = 0.2
    while now_s < 0.2 + 3.0 * PAUSE_S:
        now_s += 0.1
        assert not turn.admits(B, True, now_s), "a stick that is held on"
    now_s += PAUSE_S + 0.01
    assert turn.admits(B, True, now_s)
    assert not turn.admits(A, True, now_s + 0.1)


def test_zeros_do_not_keep_the_turn() -> None:
    turn = PublisherArbiter()
    assert turn.admits(A, True, 0.0)
    for i in range(10):
        assert turn.admits(A, False, 0.1 * i)
    assert turn.admits(B, True, 1.0)
