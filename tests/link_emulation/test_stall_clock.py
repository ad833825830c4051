"""The clock of a link pauses in stalls, compared with counting tick by tick."""

from __future__ import annotations

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from tsd_twin.link_emulation import Stall
from tsd_twin.link_emulation.link import StallClock

TICK_S = 0.25  # Sums of these are exact.

rhythms = st.none() | st.tuples(st.integers(1, 8), st.integers(1, 8)).map(
    lambda each: (each[0], each[0] + each[1])
)
holds = st.lists(st.tuples(st.integers(0, 60), st.integers(0, 20)), max_size=4).map(sorted)


def stall_of(rhythm: tuple[int, int] | None) -> Stall | None:
    return Stall(rhythm[0] * TICK_S, rhythm[1] * TICK_S) if rhythm else None


def stands(tick: int, rhythm: tuple[int, int] | None, holds: list[tuple[int, int]]) -> bool:
    """Return whether the clock is paused in the tick starting now, by definition."""
    if any(start <= tick < start + length for start, length in holds):
        return True
    return rhythm is not None and tick >= rhythm[1] and tick % rhythm[1] < rhythm[0]


@given(rhythms, holds, st.integers(-40, 40), st.integers(1, 7))
def test_it_runs_in_all_ticks_but_those_of_stalls(
    rhythm: tuple[int, int] | None, holds: list[tuple[int, int]], start: int, every: int
) -> None:
    start_s = start * TICK_S
    stopwatch = StallClock(start_s, stall_of(rhythm))
    ran = 0
    waiting = list(holds)
    for tick in range(100):
        now_s = start_s + tick * TICK_S
        while waiting and waiting[0][0] == tick:
            stopwatch.hold(waiting.pop(0)[1] * TICK_S, now_s)
        known = [hold for hold in holds if hold[0] <= tick]
        assert stopwatch.stands(now_s) is stands(tick, rhythm, known)
        if tick % every == 0:  # The result must not depend on how often it is read.
            assert stopwatch.read(now_s) == ran * TICK_S
        ran += not stands(tick, rhythm, known)


@given(rhythms, holds, st.integers(0, 80), st.integers(0, 60))
@example(rhythm=(1, 2), holds=[], ran=2, from_tick=0)
def test_when_is_the_first_moment_that_shows_a_time_and_runs(
    rhythm: tuple[int, int] | None, holds: list[tuple[int, int]], ran: int, from_tick: int
) -> None:
    known = [hold for hold in holds if hold[0] <= from_tick]
    stopwatch = StallClock(0.0, stall_of(rhythm))
    for tick, length in known:
        stopwatch.hold(length * TICK_S, tick * TICK_S)
    stopwatch.read(from_tick * TICK_S)
    counted, tick = 0, 0
    while counted < ran or tick < from_tick or stands(tick, rhythm, known):
        counted += not stands(tick, rhythm, known)
        tick += 1
    assert stopwatch.when(ran * TICK_S) == tick * TICK_S


@given(rhythms, rhythms, st.integers(0, 60), st.integers(0, 60))
def test_a_new_rhythm_leaves_what_ran_so_far(
    before: tuple[int, int] | None, after: tuple[int, int] | None, first: int, then: int
) -> None:
    stopwatch = StallClock(0.0, stall_of(before))
    stopwatch.change(stall_of(after), first * TICK_S)
    ran = sum(not stands(tick, before, []) for tick in range(first))
    ran += sum(not stands(tick, after, []) for tick in range(first, first + then))
    assert stopwatch.read((first + then) * TICK_S) == ran * TICK_S


@given(st.floats(0.01, 10.0), st.floats(0.01, 10.0), st.floats(0.0, 1e4), st.floats(0.0, 1e6))
def test_when_and_read_are_inverse_for_any_times(
    length_s: float, between_s: float, ran_s: float, start_s: float
) -> None:
    stopwatch = StallClock(start_s, Stall(length_s, length_s + between_s))
    at_s = stopwatch.when(ran_s)
    assume(at_s < 1e7)
    assert stopwatch.read(at_s) == pytest.approx(ran_s, abs=1e-6)


def test_time_that_goes_back_is_time_that_stood() -> None:
    stopwatch = StallClock(0.0, None)
    assert stopwatch.read(2.0) == 2.0
    assert stopwatch.read(1.0) == 2.0
    assert stopwatch.read(3.0) == 3.0
