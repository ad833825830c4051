"""Whether modules that contradict one another are noticed, and the right one is named."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin import robots
from tsd_twin.estimation import ConflictMonitor
from tsd_twin.lie import Array

DRIVE = robots.load("tsd").kinematics()
SIGMA_MPS = 0.005

components = st.floats(-0.7, 0.7)
twists = st.tuples(components, components, st.floats(-2.0, 2.0)).map(np.array)


def watched(joints: Array, seconds: float = 1.0) -> ConflictMonitor:
    monitor = ConflictMonitor(SIGMA_MPS)
    for _ in range(round(seconds / 0.01)):
        monitor.advance(DRIVE.forward(joints).residual, 0.01)
    return monitor


@given(twist=twists)
def test_modules_that_agree_are_no_evidence(twist: Array) -> None:
    monitor = watched(DRIVE.inverse(twist))
    assert monitor.residual_mps < 1e-12
    assert not monitor.evident


@given(
    twist=twists,
    module=st.integers(0, 2),
    off_rad=st.tuples(*[st.floats(0.03, 0.2)] * 2),
    signs=st.tuples(*[st.sampled_from([-1.0, 1.0])] * 2),
)
def test_a_jammed_module_is_blamed(
    twist: Array, module: int, off_rad: tuple[float, float], signs: tuple[float, float]
) -> None:
    """With three modules, two that agree outvote the third: four equations for three unknowns."""
    joints = DRIVE.inverse(twist)
    joints[3 * module : 3 * module + 2] += np.multiply(off_rad, signs)
    # Two modules see one component of the third only, along the line between the pivots.
    blame = DRIVE.blame(DRIVE.forward(joints).residual)
    monitor = watched(joints)
    if monitor.evident:
        assert monitor.residual is not None
        assert DRIVE.blame(monitor.residual).argmax() == module
    assert blame.argmax() == module


@pytest.mark.parametrize("module", [0, 1, 2])
@pytest.mark.parametrize("twist", [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 3.0]])
def test_a_module_stuck_at_neutral_is_evident_within_a_tenth_of_a_second(
    module: int, twist: list[float]
) -> None:
    joints = DRIVE.inverse(np.array(twist))
    joints[3 * module : 3 * module + 2] = 0.0
    monitor = watched(joints, 0.1)
    assert monitor.evident
    assert monitor.residual is not None
    assert DRIVE.blame(monitor.residual).argmax() == module


def test_a_wheel_that_spins_at_another_speed_is_blamed() -> None:
    joints = DRIVE.inverse(np.array([0.8, 0.3, 0.5]))
    joints[5] *= 0.6
    assert DRIVE.blame(watched(joints).residual).argmax() == 1


def test_noise_of_the_known_size_is_no_evidence() -> None:
    random = np.random.default_rng(0)
    monitor = ConflictMonitor(SIGMA_MPS)
    for _ in range(6000):
        monitor.advance(SIGMA_MPS * random.standard_normal(6), 0.01)
        assert not monitor.evident


def test_the_residual_is_a_root_mean_square_smoothed_over_a_tenth_of_a_second() -> None:
    monitor = ConflictMonitor(SIGMA_MPS)
    residual = np.array([3.0, -4.0, 0.0, 0.0, 0.0, 0.0])
    monitor.advance(residual, 0.1)
    assert monitor.residual_mps == pytest.approx((1.0 - np.exp(-1.0)) * 5.0 / 6.0**0.5)
    monitor.advance(residual, 100.0)
    assert monitor.residual_mps == pytest.approx(5.0 / 6.0**0.5)
    for _ in range(10):
        monitor.advance(0.0 * residual, 0.01)
    assert monitor.residual_mps == pytest.approx(np.exp(-1.0) * 5.0 / 6.0**0.5)
