"""Ages of pictures by clocks that differ, over networks with any delays."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.dashboard.pictures.camera_clock import DRIFT_S, READINGS, CameraClock

DELAYS = st.tuples(st.floats(0.0, 0.4), st.floats(0.0, 0.4))
"""Way of a question to the camera, and of its answer."""
OFFSETS = st.floats(-1e6, 1e6)
ROUNDING_S = 1e-6
"""Resolution of numbers of this size, and of hypothesis's additions of them."""
EXPOSED_S, DELAY_S = 500.0, 0.5
"""Time of an exposure on this machine, and until it arrives."""


def ask(clock: CameraClock, offset_s: float, now_s: float, there_s: float, back_s: float) -> None:
    clock.read(now_s, offset_s + now_s + there_s, now_s + there_s + back_s)


def error_s(clock: CameraClock, offset_s: float) -> float:
    """Return the error of the age of a picture; no clock but the camera's is right or wrong."""
    arrived_s = EXPOSED_S + DELAY_S
    return clock.exposed_s(EXPOSED_S + offset_s, -1e9, arrived_s) - EXPOSED_S


@given(OFFSETS, st.lists(DELAYS, min_size=1, max_size=3 * READINGS))
def test_an_age_is_wrong_by_half_of_the_least_round_trip_at_most(
    offset_s: float, delays: list[tuple[float, float]]
) -> None:
    """For any offset, and any difference between the way there and the way back."""
    clock = CameraClock()
    for second, each in enumerate(delays):
        ask(clock, offset_s, float(second), *each)
        least_s = min(map(sum, delays[max(0, second + 1 - READINGS) : second + 1]))
        assert abs(error_s(clock, offset_s)) <= 0.5 * least_s + ROUNDING_S


@given(st.floats(0.0, 0.4), st.sampled_from([0.0, 1.0]))
def test_the_worst_delay_is_all_on_one_way(trip_s: float, share: float) -> None:
    """The bound cannot be smaller."""
    clock = CameraClock()
    ask(clock, 7.0, 0.0, share * trip_s, (1.0 - share) * trip_s)
    assert abs(error_s(clock, 7.0)) == pytest.approx(0.5 * trip_s, abs=ROUNDING_S)


@given(OFFSETS, OFFSETS, st.lists(DELAYS, min_size=1, max_size=READINGS), DELAYS)
def test_a_clock_that_was_set_counts_from_the_next_answer(
    before_s: float, after_s: float, delays: list[tuple[float, float]], delay: tuple[float, float]
) -> None:
    """A change within the error of the answers may remain unnoticed, and is then as small."""
    clock = CameraClock()
    for second, each in enumerate(delays):
        ask(clock, before_s, float(second), *each)
    ask(clock, after_s, 100.0, *delay)
    assert abs(error_s(clock, after_s)) <= 1.5 * sum(delay) + DRIFT_S + ROUNDING_S


@given(OFFSETS, st.floats(0.0, 10.0))
def test_no_picture_was_exposed_after_its_arrival(offset_s: float, ahead_s: float) -> None:
    clock = CameraClock()
    ask(clock, offset_s, 0.0, 0.0, 0.0)
    assert clock.exposed_s(100.0 + offset_s + ahead_s, 0.0, 100.0) <= 100.0


@given(st.floats(0.0, 1e6), st.lists(st.floats(0.0, 0.4), min_size=1, max_size=50))
def test_without_answers_an_age_counts_from_the_stamp(least_s: float, more_s: list[float]) -> None:
    clock = CameraClock()
    for now_s, more in enumerate(more_s):
        delay_s = least_s + more
        exposed_s = clock.exposed_s(1000.0 + now_s - delay_s, 1000.0 + now_s, now_s)
        assert now_s - exposed_s == pytest.approx(delay_s)


@given(st.floats(-1e6, -1.0), st.lists(st.floats(0.0, 0.4), min_size=1))
def test_without_answers_a_clock_ahead_shows_extra_delays(
    offset_s: float, more_s: list[float]
) -> None:
    clock = CameraClock()
    for more in [0.0, *more_s]:
        exposed_s = clock.exposed_s(-offset_s - more, 0.0, 0.0)
        assert -exposed_s == pytest.approx(more, abs=1e-6)
