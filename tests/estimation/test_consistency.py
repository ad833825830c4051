"""Inconsistent modules are detected, and the faulty one is named."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tsd_twin import robots
from tsd_twin.estimation import ConsistencyMonitor, ConsistencyResult
from tsd_twin.lie import Array
from tsd_twin.robots import JointCompliance, JointErrors

ROBOT = robots.load_robot("tsd")
DRIVE = ROBOT.kinematics()

components = st.floats(-0.7, 0.7)
twists = st.tuples(components, components, st.floats(-2.0, 2.0)).map(np.array)


def watched(joints: Array, seconds: float = 1.0) -> ConsistencyResult:
    monitor = ConsistencyMonitor(DRIVE, ROBOT.joint_errors())
    for _ in range(round(seconds / 0.01)):
        monitor.advance(joints, 0.01)
    return monitor.judge(joints)


@given(twist=twists)
def test_modules_that_agree_are_no_evidence(twist: Array) -> None:
    verdict = watched(DRIVE.inverse(twist))
    assert verdict.residual_mps < 1e-12
    assert verdict.level < 1e-9
    assert verdict.level <= 1.0
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
    """With three modules, two that agree outvote the third: four equations, three unknowns."""
    joints = DRIVE.inverse(twist)
    joints[3 * module : 3 * module + 2] += np.multiply(off_rad, signs)
    # Two modules see only one component of the third, along the line between the pivots.
    explained = DRIVE.fault_contribution(DRIVE.forward(joints).residual)
    assert explained.argmax() == module
    # One joint of another module may explain as much as both of this one, which is ambiguous.
    assume(np.delete(explained, module).max() < 0.98 * explained[module])
    verdict = watched(joints)
    assert verdict.suspect == module
    # This module alone explains the whole residual.
    assert verdict.shares[module] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("module", [0, 1, 2])
@pytest.mark.parametrize("twist", [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 3.0]])
def test_a_module_stuck_at_neutral_is_evident_within_a_tenth_of_a_second(
    module: int, twist: list[float]
) -> None:
    joints = DRIVE.inverse(np.array(twist))
    joints[3 * module : 3 * module + 2] = 0.0
    verdict = watched(joints, 0.1)
    assert verdict.level > 1.0
    # Along the line between two pivots either module explains the residual, so none is named.
    alike = np.flatnonzero(verdict.shares > verdict.shares[module] - 1e-6)
    assert verdict.shares[module] == pytest.approx(1.0, abs=1e-6)
    assert verdict.suspect == (module if len(alike) == 1 else None)
    assert len(alike) <= (2 if twist[1] else 1)


@pytest.mark.parametrize("name", ["omni4", "mecanum"])
@pytest.mark.parametrize("wheel", range(4))
@pytest.mark.parametrize("twist", [[0.6, 0.2, 0.5], [-0.2, 0.7, 0.0]])
def test_nobody_is_blamed_if_all_explain_it_alike(
    name: str, wheel: int, twist: list[float]
) -> None:
    """Four wheels have one residual, which any of them explains."""
    robot = robots.load_robot(name)
    kinematics = robot.kinematics()
    monitor = ConsistencyMonitor(kinematics, robot.joint_errors())
    joints = kinematics.inverse(np.array(twist))
    joints[wheel] *= 0.7
    for _ in range(100):
        monitor.advance(joints, 0.01)
    verdict = monitor.judge(joints)
    assert verdict.level > 1.0
    assert verdict.suspect is None


def test_a_wheel_that_spins_at_another_speed_is_blamed() -> None:
    joints = DRIVE.inverse(np.array([0.8, 0.3, 0.5]))
    joints[5] *= 0.6
    assert watched(joints).suspect == 1


def test_noise_of_the_known_size_is_no_evidence() -> None:
    """Neither white noise nor a constant error over a minute counts as a fault."""
    random = np.random.default_rng(0)
    joints = DRIVE.inverse(np.array([0.6, 0.2, 0.5]))
    sigma = np.tile([np.radians(0.025)] * 2 + [0.01 * DRIVE.spin_rad_per_s], 3)
    monitor = ConsistencyMonitor(DRIVE, ROBOT.joint_errors())
    for _ in range(1000):
        wrong = joints + sigma * random.standard_normal(9)
        monitor.advance(wrong, 0.01)
        assert monitor.judge(joints).level <= 1.0
        assert watched(wrong, 0.01).level <= 1.0


def test_the_residual_is_a_root_mean_square_smoothed_over_a_tenth_of_a_second() -> None:
    monitor = ConsistencyMonitor(DRIVE, JointErrors())
    sound = DRIVE.inverse(np.array([0.5, 0.0, 0.0]))
    joints = sound + np.eye(9)[0] * 0.05
    whole = np.sqrt(np.square(DRIVE.forward(joints).residual).mean())
    assert monitor.judge(joints).residual_mps == 0.0
    monitor.advance(joints, 0.1)
    expected = (1.0 - np.exp(-1.0)) * whole
    assert monitor.judge(joints).residual_mps == pytest.approx(expected)
    monitor.advance(joints, 100.0)
    assert monitor.judge(joints).residual_mps == pytest.approx(whole)
    for _ in range(10):
        monitor.advance(sound, 0.01)
    assert monitor.judge(sound).residual_mps == pytest.approx(np.exp(-1.0) * whole)


COMPLIANCE = ROBOT.joint_compliance()
MODELLED = np.tile([False, False, True], 3)
GIMBALS = [0, 1, 3, 4, 6, 7]


def judged(joints: Array, compliance: JointCompliance | None = COMPLIANCE) -> ConsistencyResult:
    """Process joints (t, n) at 100 Hz for a robot without wheel speed sensors."""
    monitor = ConsistencyMonitor(DRIVE, ROBOT.joint_errors(), compliance)
    for each in joints:
        monitor.advance(each, 0.01, modelled=MODELLED)
    return monitor.judge(joints[-1])


def speeding_up(acceleration: list[float], seconds: float = 0.25) -> Array:
    """Return joints (t, n) of consistent modules at constant acceleration from rest."""
    times_s = np.arange(0.0, seconds, 0.01)
    return DRIVE.inverse(times_s[:, None] * np.array(acceleration))


@given(turning=st.floats(-20.0, 20.0), x=st.floats(-4.0, 4.0), y=st.floats(-4.0, 4.0))
def test_gimbals_that_turn_are_no_evidence(turning: float, x: float, y: float) -> None:
    """Turning gimbals roll their wheels by some inconsistent mm/s, which setpoints do not show."""
    verdict = judged(speeding_up([x, y, turning]), None)
    assert verdict.residual_mps < 1e-9


@pytest.mark.parametrize("share", [0.5, 1.0])
@pytest.mark.parametrize("turning", [-20.0, 20.0])
def test_gimbals_that_give_way_to_the_floor_are_no_evidence(turning: float, share: float) -> None:
    """During angular acceleration, all gimbals lean outward, or all inward."""
    joints = speeding_up([0.0, 0.0, turning])
    joints[1:] += share * COMPLIANCE.by_acceleration @ np.array([0.0, 0.0, turning])
    assert judged(joints).level <= 1.0
    assert judged(joints, None).level > 1.0


def test_the_same_lean_of_a_robot_that_does_not_speed_up_is_evidence() -> None:
    lean = COMPLIANCE.by_acceleration @ np.array([0.0, 0.0, 20.0])
    joints = np.tile(DRIVE.inverse(np.array([0.5, 0.0, 0.0])) + lean, (100, 1))
    assert judged(joints).level > 1.0


def test_gimbals_within_their_dead_bands_are_no_evidence() -> None:
    """All at once, each at an end of its dead band."""
    edges = COMPLIANCE.dead_band_rad * np.array(list(itertools.product([-1.0, 1.0], repeat=6)))
    for edge in edges:
        joints = DRIVE.inverse(np.array([0.7, -0.7, 0.0]))
        joints[GIMBALS] += edge
        assert judged(np.tile(joints, (60, 1))).level <= 1.0


@pytest.mark.parametrize("direction", np.linspace(0.0, 2.0 * np.pi, 7)[:-1])
@pytest.mark.parametrize("joint", GIMBALS)
def test_a_gimbal_that_is_a_third_of_a_degree_aside_is_named_in_half_a_second(
    joint: int, direction: float
) -> None:
    """At 1 m/s. With the noise of modelled wheel speeds, the fault would be missed."""
    twist = np.array([np.cos(direction), np.sin(direction), 0.0])
    joints = np.tile(DRIVE.inverse(twist), (150, 1))
    joints[100:, joint] += np.radians(0.33)
    assert judged(joints).suspect == joint // 3


@pytest.mark.parametrize("share", [0.5, 0.8])
@pytest.mark.parametrize("joint", GIMBALS)
def test_a_gimbal_that_moves_the_others_is_the_one_that_is_named(joint: int, share: float) -> None:
    """Inconsistent wheels slide, so the floor pushes them and their gimbals lean."""
    sound = DRIVE.inverse(np.array([0.5, 0.3, 0.0]))
    yields = share * COMPLIANCE.by_slip(DRIVE.spin_rad_per_s)
    joints = sound + np.eye(9)[joint] * np.radians(1.0)
    for _ in range(200):
        leaning = sound + yields @ DRIVE.forward(joints).residual
        leaning[joint] += np.radians(1.0)
        joints = 0.5 * (joints + leaning)
    assert judged(np.tile(joints, (60, 1))).suspect == joint // 3
