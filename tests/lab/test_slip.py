"""The slip model against rigid bodies, and its inverse against itself."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tsd_twin import robots
from tsd_twin.kinematics import JointKind
from tsd_twin.lab.observer import Slip
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityDescription
from tsd_twin.simulation.mujoco_plant import MujocoSimulation

ROBOT = robots.description_of_kind(robots.load_robot("tsd"), SingularityDescription).with_errors(
    0.0
)
DRIVE = ROBOT.kinematics()
WHEELS = np.array([joint.kind is JointKind.VELOCITY for joint in DRIVE.joints])
DT_S = 0.01


def shuttle() -> list[Array]:
    """Accelerate to 1 m/s and back to rest at 4 m/s^2, along X, along Y, and in a turn."""
    ramp = np.concatenate([np.linspace(0.0, 1.0, 25), np.ones(40), np.linspace(1.0, 0.0, 25)])
    parts = [np.outer(ramp, axis) for axis in ([1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 2.0])]
    return list(np.concatenate(parts))


def test_bodies_on_a_floor_move_so_and_their_wheels_slow_down_so() -> None:
    """MuJoCo models masses, loads and torques; here only joints are compared."""
    simulation, slip = MujocoSimulation(ROBOT), Slip(ROBOT)
    still = DRIVE.inverse(np.zeros(3))
    simulation.command(np.where(WHEELS, 0.0, still))
    simulation.advance(2.5)
    for _ in range(200):
        simulation.command(still)
        simulation.advance(DT_S)
    assert simulation.joints[WHEELS] == pytest.approx(slip.rest_share * still[WHEELS], rel=2e-3)
    before = simulation.joints
    off, by_rolling, spins = [], [], []
    for twist in shuttle():
        simulation.command(DRIVE.inverse(twist))
        simulation.advance(DT_S)
        here = simulation.joints
        told = np.where(WHEELS, still, 0.5 * (before + here))
        rolling = DRIVE.forward(told, (here - before) / DT_S * ~WHEELS).twist
        before = here
        off.append(slip.advance(rolling, DT_S) - simulation.twist())
        by_rolling.append(slip.rest_share * rolling - simulation.twist())
        spins.append(slip.speed_fraction * DRIVE.spin_rad_per_s / here[WHEELS])
    sliding, only_rolling = (np.abs(np.array(each))[:, :2].max() for each in (off, by_rolling))
    assert only_rolling > 0.06, "m/s, else nothing slid"
    assert sliding < 0.01
    np.testing.assert_allclose(spins, 1.0, atol=0.015)
    # The end position of each leg is tested as odometry.
    assert np.abs(DT_S * np.cumsum(off, axis=0)[89::90, :2]).max() < 0.002


@settings(max_examples=5)
@given(st.integers(0, 2**32 - 1))
def test_pushing_undoes_sliding(seed: int) -> None:
    """For any smooth motion within friction, the wheel motion from `push` reproduces it."""
    random = np.random.default_rng(seed)
    amplitude, phase = random.uniform(0.2, 0.5, 3), random.uniform(0.0, 6.0, 3)
    pushing, sliding = Slip(ROBOT), Slip(ROBOT)
    pseudo_inverse = DRIVE.twist_from_contacts
    dt_s, off = 0.002, []
    for i in range(250):
        t_s = i * dt_s
        swell = np.minimum(1.0, 4.0 * t_s) ** 2
        twist = swell * amplitude * np.sin(5.0 * t_s + phase)
        later = np.minimum(1.0, 4.0 * (t_s + 1e-6)) ** 2
        rate = (later * amplitude * np.sin(5.0 * (t_s + 1e-6) + phase) - twist) / 1e-6
        over_ground = rate + twist[2] * np.array([-twist[1], twist[0], 0.0])
        rolled, force = pushing.push(twist, over_ground, dt_s)
        assert np.linalg.norm(force, axis=1).max() < 0.8 * 9.81
        off.append(sliding.advance(pseudo_inverse @ rolled.ravel(), dt_s) - twist)
    assert np.abs(off).max() < 0.03
    np.testing.assert_allclose(pushing.speed_fraction, sliding.speed_fraction, atol=0.01)


def test_more_than_friction_gives_stays_finite() -> None:
    slip = Slip(ROBOT)
    rolled, force = slip.push(np.zeros(3), np.array([100.0, 0.0, 0.0]), DT_S)
    assert np.isfinite(rolled).all()
    assert np.isfinite(force).all()


@pytest.mark.parametrize("share", [0.6, 0.9, 1.0, 1.5])
def test_a_slippery_floor_lets_the_body_follow_later_and_is_known_by_that(share: float) -> None:
    floor = msgspec.structs.replace(ROBOT.floor, friction=share * ROBOT.floor.friction)
    here, there = Slip(ROBOT), Slip(msgspec.structs.replace(ROBOT, floor=floor))
    assert there.lag_s == pytest.approx(here.lag_s / share)
    found = here.later(there.turning_lag_s - here.turning_lag_s)
    rolling = np.array([0.3, -0.2, 1.0])
    np.testing.assert_allclose(found.advance(rolling, DT_S), there.advance(rolling, DT_S))


@pytest.mark.parametrize("axis", [0, 2])
def test_after_a_small_push_the_rest_dies_away_with_the_lag(axis: int) -> None:
    slip = Slip(ROBOT)
    lag_s = slip.turning_lag_s if axis == 2 else slip.lag_s
    rolling = np.zeros(3)
    rolling[axis] = 0.01
    for _ in range(40):
        slip.advance(rolling, lag_s / 40.0)
    left = 1.0 - slip.twist[axis] / (slip.rest_share * rolling[axis])
    assert left == pytest.approx(np.exp(-1.0), abs=0.02)


def test_a_batch_is_each_of_its_members() -> None:
    random = np.random.default_rng(0)
    together, alone = Slip(ROBOT, (3,)), [Slip(ROBOT) for _ in range(3)]
    for _ in range(50):
        rolling = random.normal(size=(3, 3))
        twists = together.advance(rolling, DT_S)
        for twist, one, row in zip(twists, alone, rolling, strict=True):
            np.testing.assert_allclose(twist, one.advance(row, DT_S), atol=1e-12)
