"""Regions contain the stated fraction of poses drawn from the covariance."""

from __future__ import annotations

import numpy as np
import pytest

from research.open_loop import encloses
from tsd_twin.estimation import (
    REGION_SHARE,
    exponential_error,
    heading_region_rad,
    position_region,
)
from tsd_twin.lie import SE2, Array

RUNS = 1500


def positions_after(covariance: Array, seed: int = 0) -> Array:
    """Return true positions (n, 2) relative to the estimate, for errors with this covariance."""
    random = np.random.default_rng(seed)
    # A constant twist for 1 s, as a robot drives it.
    return SE2.exp(random.multivariate_normal(np.zeros(3), covariance, RUNS)).xy_heading[:, :2]


@pytest.mark.parametrize(
    ("sigmas", "correlation"),
    [
        ([0.02, 0.3, 0.13], 0.95),
        ([0.8, 5.3, 0.54], 0.98),
        ([1.4, 5.3, 0.55], 0.95),
        ([0.2, 0.19, 0.27], 0.8),
        ([0.3, 0.3, 0.05], 0.0),
    ],
)
def test_the_bent_region_holds_86_percent(sigmas: list[float], correlation: float) -> None:
    """For robots that drove straight or turned, with an unknown turn rate."""
    covariance = np.diag(np.square(sigmas))
    covariance[1, 2] = covariance[2, 1] = correlation * sigmas[1] * sigmas[2]
    outline = position_region(covariance)
    share = np.mean([encloses(outline, point) for point in positions_after(covariance)])
    assert share == pytest.approx(REGION_SHARE, abs=0.035)


def test_an_ellipse_would_not_hold_them() -> None:
    """After 20 m, with a heading sigma of 0.5 rad."""
    covariance = np.diag(np.square([0.3, 5.3, 0.54]))
    covariance[1, 2] = covariance[2, 1] = 0.98 * 5.3 * 0.54
    positions = positions_after(covariance)
    straight = covariance * np.array([[1, 1, 0], [1, 1, 0], [0, 0, 1]])
    inside = [encloses(position_region(straight), point) for point in positions]
    assert np.mean(inside) < 0.6


def test_errors_of_the_test_are_those_of_the_messages() -> None:
    """Ensures that the test does not only agree with itself."""
    twist = np.array([2.0, 0.7, 0.4])
    error = exponential_error(SE2.identity(), SE2.exp(twist))
    np.testing.assert_allclose(error, twist, atol=1e-12)


def test_exact_numbers_have_no_extent_and_no_rounding() -> None:
    assert not position_region(np.zeros((3, 3))).any()
    assert heading_region_rad(np.zeros((3, 3))) == 0.0
    outline = position_region(np.diag([0.01, 0.0, 0.0]))
    assert np.isfinite(outline).all()
    assert np.abs(outline[:, 0]).max() == pytest.approx(0.2)


def test_a_wide_heading_is_half_a_turn_to_either_side() -> None:
    assert heading_region_rad(np.diag([0.0, 0.0, 100.0])) == np.pi


def test_a_point_is_inside_of_an_outline_in_either_sense() -> None:
    square = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])
    for outline in (square, square[::-1]):
        assert encloses(outline, np.array([1.5, 0.5]))
        assert not encloses(outline, np.array([1.5, 1.5]))
