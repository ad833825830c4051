"""Pauses of the control loop are reported, and blamed only for silences they explain."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.messages.codes import Code, because
from tsd_twin.safety.loop_watch import LATE_S, LoopWatch

LIMIT_S = 0.1
# A pause of exactly LATE_S may be rounded either way.
period_ms = st.integers(5, 400).filter(lambda ms: ms != 1000 * LATE_S)
periods_ms = st.lists(period_ms, min_size=1, max_size=20)


@given(periods_ms=periods_ms, quiet=st.integers(0, 19))
def test_a_pause_explains_a_silence_that_would_be_allowed_without_it(
    periods_ms: list[int], quiet: int
) -> None:
    """The silence begins at any period; its length without pauses is counted separately."""
    watch, now_ms = LoopWatch(), 0
    watch.step(0.0)
    begin = min(quiet, len(periods_ms) - 1)
    for period_ms in periods_ms:
        now_ms += period_ms
        watch.step(now_ms / 1000)
    silence_ms = periods_ms[begin:]
    pauses = [each for each in silence_ms if each >= 1000 * LATE_S]
    pause = watch.explains(sum(periods_ms[:begin]) / 1000, LIMIT_S, now_ms / 1000)
    if pause:
        assert sum(silence_ms) >= 1000 * LIMIT_S
        assert pause == because(Code.LOOP_LATE, ms=pauses[-1])
        assert sum(silence_ms) - pauses[-1] <= 1000 * LIMIT_S + 1
    elif sum(silence_ms) > 1000 * LIMIT_S + 1 and pauses:
        assert sum(silence_ms) - pauses[-1] >= 1000 * LIMIT_S - 1


def test_each_pause_is_an_event_with_its_length_and_a_regular_loop_has_none() -> None:
    watch = LoopWatch()
    assert not any(watch.step(0.01 * i) for i in range(200))
    event = watch.step(1.99 + 0.14)
    assert event is not None
    assert (event.kind, event.why) == ("loop", because(Code.LOOP_LATE, ms=140))


def test_events_come_once_a_second_unless_a_pause_is_longer() -> None:
    watch, now_s, pauses_ms = LoopWatch(), 0.0, []
    for pause_s in (0.06, 0.06, 0.06, 0.2, 0.06):
        watch.step(now_s)
        now_s += pause_s
        if event := watch.step(now_s):
            pauses_ms.append(event.why.params["ms"])
    assert pauses_ms == [60, 200]


@pytest.mark.parametrize("wait_s", [0.0, 0.09, 0.11, 1.0])
def test_a_silence_that_went_on_after_the_pause_is_not_explained_by_it(wait_s: float) -> None:
    watch = LoopWatch()
    watch.step(0.0)
    watch.step(0.14)
    for i in range(round(wait_s * 100)):
        watch.step(0.15 + 0.01 * i)
    text = watch.explains(0.0, LIMIT_S, 0.14 + wait_s)
    assert bool(text) is (wait_s < LIMIT_S)
