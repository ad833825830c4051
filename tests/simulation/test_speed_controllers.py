"""Speed controllers pass no throttle before they have seen zero for long enough."""

from __future__ import annotations

import numpy as np

from tsd_twin.simulation import EscModel

ZERO, HALF = np.zeros(1), np.full(1, 90.0)


def controllers() -> EscModel:
    return EscModel((1,), zero_throttle=0.0, hold_s=2.0)


def test_throttle_at_power_up_turns_nothing_ever() -> None:
    esc = controllers()
    for _ in range(100):
        assert esc.command(HALF) == 0.0
        esc.advance(0.1)
    assert not esc.armed.any()


def test_throttle_passes_after_the_hold() -> None:
    esc = controllers()
    esc.command(ZERO)
    esc.advance(1.0)
    assert not esc.armed.any()
    esc.advance(1.0)
    assert esc.armed.all()
    assert esc.command(HALF) == 90.0
    esc.advance(10.0)
    assert esc.command(HALF) == 90.0


def test_a_hold_that_is_broken_starts_again() -> None:
    esc = controllers()
    esc.command(ZERO)
    esc.advance(1.5)
    assert esc.command(HALF) == 0.0
    esc.command(ZERO)
    esc.advance(1.5)
    assert esc.command(HALF) == 0.0
    esc.command(ZERO)
    esc.advance(2.0)
    assert esc.command(HALF) == 90.0


def test_time_without_a_signal_does_not_count() -> None:
    esc = controllers()
    esc.advance(10.0)
    esc.command(ZERO)
    assert not esc.armed.any()
    assert esc.command(HALF) == 0.0


def test_an_armed_controller_stays_armed() -> None:
    esc = controllers()
    esc.command(ZERO)
    esc.advance(2.0)
    esc.command(HALF)
    assert esc.command(ZERO) == 0.0
    assert esc.command(HALF) == 90.0


def test_each_controller_arms_for_itself() -> None:
    esc = EscModel((2, 2), zero_throttle=0.0, hold_s=2.0)
    esc.command(np.array([[0.0, 50.0], [50.0, 0.0]]))
    esc.advance(2.0)
    np.testing.assert_array_equal(esc.armed, [[True, False], [False, True]])
    np.testing.assert_array_equal(esc.command(np.full((2, 2), 50.0)), [[50.0, 0.0], [0.0, 50.0]])
