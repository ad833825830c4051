"""Rigid bodies in MuJoCo against the rolling equations and friction laws."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from tsd_twin import robots
from tsd_twin.lie import SE2, Array
from tsd_twin.robots import SingularityDescription
from tsd_twin.robots.description import Floor
from tsd_twin.simulation import Simulation, simulate
from tsd_twin.simulation.mujoco_plant import MujocoSimulation, patch_friction


def tsd() -> SingularityDescription:
    robot = robots.load_robot("tsd")
    assert isinstance(robot, SingularityDescription)
    return robot.with_errors(0.0)


ROBOT = tsd()
DRIVE = ROBOT.kinematics()
CRUISE = DRIVE.inverse(np.zeros(3))
PERIOD_S = 0.01


def spin_up(robot: Simulation) -> None:
    robot.command(np.zeros(len(CRUISE)))
    robot.advance(2.2)
    robot.command(CRUISE)
    robot.advance(3.0)


def drive(robot: Simulation, twist: Array, seconds: float, ramp_s: float) -> tuple[Array, Array]:
    """Ramp up, hold, ramp down; return the twists (n, 3), true and from the joints."""
    steps, twists, explained = round(seconds / PERIOD_S), [], []
    for k in range(steps):
        share = min(1.0, PERIOD_S * k / ramp_s, PERIOD_S * (steps - k) / ramp_s)
        robot.command(DRIVE.inverse(share * twist))
        robot.advance(PERIOD_S)
        twists.append(robot.twist())
        explained.append(DRIVE.forward(robot.joints).twist)
    robot.command(CRUISE)
    robot.advance(0.5)
    return np.array(twists), np.array(explained)


@pytest.mark.parametrize("seed", range(4))
def test_driven_gently_it_goes_where_rolling_wheels_go(seed: int) -> None:
    twist = np.random.default_rng(seed).normal(size=3) * [0.3, 0.3, 0.8]
    rolling, solid = simulate(ROBOT), MujocoSimulation(ROBOT)
    for robot in (rolling, solid):
        spin_up(robot)
    steady = slice(150, 250)
    ideal = drive(rolling, twist, 4.0, 1.0)[0][steady].mean(axis=0)
    twists, explained = drive(solid, twist, 4.0, 1.0)
    real = twists[steady].mean(axis=0)
    # Wheels spin on the floor and turn 1.4 % slower.
    np.testing.assert_allclose(real, 0.986 * ideal, rtol=0, atol=0.012)
    gone, gone_solid = rolling.pose.xy_heading, solid.pose.xy_heading
    apart, way_m = gone_solid - gone, 3.0 * np.hypot(*ideal[:2])
    assert np.hypot(*apart[:2]) < 0.03 + 0.04 * way_m
    assert abs(apart[2]) < 0.1
    # The measured gimbals and wheels explain most of the difference.
    np.testing.assert_allclose(explained[steady], twists[steady], rtol=0, atol=0.006)


def test_at_rest_it_stays_where_it_was_put() -> None:
    pose = SE2(np.array([1.0, -2.0, 0.7]))
    robot = MujocoSimulation(ROBOT, pose=pose)
    spin_up(robot)
    at, heading = robot.pose.xy_heading[:2], robot.pose.xy_heading[2]
    np.testing.assert_allclose(at, pose.xy_heading[:2], rtol=0, atol=1e-3)
    # Spinning up three wheels turns the chassis slightly the other way.
    assert -0.05 < heading - pose.xy_heading[2] < 0.0
    robot.advance(1.0)
    np.testing.assert_allclose(robot.pose.xy_heading[2], heading, rtol=0, atol=0.01)
    np.testing.assert_allclose(robot.loads().sum(), ROBOT.mass.total_kg * 9.81, rtol=1e-3)


def on_a_floor(friction: float) -> SingularityDescription:
    return msgspec.structs.replace(ROBOT, floor=Floor(friction))


def test_without_friction_nothing_pushes() -> None:
    robot = MujocoSimulation(on_a_floor(0.0))
    spin_up(robot)
    drive(robot, np.array([1.0, 0.0, 0.0]), 1.0, 0.1)
    assert np.hypot(*robot.pose.xy_heading[:2]) < 0.005


def test_acceleration_never_exceeds_what_friction_gives() -> None:
    friction = 0.2
    robot = MujocoSimulation(on_a_floor(friction))
    spin_up(robot)
    robot.command(DRIVE.inverse(np.array([2.0, 0.0, 0.0])))
    speeds = [0.0]
    for _ in range(30):
        robot.advance(PERIOD_S)
        speeds.append(float(np.hypot(*robot.twist()[:2])))
    accelerations = np.diff(speeds) / PERIOD_S
    assert 0.5 * friction * 9.81 < accelerations.max() < 1.1 * friction * 9.81


def test_the_same_commands_give_the_same_motion_and_seeds_differ() -> None:
    poses = []
    for seed in (1, 1, 2):
        robot = MujocoSimulation(ROBOT, seed=seed, noise=1.0)
        spin_up(robot)
        drive(robot, np.array([0.3, 0.0, 0.5]), 0.5, 0.2)
        poses.append(robot.pose.xy_heading)
    np.testing.assert_array_equal(poses[0], poses[1])
    assert not np.allclose(poses[0], poses[2], atol=1e-5)


def test_time_is_kept_whatever_pieces_it_comes_in() -> None:
    whole, pieces = MujocoSimulation(ROBOT), MujocoSimulation(ROBOT)
    for robot in (whole, pieces):
        spin_up(robot)
        robot.command(DRIVE.inverse(np.array([0.5, 0.0, 0.0])))
    whole.advance(0.5)
    for _ in range(500 * 3):
        pieces.advance(0.001 / 3.0)
    np.testing.assert_allclose(pieces.pose.xy_heading, whole.pose.xy_heading, atol=0.002)


def test_a_patch_that_does_not_spin_obeys_coulomb() -> None:
    slip = np.array([[0.6, -0.8]])
    force, torque = patch_friction(Floor(friction=0.8), np.array([10.0]), slip, np.zeros(1))
    np.testing.assert_allclose(force, [[-4.8, 6.4]], rtol=1e-3)
    assert torque[0] == 0.0


def test_spin_turns_dry_friction_into_oil() -> None:
    """Against Coulomb's law summed over a patch with Hertzian pressure."""
    floor, spin, load = Floor(0.8, patch_radius_m=0.001), 262.0, 10.0
    r = (np.arange(400) + 0.5) / 400 * floor.patch_radius_m
    angle = (np.arange(400) + 0.5) / 400 * 2.0 * np.pi
    r, angle = np.meshgrid(r, angle)
    pressure = np.sqrt(1.0 - (r / floor.patch_radius_m) ** 2) * r
    pressure *= load / pressure.sum()
    for slip in (0.01, 0.05, 0.2, 1.0):
        vx, vy = slip - spin * r * np.sin(angle), spin * r * np.cos(angle)
        summed = -0.8 * (pressure * vx / np.hypot(vx, vy)).sum()
        force, torque = patch_friction(
            floor, np.array([load]), np.array([[slip, 0.0]]), np.array([spin])
        )
        np.testing.assert_allclose(force[0, 0], summed, rtol=0.25)
        lever = (r * np.cos(angle) * vy - r * np.sin(angle) * vx) / np.hypot(vx, vy)
        drag = -0.8 * (pressure * lever).sum()
        np.testing.assert_allclose(torque[0], drag, rtol=0.35)
