"""The model of unmeasured motors, against Euler steps of its differential equation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin import robots
from tsd_twin.estimation import WheelSpeedModel
from tsd_twin.robots import RPM

ROBOT = robots.load_robot("tsd")
MOTOR, LAW = ROBOT.motor, ROBOT.spin_up()
CRUISE = 2500.0 * RPM

setpoints = st.sampled_from([0.0, CRUISE, 3000.0 * RPM, 1900.0 * RPM, 13_000.0 * RPM])


@given(
    script=st.lists(
        st.tuples(st.lists(setpoints, min_size=3, max_size=3), st.floats(0.01, 0.4)), max_size=5
    )
)
def test_it_follows_the_differential_equation(script: list[tuple[list[float], float]]) -> None:
    model = WheelSpeedModel(LAW, 3)
    euler, steps = np.zeros(3), 1000
    for wanted, dt_s in script:
        model.advance(np.array(wanted), dt_s)
        goal = np.array([w if w >= MOTOR.start_speed_rpm * RPM else 0.0 for w in wanted])
        tau = np.where(goal > euler, MOTOR.time_constant_up_s, MOTOR.time_constant_down_s)
        for _ in range(steps):
            euler = euler + (goal - euler) / tau * dt_s / steps
    np.testing.assert_allclose(model.spin_rad_per_s, euler, atol=1e-3 * 13_000 * RPM)


@given(wanted=setpoints, first=setpoints, cut=st.floats(0.01, 0.99))
def test_two_short_steps_are_one_long_step(wanted: float, first: float, cut: float) -> None:
    whole, halves = WheelSpeedModel(LAW, 1), WheelSpeedModel(LAW, 1)
    for model in (whole, halves):
        model.advance(np.array([first]), 0.1)
    whole.advance(np.array([wanted]), 0.3)
    halves.advance(np.array([wanted]), 0.3 * cut)
    halves.advance(np.array([wanted]), 0.3 * (1.0 - cut))
    np.testing.assert_allclose(whole.spin_rad_per_s, halves.spin_rad_per_s, rtol=1e-12, atol=1e-12)


def test_a_motor_told_less_than_it_can_turn_stands_still() -> None:
    model = WheelSpeedModel(LAW, 1)
    assert model.advance(np.array([1999.0 * RPM]), 10.0)[0] == 0.0
    assert model.advance(np.array([2001.0 * RPM]), 10.0)[0] == pytest.approx(2001.0 * RPM)


def test_wheels_speed_up_and_run_down_with_their_own_time_constants() -> None:
    model = WheelSpeedModel(LAW, 1)
    up = model.advance(np.array([CRUISE]), MOTOR.time_constant_up_s)[0]
    assert up == pytest.approx(CRUISE * (1.0 - np.exp(-1.0)))
    model.advance(np.array([CRUISE]), 100.0)
    down = model.advance(np.array([0.0]), MOTOR.time_constant_down_s)[0]
    assert down == pytest.approx(CRUISE * np.exp(-1.0))


def test_speeds_that_are_settled_are_predicted_anew_for_another_set_point_or_time() -> None:
    model = WheelSpeedModel(LAW, 1)
    set_point, other = np.array([300.0]), np.array([250.0])
    for _ in range(2000):
        model.advance(set_point, 0.01)
    settled = model.after(set_point, 0.05)
    assert settled == pytest.approx(300.0)
    slower, slowest = model.after(other, 0.05), model.after(other, 0.5)
    assert 250.0 < slowest[0] < slower[0] < 300.0
    model.advance(other, 0.05)
    assert model.spin_rad_per_s == pytest.approx(slower)
    assert model.after(other, 0.05)[0] < slower[0]
