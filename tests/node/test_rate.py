"""A loop that keeps its rate, and does not hurry after it was held up."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from tests.support.withheld import Stopwatch
from tsd_twin.node.timing import RateKeeper

PERIOD_S = 0.005


def test_periods_are_as_long_as_they_should_be() -> None:
    stop, rate = threading.Event(), RateKeeper(PERIOD_S)
    times_s = [rate.wait(stop) for _ in range(100)]
    periods_s = np.diff(times_s)
    # The scheduler is late now and then; what counts is where most periods are.
    assert np.median(periods_s) == pytest.approx(PERIOD_S, rel=0.1)
    assert periods_s.mean() > 0.98 * PERIOD_S
    assert rate.status().hz == pytest.approx(1.0 / periods_s.mean(), rel=0.05)


def test_what_was_missed_is_an_overrun_and_no_burst() -> None:
    stop, rate = threading.Event(), RateKeeper(PERIOD_S)
    rate.wait(stop)
    before = rate.status().overruns
    threading.Event().wait(10 * PERIOD_S)  # Somebody holds up the loop.
    late_s = rate.wait(stop)
    assert rate.status().overruns == before + 1
    assert [rate.wait(stop) for _ in range(3)][-1] - late_s >= 3 * PERIOD_S - 1e-3
    assert rate.status().jitter_p99_ms >= 1000 * 8 * PERIOD_S
    assert rate.status().longest_ms >= 1000 * 9 * PERIOD_S


def test_a_loop_that_shall_end_does_not_wait() -> None:
    stop, rate = threading.Event(), RateKeeper(10.0)
    stop.set()
    watch = Stopwatch()
    rate.wait(stop)
    assert watch.took_s < 5.0
