"""Constant twist errors are estimated from poses, at any delay."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from tsd_twin.estimation import DriftFilter
from tsd_twin.lie import SE2, Array

DT_S = 0.01
SIGMA = np.array([0.01, 0.003, 0.003, 0.002])
"""Speed scale, two creep velocities, gyro bias."""
CAMERA = np.diag([0.005, 0.005, 0.02]) ** 2


def by_errors(twist: Array) -> Array:
    return np.column_stack([twist * [1.0, 1.0, 0.0], np.eye(3)])


def wander(random: np.random.Generator, steps: int = 300) -> Array:
    """Smoothly varying twists (n, 3)."""
    t = DT_S * np.arange(steps)[:, None]
    return random.uniform(0.3, 1.0, 3) * np.sin(random.uniform(1, 4, 3) * t + random.normal(size=3))


def ride(
    filtered: DriftFilter,
    random: np.random.Generator,
    errors: Array,
    *,
    noise: float = 0.0,
    walk: float = 0.0,
    late: int = 0,
) -> SE2:
    """Drive; every fourth pose is delivered `late` steps later. Return the true pose."""
    pose, seen = SE2.identity(), dict[int, Array]()
    growth = np.diag([walk, walk, 0.1 * walk]) ** 2
    for i, twist in enumerate(wander(random)):
        true = twist + by_errors(twist) @ errors
        true = true + np.sqrt(np.diag(growth) / DT_S) * random.standard_normal(3)
        pose = pose @ SE2.exp(DT_S * true)
        filtered.advance((i + 1) * DT_S, twist, by_errors(twist), growth)
        if i % 4 == 0:
            seen[i] = pose.xy_heading + noise * np.sqrt(np.diag(CAMERA)) * random.standard_normal(3)
        if i - late in seen:
            assert filtered.fuse_pose(SE2(seen[i - late]), CAMERA, (i - late + 1) * DT_S)
    return pose


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10)
def test_without_noise_the_errors_are_found(seed: int) -> None:
    random = np.random.default_rng(seed)
    errors = SIGMA * random.standard_normal(4)
    filtered = DriftFilter(SE2.identity(), 1e4 * SIGMA)
    true = ride(filtered, random, errors, late=8)
    # The sensitivities are linearized, so the remaining error grows with the errors squared.
    second_order = max(1.0, float(np.abs(errors / SIGMA).max())) ** 2
    np.testing.assert_allclose(filtered.errors, errors, atol=0.02 * second_order * SIGMA.min())
    np.testing.assert_allclose(filtered.pose.xy_heading, true.xy_heading, atol=1e-4 * second_order)


def test_once_all_poses_are_there_it_does_not_matter_how_late_they_came() -> None:
    random = np.random.default_rng(5)
    twists = wander(random, 100)
    late_ones = DriftFilter(SE2.identity(), SIGMA)
    in_time = DriftFilter(SE2.identity(), SIGMA)
    poses = random.normal(scale=0.005, size=(20, 3))
    for i, twist in enumerate(twists):
        for filtered in (late_ones, in_time):
            filtered.advance((i + 1) * DT_S, twist, by_errors(twist), 1e-6 * np.eye(3))
        if i % 5 == 4:
            in_time.fuse_pose(SE2(poses[i // 5]), CAMERA, (i + 1) * DT_S)
    for k, pose in enumerate(poses):
        late_ones.fuse_pose(SE2(pose), CAMERA, (5 * k + 5) * DT_S)
    np.testing.assert_allclose(late_ones.pose.xy_heading, in_time.pose.xy_heading, atol=1e-12)
    np.testing.assert_allclose(late_ones.error_covariance, in_time.error_covariance, atol=1e-15)


def test_it_is_as_sure_as_it_should_be() -> None:
    """Normalized squared errors of 60 robots are chi-square, with four errors each."""
    total, robots = 0.0, 60
    for seed in range(robots):
        random = np.random.default_rng(seed)
        errors = SIGMA * random.standard_normal(4)
        filtered = DriftFilter(SE2.identity(), SIGMA)
        ride(filtered, random, errors, noise=1.0, walk=0.001, late=8)
        off = filtered.errors - errors
        total += float(off @ np.linalg.solve(filtered.error_covariance, off))
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], 4 * robots)
    assert low < total < high


def test_what_is_too_old_out_of_order_or_no_number_is_left_out() -> None:
    filtered = DriftFilter(SE2.identity(), SIGMA, memory_s=0.5)
    for i in range(100):
        filtered.advance((i + 1) * DT_S, np.zeros(3), np.zeros((3, 4)), 1e-6 * np.eye(3))
    pose = SE2(np.array([0.01, 0.0, 0.0]))
    assert not filtered.fuse_pose(pose, CAMERA, 0.3)
    assert not filtered.fuse_pose(SE2(np.array([np.nan, 0.0, 0.0])), CAMERA, 0.9)
    assert filtered.pose.xy_heading == pytest.approx(0.0)
    assert filtered.fuse_pose(pose, CAMERA, 0.9)
    assert not filtered.fuse_pose(pose, CAMERA, 0.8)
    assert filtered.fuse_pose(pose, CAMERA, 2.0), "from a clock that is ahead: now"
    assert 0.0 < filtered.pose.xy_heading[0] < 0.01


def test_headings_are_compared_around_the_circle() -> None:
    filtered = DriftFilter(SE2(np.array([0.0, 0.0, 3.1])), SIGMA)
    filtered.advance(1.0, np.zeros(3), np.zeros((3, 4)), 1e-2 * np.eye(3))
    filtered.fuse_pose(SE2(np.array([0.0, 0.0, -3.1])), CAMERA, 1.0)
    assert filtered.pose.xy_heading[2] == pytest.approx(2 * np.pi - 3.1, abs=0.01)
