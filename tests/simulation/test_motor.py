"""The motors against the table of the thesis and a first-order lag."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.lie import Array
from tsd_twin.robots import load_robot
from tsd_twin.simulation import Motors

ROBOT = load_robot("tsd")
MOTORS = Motors.of(ROBOT)
RPM = 2.0 * np.pi / 60.0

TABLE_1 = np.array(
    [
        [0, 0, 0, 0],
        [20, 0, 0, 0],
        [40, 2892, 2938, 2856],
        [60, 4137, 4762, 4322],
        [80, 5895, 5768, 6147],
        [100, 7264, 7019, 7121],
        [120, 8419, 9016, 8804],
        [140, 10113, 10205, 10353],
        [160, 11927, 11898, 11785],
        [180, 13603, 13445, 13409],
    ],
    dtype=float,
)
"""Carothers 2014: signal, and speed in rpm of motors 1, 2 and 3."""


def test_the_motors_turn_as_measured() -> None:
    for signal, *speeds in TABLE_1:
        np.testing.assert_allclose(MOTORS.speed(np.full(3, signal)) / RPM, speeds, rtol=1e-12)


def test_between_rows_the_curve_is_straight() -> None:
    middle = MOTORS.speed(np.full(3, 70.0)) / RPM
    np.testing.assert_allclose(middle, TABLE_1[3:5, 1:].mean(axis=0), rtol=1e-12)


@given(st.floats(0.0, 180.0))
def test_a_motor_stands_still_below_its_starting_speed(signal: float) -> None:
    on_curve = np.array([np.interp(signal, TABLE_1[:, 0], column) for column in TABLE_1[:, 1:].T])
    expected = np.where(on_curve < 2000.0, 0.0, on_curve)
    np.testing.assert_allclose(MOTORS.speed(np.full(3, signal)) / RPM, expected, rtol=1e-12)


@given(speeds=st.tuples(*[st.floats(2000.0, 13400.0)] * 3))
def test_calibration_makes_every_motor_turn_as_commanded(
    speeds: tuple[float, float, float],
) -> None:
    commanded = np.array(speeds) * RPM
    np.testing.assert_allclose(MOTORS.speed(MOTORS.signal(commanded)), commanded, rtol=1e-12)


def test_the_cruising_speed_is_reached_exactly() -> None:
    cruise = np.full(3, ROBOT.drive.cruise_speed_rpm * RPM)
    np.testing.assert_allclose(MOTORS.speed(MOTORS.signal(cruise)), cruise, rtol=1e-14)


@pytest.mark.parametrize("speed", [0.0, -1.0, -1e4, -0.0])
def test_no_speed_is_zero_throttle(speed: float) -> None:
    np.testing.assert_array_equal(MOTORS.signal(np.full(3, speed)), 0.0)
    np.testing.assert_array_equal(MOTORS.pulse_us(MOTORS.signal(np.full(3, speed))), 1000.0)


def test_more_than_a_motor_has_is_full_throttle() -> None:
    np.testing.assert_array_equal(MOTORS.signal(np.full(3, 1e5)), 180.0)
    np.testing.assert_array_equal(MOTORS.pulse_us(np.array([0.0, 90.0, 180.0])), [1e3, 1.5e3, 2e3])


def test_motors_in_a_batch_keep_their_own_curves() -> None:
    random = np.random.default_rng(0)
    signals = random.uniform(0.0, 180.0, size=(4, 5, 3))
    speeds = MOTORS.speed(signals)
    back = MOTORS.signal(speeds)
    for at in np.ndindex(4, 5):
        np.testing.assert_array_equal(speeds[at], MOTORS.speed(signals[at]))
        np.testing.assert_array_equal(back[at], MOTORS.signal(speeds[at]))


speeds_rad_per_s = st.floats(0.0, 1500.0).map(np.array)
times = st.floats(0.0, 2.0).map(np.array)


def test_spinning_up_and_down_solves_the_equation_of_a_lag() -> None:
    """Against extrapolated Euler steps, with the time constants of the description."""
    random = np.random.default_rng(1)
    start, goal = random.uniform(0.0, 1400.0, size=(2, 200))
    elapsed_s = random.uniform(0.0, 1.0, size=200)

    def in_small_steps(steps: int) -> Array:
        speed = start
        for _ in range(steps):
            lag_s = np.where(
                goal > speed, ROBOT.motor.time_constant_up_s, ROBOT.motor.time_constant_down_s
            )
            speed = speed + (goal - speed) / lag_s * (elapsed_s / steps)
        return speed

    extrapolated = 2.0 * in_small_steps(4000) - in_small_steps(2000)
    np.testing.assert_allclose(
        extrapolated, MOTORS.after(start, goal, elapsed_s), rtol=0, atol=1e-2
    )


@given(speed=speeds_rad_per_s, goal=speeds_rad_per_s, first=times, second=times)
def test_two_steps_are_one_long_one(speed: Array, goal: Array, first: Array, second: Array) -> None:
    halfway = MOTORS.after(speed, goal, first)
    assert min(speed, goal) - 1e-11 <= halfway <= max(speed, goal) + 1e-11
    np.testing.assert_allclose(
        MOTORS.after(halfway, goal, second),
        MOTORS.after(speed, goal, first + second),
        rtol=0,
        atol=1e-11,
    )
