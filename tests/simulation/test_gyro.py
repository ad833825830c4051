"""A simulated yaw gyro measures the truth plus bias and noise from the seed."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from tsd_twin import robots
from tsd_twin.sensors.gyro import Gyro
from tsd_twin.simulation import simulate

TSD = robots.load_robot("tsd")
GYRO = Gyro(noise_rad_per_s=0.002, bias_rad_per_s=0.01)
ROBOT = msgspec.structs.replace(TSD, gyro=GYRO)
TURN = TSD.kinematics().inverse(np.array([0.3, 0.1, 0.8]))
JOINTS = len(TURN)


@pytest.mark.parametrize("plant", ["kinematic", "mujoco"])
@pytest.mark.parametrize("errors", [0.0, 1.0])
def test_it_measures_the_true_turn_rate_whatever_moves_the_robot(plant: str, errors: float) -> None:
    simulation = simulate(ROBOT, plant=plant, errors=errors)
    simulation.command(np.zeros(JOINTS))  # Speed controllers arm at zero throttle.
    simulation.advance(2.0)
    turned = before = 0.0
    for _ in range(150):
        simulation.command(TURN)
        simulation.advance(0.01)
        measured = simulation.measure()
        assert measured.shape == (JOINTS + 1,)
        assert measured[-1] == simulation.twist()[2]
        turned += 0.01 * 0.5 * (before + measured[-1])
        before = measured[-1]
    assert abs(turned) > 0.5
    assert turned == pytest.approx(simulation.pose.xy_heading[2], abs=0.01)


def test_its_offset_stays_for_the_run_and_its_noise_is_white() -> None:
    """400 robots at rest with 400 readings each: sigmas within 15 % of the description."""
    simulation = simulate(ROBOT, (400,), seed=5, noise=1.0)
    readings = np.array([simulation.measure()[..., -1] for _ in range(400)])
    assert readings.mean(axis=0).std() == pytest.approx(GYRO.bias_rad_per_s, rel=0.15)
    noise = readings - readings.mean(axis=0)
    assert noise.std() == pytest.approx(GYRO.noise_rad_per_s, rel=0.02)
    assert abs((noise[1:] * noise[:-1]).mean()) < 0.02 * noise.var()


def test_its_seed_says_all_of_it_and_a_robot_without_one_measures_the_same_otherwise() -> None:
    one, same, other = (simulate(ROBOT, seed=seed, noise=1.0) for seed in (1, 1, 2))
    without = simulate(TSD, seed=1, noise=1.0)
    for _ in range(5):
        measured = one.measure()
        np.testing.assert_array_equal(measured, same.measure())
        np.testing.assert_array_equal(measured[:JOINTS], without.measure())
        assert measured[-1] != other.measure()[-1]
