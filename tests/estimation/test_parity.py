"""The chi-square test meets its false-alarm rate and misses no fault."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import chi2, ncx2

from tsd_twin import robots
from tsd_twin.estimation.consistency import ParityTest, chi_square_bound
from tsd_twin.kinematics import SingularityKinematics
from tsd_twin.lie import Array

DRIVE = robots.load_robot("tsd").kinematics()
RIM_MPS = 0.04 * 2500.0 * np.pi / 30.0
WHEELS = np.array([False, False, True] * 3)


def sigmas(tilt_deg: float) -> Array:
    return np.where(WHEELS, 0.0, np.radians(tilt_deg))


def residuals(joints: Array, sigma: Array, runs: int, seed: int, samples: int = 1) -> Array:
    """Means of `samples` residuals, simulated by reducing the noise (valid for small angles)."""
    noise = np.random.default_rng(seed).standard_normal((runs, len(joints)))
    return DRIVE.forward(joints + sigma / np.sqrt(samples) * noise).residual


def directions(count: int) -> list[Array]:
    angles = np.linspace(0.0, 2 * np.pi, count, endpoint=False)
    return [np.array([np.cos(angle), np.sin(angle), 0.0]) for angle in angles]


def test_the_threshold_is_that_of_three_degrees_of_freedom() -> None:
    test = ParityTest.at(DRIVE, DRIVE.inverse(np.array([1.0, 0, 0])), sigmas(0.05))
    assert len(test.whiten) == 3
    assert test.threshold == pytest.approx(chi2.isf(1e-4, 3), rel=1e-9)


@pytest.mark.parametrize("dimensions", range(1, 13))
def test_a_bound_is_the_quantile_of_the_chi_square(dimensions: int) -> None:
    for beyond in (0.29, 0.05, 0.01, 1e-4, 1e-9):
        bound = chi_square_bound(dimensions, beyond)
        assert bound == pytest.approx(chi2.isf(beyond, dimensions), rel=1e-13)


@pytest.mark.parametrize("tilt_deg", [0.05, 0.3])
@pytest.mark.parametrize("twist", [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, -0.4, 1.5]])
def test_sound_robots_raise_one_false_alarm_in_ten_thousand(
    twist: list[float], tilt_deg: float
) -> None:
    joints, sigma = DRIVE.inverse(np.array(twist)), sigmas(tilt_deg) + 0.005 * WHEELS * 262.0
    test = ParityTest.at(DRIVE, joints, sigma)
    statistic = test.statistic(residuals(joints, sigma, 400_000, seed=1))
    assert statistic.mean() == pytest.approx(3.0, rel=0.02)
    # 40 are expected; a random count is outside these bounds once in a million runs.
    assert 14 <= (statistic > test.threshold).sum() <= 78


@pytest.mark.parametrize(
    ("tilt_deg", "slower", "samples"),
    [
        (0.05, 0.10, 1),
        (0.05, 0.035, 10),
        (0.05, 0.02, 25),
        (0.3, 0.57, 1),
        (0.3, 0.185, 10),
        (0.3, 0.115, 25),
    ],
)
def test_a_slow_wheel_is_found_in_95_of_100_cases_in_every_direction(
    tilt_deg: float, slower: float, samples: int
) -> None:
    """One wheel is measured slower than the others, at 1 m/s and 2,500 rpm."""
    sigma = sigmas(tilt_deg)
    for twist in directions(12):
        for module in range(3):
            joints = DRIVE.inverse(twist)
            joints[3 * module + 2] *= 1.0 - slower
            test = ParityTest.at(DRIVE, joints, sigma)
            found = residuals(joints, sigma, 4000, seed=module, samples=samples)
            exceeds = samples * test.statistic(found) > test.threshold
            assert exceeds.mean() >= 0.95
            joint = test.single_faults(found[exceeds])[0].argmax(axis=-1)
            assert (joint // 3 == module).mean() >= 0.97


@pytest.mark.parametrize(("slower", "least", "most"), [(0.12, 0.94, 1.0), (0.10, 0.7, 0.94)])
def test_wheel_speeds_that_are_one_percent_off_cost_power(
    slower: float, least: float, most: float
) -> None:
    """12 % is found in 95 of 100 cases in every direction; 10 % not in all."""
    sigma = sigmas(0.05) + 0.01 * WHEELS * DRIVE.spin_rad_per_s
    found: list[float] = []
    for twist in directions(12):
        joints = DRIVE.inverse(twist)
        joints[2] *= 1.0 - slower
        test = ParityTest.at(DRIVE, joints, sigma)
        runs = residuals(joints, sigma, 3000, seed=4)
        found.append(float((test.statistic(runs) > test.threshold).mean()))
    assert least <= min(found) <= most


@pytest.mark.parametrize("samples", [1, 10, 25])
def test_the_least_fault_that_is_found_is_that_of_the_chi_square_bound(samples: int) -> None:
    """By hand: for a fault across its arm, a third of the square is in the parity space."""
    length = brentq(lambda x: ncx2.sf(chi2.isf(1e-4, 3), 3, x) - 0.95, 1.0, 200.0)
    sigma = np.radians(0.05)
    least = np.sqrt(3.0 * length / samples) * RIM_MPS * sigma
    assert least == pytest.approx(0.0957 / np.sqrt(samples), rel=1e-3)
    joints = DRIVE.inverse(np.array([1.0, 0.0, 0.0]))
    test = ParityTest.at(DRIVE, joints, sigmas(0.05))
    # The first module is on the left, so forward is across its arm. A tilt error of that size.
    sound = residuals(joints, sigmas(0.05), 40_000, seed=2, samples=samples)
    fault = np.zeros(6)
    fault[0] = least
    projected = fault - DRIVE.contact_from_twist.reshape(6, 3) @ DRIVE.twist_from_contacts @ fault
    assert projected @ projected == pytest.approx(least**2 / 3.0)
    exceeds = samples * test.statistic(sound + projected) > test.threshold
    assert exceeds.mean() == pytest.approx(0.95, abs=0.006)


def test_the_noise_of_wheels_counts_along_the_way_only() -> None:
    joints = DRIVE.inverse(np.array([1.0, 0.0, 0.0]))
    quiet = ParityTest.at(DRIVE, joints, sigmas(0.05))
    noisy = ParityTest.at(DRIVE, joints, sigmas(0.05) + WHEELS * 0.05 * joints)
    slow, tilted = joints.copy(), joints.copy()
    slow[2] *= 0.8
    tilted[0] += 0.05
    for wrong, least in ((slow, 3.0), (tilted, 1.0)):
        residual = DRIVE.forward(wrong).residual
        assert quiet.statistic(residual) > least * noisy.statistic(residual)


def test_two_modules_have_one_number_too_many_and_still_test_it() -> None:
    drive = SingularityKinematics(np.array([0.0, np.pi]), 0.15, 0.04, 262.0, 0.5, 6.6)
    joints = drive.inverse(np.array([0.5, 0.2, 0.1]))
    sigma = np.array([1e-3, 1e-3, 0.0] * 2)
    test = ParityTest.at(drive, joints, sigma)
    assert len(test.whiten) == 1
    noise = np.random.default_rng(0).standard_normal((20_000, 6))
    statistic = test.statistic(drive.forward(joints + sigma * noise).residual)
    assert statistic.mean() == pytest.approx(1.0, rel=0.03)


def test_without_any_noise_rounding_is_no_evidence() -> None:
    joints = DRIVE.inverse(np.array([0.7, -0.3, 1.0]))
    test = ParityTest.at(DRIVE, joints, np.zeros(9))
    assert test.statistic(DRIVE.forward(joints).residual) <= test.threshold
    joints[4] += 1e-3
    assert test.statistic(DRIVE.forward(joints).residual) > test.threshold
