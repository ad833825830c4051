"""Gimbals that nobody drives get torque near neutral only, and move slowly."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.hardware.approach import NEAR_STEPS, RUN_DOWN_S, SLOW_STEPS_PER_S, Approach

STEPS = st.integers(-340, 340)


@given(
    start=st.lists(STEPS, min_size=2, max_size=2),
    wanted=st.lists(STEPS, min_size=2, max_size=2),
    periods_s=st.lists(st.floats(0.0, 5.0), min_size=1, max_size=50),
)
def test_goals_start_where_servos_are_and_move_slowly_to_the_wanted_ones(
    start: list[int], wanted: list[int], periods_s: list[float]
) -> None:
    approach, now_s, before = Approach(2), 100.0, start
    for i, steps in enumerate(start):
        approach.see(i, steps, holds=False)
    assert approach.step(start, now_s, armed=False) == start
    for period_s in periods_s:
        now_s += period_s
        goals = approach.step(wanted, now_s, armed=False)
        for goal, last, to in zip(goals, before, wanted, strict=True):
            assert abs(goal - last) <= SLOW_STEPS_PER_S * min(period_s, 0.1) + 1.0
            assert abs(to - goal) <= abs(to - last)
        before = goals
    for _ in range(30):
        now_s += 0.1
        before = approach.step(wanted, now_s, armed=False)
    assert before == wanted


@pytest.mark.parametrize(("since_s", "at_once"), [(0.0, True), (1.9, True), (2.0, False)])
def test_gimbals_get_upright_at_once_while_wheels_run_down(since_s: float, at_once: bool) -> None:
    approach = Approach(1)
    approach.see(0, 0, holds=True)
    assert approach.step([200], 50.0, armed=True) == [200]
    assert RUN_DOWN_S == 2.0
    assert (approach.step([0], 50.0 + since_s, armed=False) == [0]) is at_once


def test_a_servo_is_far_until_it_was_seen_near_neutral() -> None:
    approach = Approach(3)
    for servo, steps in enumerate((NEAR_STEPS + 1, -NEAR_STEPS, -NEAR_STEPS - 1)):
        approach.see(servo, steps, holds=False)
    assert approach.far == 0b101
    approach.see(0, 0, holds=False)
    approach.see(0, 300, holds=True)
    assert approach.far == 0b100
