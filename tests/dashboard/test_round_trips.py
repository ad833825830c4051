"""Round-trip statistics that a single late message hardly changes."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.client.monitor import MAX_ROUND_TRIPS, RoundTrips

seconds = st.lists(st.floats(0.0, 10.0), min_size=1, max_size=3 * MAX_ROUND_TRIPS)


@given(trips_s=seconds)
def test_typical_and_late_are_the_quantiles_of_the_newest(trips_s: list[float]) -> None:
    trips = RoundTrips()
    for trip_s in trips_s:
        trips.add(trip_s)
    newest = trips_s[-MAX_ROUND_TRIPS:]
    assert trips.median_s() == np.quantile(newest, 0.5, method="inverted_cdf")
    assert trips.p95_s() == np.quantile(newest, 0.95, method="inverted_cdf")
    typical_s, late_s = trips.median_s(), trips.p95_s()
    assert typical_s is not None
    assert late_s is not None
    assert trips.jitter_s() == late_s - typical_s >= 0.0


def test_nothing_is_known_before_the_first_answer_nor_after_silence() -> None:
    trips = RoundTrips()
    for _ in range(2):
        assert trips.median_s() is trips.p95_s() is trips.jitter_s() is None
        trips.add(0.1)
        assert trips.median_s() == 0.1
        trips.clear()
