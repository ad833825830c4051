"""Whether modules that contradict one another are noticed, and the right one is named."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tsd_twin import robots
from tsd_twin.estimation import ConsistencyMonitor, ConsistencyResult
from tsd_twin.lie import Array
from tsd_twin.robots import JointErrors

ROBOT = robots.load_robot("tsd")
DRIVE = ROBOT.kinematics()

components = st.floats(-0.7, 0.7)
twists = st.tuples(components, components, st.floats(-2.0, 2.0)).map(np.array)


def watched(joints: Array, seconds: float = 1.0) -> ConsistencyResult:
    monitor = ConsistencyMonitor(DRIVE, ROBOT.joint_errors())
    for _ in range(round(seconds / 0.01)):
        monitor.advance(DRIVE.forward(joints).residual, 0.01)
    return monitor.judge(joints)


@given(twist=twists)
def test_modules_that_agree_are_no_evidence(twist: Array) -> None:
    verdict = watched(DRIVE.inverse(twist))
    assert verdict.residual_mps < 1e-12
    assert verdict.level < 1e-9
    assert not verdict.exceeds_threshold
    assert verdict.suspect is None


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
    explained = DRIVE.fault_contribution(DRIVE.forward(joints).residual)
    assert explained.argmax() == module
    # One joint of another module may explain as much as both of this: then nobody can tell.
    assume(np.delete(explained, module).max() < 0.98 * explained[module])
    verdict = watched(joints)
    assert verdict.suspect == module
    # What it alone explains is all there is to explain.
    assert verdict.shares[module] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("module", [0, 1, 2])
@pytest.mark.parametrize("twist", [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 3.0]])
def test_a_module_stuck_at_neutral_is_evident_within_a_tenth_of_a_second(
    module: int, twist: list[float]
) -> None:
    joints = DRIVE.inverse(np.array(twist))
    joints[3 * module : 3 * module + 2] = 0.0
    assert watched(joints, 0.1).suspect == module


def test_a_wheel_that_spins_at_another_speed_is_blamed() -> None:
    joints = DRIVE.inverse(np.array([0.8, 0.3, 0.5]))
    joints[5] *= 0.6
    assert watched(joints).suspect == 1


def test_noise_of_the_known_size_is_no_evidence() -> None:
    """Drawn anew in each period, or lasting for a minute: neither is a fault."""
    random = np.random.default_rng(0)
    joints = DRIVE.inverse(np.array([0.6, 0.2, 0.5]))
    sigma = np.tile([np.radians(0.025)] * 2 + [0.01 * DRIVE.spin_rad_per_s], 3)
    monitor = ConsistencyMonitor(DRIVE, ROBOT.joint_errors())
    for _ in range(1000):
        wrong = joints + sigma * random.standard_normal(9)
        monitor.advance(DRIVE.forward(wrong).residual, 0.01)
        assert not monitor.judge(joints).exceeds_threshold
        assert not watched(wrong, 0.01).exceeds_threshold


def test_the_residual_is_a_root_mean_square_smoothed_over_a_tenth_of_a_second() -> None:
    monitor = ConsistencyMonitor(DRIVE, JointErrors())
    joints = DRIVE.inverse(np.zeros(3))
    residual = np.array([3.0, -4.0, 0.0, 0.0, 0.0, 0.0])
    assert monitor.judge(joints).residual_mps == 0.0
    monitor.advance(residual, 0.1)
    expected = (1.0 - np.exp(-1.0)) * 5.0 / 6.0**0.5
    assert monitor.judge(joints).residual_mps == pytest.approx(expected)
    monitor.advance(residual, 100.0)
    assert monitor.judge(joints).residual_mps == pytest.approx(5.0 / 6.0**0.5)
    for _ in range(10):
        monitor.advance(0.0 * residual, 0.01)
    expected = np.exp(-1.0) * 5.0 / 6.0**0.5
    assert monitor.judge(joints).residual_mps == pytest.approx(expected)
