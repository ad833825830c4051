"""A smoothed profile is the running mean of the original, from rest to rest, with less jerk."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.motion.random_paths import SQUARE
from tsd_twin import robots
from tsd_twin.lie import Array
from tsd_twin.motion.paths import line, polyline
from tsd_twin.motion.routes import Route
from tsd_twin.motion.trajectory import Trajectory, plan, smoothed

ROBOT = robots.load_robot("tsd")
DRIVE, LIMITS = ROBOT.kinematics(), ROBOT.limits
H_S = 1e-4


def speeds(trajectory: Trajectory, t_s: Array) -> Array:
    return np.hypot(*np.moveaxis(trajectory.at(t_s).twist[..., :2], -1, 0))


@settings(max_examples=8)
@given(st.floats(0.3, 3.0), st.floats(0.01, 0.3))
def test_speed_is_the_running_mean(length_m: float, over_s: float) -> None:
    route = Route(line([0.0, 0.0], [length_m, 0.0]))
    plain = plan(route, DRIVE, LIMITS)
    smooth = plan(route, DRIVE, LIMITS, smooth_s=over_s)
    assert smooth.duration_s == pytest.approx(plain.duration_s + over_s)
    for t_s in np.linspace(0.0, smooth.duration_s, 23):
        window = t_s - over_s * (np.arange(4000) + 0.5) / 4000
        mean = float(speeds(plain, window).mean())
        assert float(speeds(smooth, t_s)) == pytest.approx(mean, abs=0.02)
    assert smooth.at(smooth.duration_s).pose == pytest.approx(plain.at(9e9).pose)


@pytest.mark.parametrize("length_m", [2.5, 4.8, 5.2])
def test_a_stop_is_exact_so_that_a_smoothed_trajectory_keeps_its_duration(length_m: float) -> None:
    """At these lengths, rounding left a final speed of 1e-10 m/s, and the duration became zero."""
    route = Route(line([0.0, 0.0], [length_m, 0.0]))
    plain = plan(route, DRIVE, LIMITS)
    assert plain.profile.speed_mps[-1] == 0.0
    smooth = plan(route, DRIVE, LIMITS, smooth_s=0.05)
    assert smooth.duration_s == pytest.approx(plain.duration_s + 0.05)


def test_acceleration_is_no_more_than_before_and_does_not_jump() -> None:
    route, over_s = Route(polyline(SQUARE)), 0.05
    plain = plan(route, DRIVE, LIMITS)
    smooth = plan(route, DRIVE, LIMITS, smooth_s=over_s)
    # Four sides, with a stop at each corner.
    assert smooth.duration_s == pytest.approx(plain.duration_s + 4 * over_s)
    most = np.abs(plain.profile.acceleration_mps2).max()
    t_s = np.arange(0.0, smooth.duration_s, H_S)
    acceleration = np.diff(speeds(smooth, t_s)) / H_S
    assert np.abs(acceleration).max() < 1.001 * most
    jerk = np.abs(acceleration[20:] - acceleration[:-20]) / (20 * H_S)
    # Within a cell of the profile it may jump slightly.
    assert jerk.max() < 2.2 * most / over_s
    poses = smooth.at(t_s).pose
    moved = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    np.testing.assert_allclose(moved / H_S, speeds(smooth, t_s[:-1] + 0.5 * H_S), atol=2e-3)
    at_corners = smooth.profile.s_m[smooth.profile.speed_mps == 0.0]
    np.testing.assert_allclose(at_corners, [0.0, 1.0, 2.0, 3.0, 4.0], atol=1e-9)


def test_over_no_time_it_is_the_same() -> None:
    profile = plan(Route(line([0.0, 0.0], [1.0, 0.0])), DRIVE, LIMITS).profile
    assert smoothed(profile, 0.0) is profile
