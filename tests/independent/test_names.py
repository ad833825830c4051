"""Faults named by a shadow twin on independent plants: part of `tests.independent.names`.

The seeds differ from those used for tuning and for the table in the docs.
"""

from __future__ import annotations

import pytest

from tests.independent.faulty import Fault
from tests.independent.names import run

COUNT, SEED = 3, 70_000


@pytest.mark.parametrize(
    "fault",
    [
        Fault("tsd", drive="wander"),
        Fault("kiwi", drive="stick"),
        Fault("kiwi", drive="wander", integral=False),
        Fault("mecanum", drive="stops", integral=False),
        Fault("omni4", drive="wander", integral=False),
    ],
    ids=str,
)
def test_nothing_is_named_of_a_sound_robot(fault: Fault) -> None:
    """Wheel loops with an integral part or droop, and lags of 10 to 50 ms."""
    for outcome in run((fault, COUNT, SEED, 20.0)):
        assert outcome.wrong == ()


def test_a_worn_wheel_is_named_and_no_other() -> None:
    outcomes = run((Fault("kiwi", "radius", 10.0), COUNT, SEED + 1, 24.0))
    assert [each.wrong for each in outcomes] == COUNT * [()]
    assert sum(each.right_s <= 14.0 for each in outcomes) >= COUNT - 1


def test_a_fault_that_is_not_in_the_bank_has_no_name() -> None:
    for outcome in run((Fault("tsd", "mount", 10.0), COUNT, SEED + 2, 22.0)):
        assert outcome.wrong == ()
        assert outcome.unknown
