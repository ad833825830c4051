"""Loop delay measured by command numbers, without trusting the status."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.messages.status import CommandStatus
from tsd_twin.motion.prediction import CommandDelay


def measured(delay: CommandDelay, *reports: tuple[int, float | None, float]) -> None:
    for seq, age_s, now_s in reports:
        delay.add_status(CommandStatus(seq=seq, age_s=age_s), now_s)


@given(up_s=st.floats(0.0, 0.5), down_s=st.floats(0.0, 0.5), wait_s=st.floats(0.0, 0.2))
def test_it_is_the_way_there_and_back_without_the_wait_for_the_status(
    up_s: float, down_s: float, wait_s: float
) -> None:
    delay = CommandDelay()
    for seq in range(1, 40):
        delay.add_sent(seq, 0.02 * seq)
    measured(delay, (7, wait_s, 0.14 + up_s + wait_s + down_s))
    assert delay.median_s(1.5) == pytest.approx(up_s + down_s, abs=1e-9)


@pytest.mark.parametrize("age_s", [math.nan, math.inf, -math.inf, -1.0, 1e300, None])
def test_what_is_no_possible_delay_does_not_count(age_s: float | None) -> None:
    delay = CommandDelay()
    delay.add_sent(1, 0.0)
    measured(delay, (1, age_s, 0.3), (2, 0.0, 0.3), (-1, 0.0, 0.3), (1, 0.0, 9.0), (1, 0.0, -1.0))
    assert delay.median_s(0.3) is None


def test_one_wrong_value_changes_nothing_and_an_old_one_is_forgotten() -> None:
    delay = CommandDelay()
    for seq in range(1, 6):
        delay.add_sent(seq, 0.02 * seq)
        measured(delay, (seq, 0.0, 0.02 * seq + (4.0 if seq == 3 else 0.1)))
    assert delay.median_s(0.3) == pytest.approx(0.1)
    assert delay.median_s(7.0) is None
