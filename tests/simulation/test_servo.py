"""The servo model against small steps of its differential equation, and its properties."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.lie import Array
from tsd_twin.robots import load_robot
from tsd_twin.simulation import Servos

MX64 = Servos.of(load_robot("tsd").with_errors(0.0), battery_v=12.0)

angles = st.builds(
    lambda angle, scale: angle * scale,
    st.floats(-3.0, 3.0, allow_subnormal=False),
    st.sampled_from([1.0, 1e-2, 1e-6, 1e-12, 0.0]),
).map(np.array)
times = st.floats(0.0, 1.0).map(np.array)


def in_small_steps(angle: Array, goal: Array, elapsed_s: Array, steps: int = 4000) -> Array:
    """Euler's method on: rate = gain x error, up to the limit."""
    dt_s = elapsed_s / steps
    for _ in range(steps):
        rate = np.clip(32.0 * (goal - angle), -63.0 * np.pi / 30.0, 63.0 * np.pi / 30.0)
        angle = angle + rate * dt_s
    return angle


def test_motion_solves_the_differential_equation() -> None:
    """With 63 rpm and 32 /s, the values of the MX-64, to first order in the step."""
    random = np.random.default_rng(0)
    angle, goal = random.uniform(-1.0, 1.0, size=(2, 300))
    elapsed_s = random.uniform(0.0, 0.3, size=300)
    exact = MX64.after(angle, goal, elapsed_s)
    coarse = in_small_steps(angle, goal, elapsed_s)
    fine = in_small_steps(angle, goal, elapsed_s, steps=8000)
    np.testing.assert_allclose(2.0 * fine - coarse, exact, rtol=0, atol=2e-6)
    assert np.abs(fine - exact).max() < 1e-3


@given(angle=angles, goal=angles, first=times, second=times)
def test_two_steps_are_one_long_one(angle: Array, goal: Array, first: Array, second: Array) -> None:
    halfway = MX64.after(angle, goal, first)
    np.testing.assert_allclose(
        MX64.after(halfway, goal, second),
        MX64.after(angle, goal, first + second),
        rtol=0,
        atol=1e-13 * np.abs([angle, goal]).max(),
    )


@given(angle=angles, goal=angles, elapsed_s=times)
def test_a_servo_is_never_too_fast_and_never_overshoots(
    angle: Array, goal: Array, elapsed_s: Array
) -> None:
    after = MX64.after(angle, goal, elapsed_s)
    rounding = 1e-15 * np.abs([angle, goal]).max()
    assert np.abs(after - angle) <= MX64.speed_limit_rad_per_s * elapsed_s + rounding
    assert min(angle, goal) - rounding <= after <= max(angle, goal) + rounding


@given(angle=angles)
def test_a_servo_at_its_goal_stays(angle: Array) -> None:
    assert MX64.after(angle, angle, np.array(10.0)) == angle
    assert MX64.rate(angle, angle) == 0.0


@given(angle=angles, goal=angles)
def test_rate_is_the_slope_of_the_motion(angle: Array, goal: Array) -> None:
    h = 1e-7
    rate = MX64.rate(angle, goal)
    slope = (MX64.after(angle, goal, np.array(h)) - angle) / h
    assert slope == pytest.approx(float(rate), rel=1e-5, abs=1e-8)
    assert abs(rate) <= MX64.speed_limit_rad_per_s


def test_the_goal_is_reached() -> None:
    """Half a turn at 63 rpm takes 0.48 s, and the rest decays at 32 /s."""
    after = MX64.after(np.array(0.0), np.array(np.pi), np.array([0.4, 2.0]))
    assert after[0] == pytest.approx(0.4 * 63.0 * np.pi / 30.0)
    assert after[1] == pytest.approx(np.pi, abs=1e-12)


@given(angle=angles)
def test_steps_are_the_4096th_part_of_a_turn(angle: Array) -> None:
    quantised = MX64.quantise(angle)
    steps = quantised / (2.0 * np.pi / 4096)
    assert steps == pytest.approx(round(float(steps)), abs=1e-9)
    assert np.degrees(abs(quantised - angle)) <= 0.0879 / 2.0 + 1e-9


@given(setpoint=angles)
def test_a_goal_is_a_step_within_the_tilt_limit(setpoint: Array) -> None:
    goal = MX64.goal(setpoint)
    assert goal == MX64.quantise(goal)
    assert np.degrees(abs(goal)) <= 30.0
    if np.degrees(abs(setpoint)) < 29.9:
        assert goal == MX64.quantise(setpoint)
    else:
        assert np.degrees(abs(goal)) > 29.8
        assert np.sign(goal) == np.sign(setpoint)


def test_top_speed_follows_the_battery() -> None:
    tired = Servos.of(load_robot("tsd").with_errors(0.0), battery_v=9.0)
    assert tired.speed_limit_rad_per_s == pytest.approx(0.75 * MX64.speed_limit_rad_per_s)
