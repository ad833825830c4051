"""Joint rounding of gimbal goals: the mean twist, steps, limits and rest."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from tests.support.controller_harness import PERIOD_S, ROBOT, ControllerHarness
from tsd_twin.control.goal_rounding import GoalRounding
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityDescription
from tsd_twin.simulation import SimRobot

assert isinstance(ROBOT, SingularityDescription)
STEP_RAD = 2.0 * math.pi / ROBOT.servo.steps_per_turn
OFFSETS_DEG = [[0.31, -0.12], [-0.07, 0.25], [0.02, 0.044]]


def robot_of(modules: int, offsets_deg: list[list[float]] | None = None) -> SingularityDescription:
    azimuths = [90.0 + 360.0 * i / modules for i in range(modules)]
    replace = msgspec.structs.replace
    return replace(
        ROBOT,
        drive=replace(ROBOT.drive, azimuths_deg=azimuths),
        motor=replace(ROBOT.motor, speed_rpm=ROBOT.motor.speed_rpm[:1] * modules),
        calibration=replace(ROBOT.calibration, tilt_offset_deg=offsets_deg or []),
    )


def offsets(robot: SingularityDescription) -> Array:
    return robot.actuator_offsets().offset.reshape(-1, 3)[:, :2]


def rounded_alone(robot: SingularityDescription, joints: Array) -> Array:
    """Round each goal to its nearest step."""
    rounded = joints.reshape(-1, 3).copy()
    zero = offsets(robot)
    rounded[:, :2] = np.rint((rounded[:, :2] - zero) / STEP_RAD) * STEP_RAD + zero
    return rounded.ravel()


def twists(count: int, seed: int) -> Array:
    """Random twists in every direction, with at most 1 m/s and 1.5 rad/s."""
    random = np.random.default_rng(seed)
    angles = 2.0 * np.pi * (np.arange(count) + random.uniform(size=count)) / count
    speeds = random.uniform(0.05, 1.0, count)
    turning = random.uniform(-1.5, 1.5, count) * (np.arange(count) % 2)
    return np.stack([speeds * np.cos(angles), speeds * np.sin(angles), turning], axis=1)


@pytest.mark.parametrize("modules", [2, 3, 5])
def test_mean_twist_is_nearer_in_every_direction(modules: int) -> None:
    """Means over 3 s, with turn rates as speeds of the pivots; seeds not used for tuning."""
    robot = robot_of(modules)
    drive = robot.kinematics()
    scale = np.array([1.0, 1.0, robot.drive.rms_radius_m])
    together, alone = [], []
    for twist in twists(24, seed=9100 + modules):
        joints, rounding, total = drive.inverse(twist), GoalRounding(robot), np.zeros(3)
        for _ in range(300):
            goals = rounding.step(joints, PERIOD_S)
            total += drive.twist(goals) / 300.0
        together.append(np.linalg.norm(scale * (total - twist)))
        alone.append(np.linalg.norm(scale * (drive.twist(rounded_alone(robot, joints)) - twist)))
    assert max(together) < 1.2e-3
    assert max(alone) > 5e-3
    assert (np.array(together) < np.maximum(alone, 1.2e-3)).all()
    assert np.mean(together) < 0.15 * np.mean(alone)


@pytest.mark.parametrize("given", [None, OFFSETS_DEG], ids=["zeroed", "with offsets"])
def test_goals_are_whole_steps_next_to_the_setpoints(given: list[list[float]] | None) -> None:
    """Also while the twist changes, and at the tilt limit."""
    robot = robot_of(3, given)
    drive, rounding, zero = robot.kinematics(), GoalRounding(robot), offsets(robot)
    random, twist = np.random.default_rng(9200), np.zeros(3)
    for _ in range(1000):
        twist = drive.limit(twist + random.normal(size=3) * [0.2, 0.2, 1.0])
        joints = drive.inverse(twist)
        goals = rounding.step(joints, PERIOD_S)
        steps = (goals.reshape(-1, 3)[:, :2] - zero) / STEP_RAD
        np.testing.assert_allclose(steps, np.rint(steps), atol=1e-9)
        assert np.abs(goals - joints).max() < STEP_RAD
        np.testing.assert_array_equal(goals[2::3], joints[2::3])
        if given is None:
            assert drive.tilt(goals).max() <= drive.max_tilt_rad + 1e-12


def test_goals_rarely_change_while_the_twist_is_constant() -> None:
    """At most 30 steps per second of all six servos together, in every direction."""
    drive = ROBOT.kinematics()
    for twist in twists(12, seed=9300):
        rounding, joints = GoalRounding(ROBOT), drive.inverse(twist)
        goals = np.array([rounding.step(joints, PERIOD_S) for _ in range(300)])
        assert np.abs(np.diff(goals, axis=0)).sum() / STEP_RAD < 30.0 * 3.0


def test_exact_goals_are_kept() -> None:
    """Without anything to round, goals equal the setpoints whatever was displaced before."""
    drive, rounding = ROBOT.kinematics(), GoalRounding(ROBOT)
    for _ in range(37):
        rounding.step(drive.inverse(np.array([0.5, 0.0, 0.0])), PERIOD_S)
    joints = rounded_alone(ROBOT, drive.inverse(np.array([0.3, 0.2, 0.1])))
    goals = rounding.step(joints, PERIOD_S)
    np.testing.assert_allclose(goals, joints, atol=1e-9)


def test_a_robot_at_rest_has_exact_setpoints_and_starts_afresh() -> None:
    """Zero twist is not rounded, and equal drives have equal goals."""
    servo = msgspec.structs.replace(ROBOT.servo, joint_rounding=True)
    robot = msgspec.structs.replace(ROBOT, servo=servo)
    rig = ControllerHarness(SimRobot(robot), robot=robot)
    pilot, drives = rig.get_ready(), []
    rig.drive(pilot, (0.0, 0.0, 0.0), 6.0)  # Until the predicted wheel speed is constant.
    rest = rig.setpoint.copy()
    assert not rest.reshape(-1, 3)[:, :2].any()
    for _ in range(2):
        goals = []
        for _ in range(30):
            rig.drive(pilot, (0.33, -0.21, 0.4), 2 * PERIOD_S)
            goals.append(rig.setpoint)
        drives.append(goals)
        rig.drive(pilot, (0.0, 0.0, 0.0), 1.0)
        np.testing.assert_array_equal(rig.setpoint, rest)
    assert np.ptp(np.array(drives[0])[-5:], axis=0).max() <= STEP_RAD * 1.01
    np.testing.assert_array_equal(drives[0], drives[1])
