"""A loop that keeps its rate, and does not hurry after a delay."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from tests.support.virtual_time import VirtualClock
from tsd_twin.node.timing import RateKeeper

PERIOD_S = 0.005


@pytest.mark.parametrize("period_s", [PERIOD_S, 0.02])
def test_periods_are_as_long_as_they_should_be(clock: VirtualClock, period_s: float) -> None:
    stop, rate = threading.Event(), RateKeeper(period_s)
    times_s: list[float] = []
    for number in range(100):
        clock.advance(period_s * (number % 10) / 10)  # The loop computes.
        times_s.append(rate.wait(stop))
    np.testing.assert_allclose(np.diff(times_s), period_s, rtol=1e-6)
    assert rate.status().hz == pytest.approx(1.0 / period_s, rel=0.05)
    assert rate.status().overruns == 0


def test_what_was_missed_is_an_overrun_and_no_burst(clock: VirtualClock) -> None:
    stop, rate = threading.Event(), RateKeeper(PERIOD_S)
    rate.wait(stop)
    before = rate.status().overruns
    clock.advance(10 * PERIOD_S)  # Simulated delay of the loop.
    late_s = rate.wait(stop)
    assert rate.status().overruns == before + 1
    assert [rate.wait(stop) for _ in range(3)][-1] - late_s >= 3 * PERIOD_S - 1e-3
    assert rate.status().jitter_p99_ms >= 1000 * 8 * PERIOD_S
    assert rate.status().longest_ms >= 1000 * 9 * PERIOD_S


def test_a_loop_that_shall_end_does_not_wait(clock: VirtualClock) -> None:
    stop, rate = threading.Event(), RateKeeper(10.0)
    stop.set()
    start_s = clock.now_s
    assert rate.wait(stop) == start_s
