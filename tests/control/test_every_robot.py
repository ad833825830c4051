"""Robots of every kind with the same controller: arm, drive, stop and set the pose."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.support.controller_harness import ControllerHarness, with_exact_setpoints
from tsd_twin import robots
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.status import encode_status
from tsd_twin.messages.topics import Service
from tsd_twin.simulation import SimRobot

every_robot = pytest.mark.parametrize("name", robots.robot_names())
STANDING = ("atlas", "kiwi", "mecanum", "omni4")
"""Robots whose wheels stop with the robot."""
GENTLE = np.array([0.3, -0.2, 0.4])


def simulated(name: str, noise: float = 0.0) -> ControllerHarness:
    robot = robots.load_robot(name)
    return ControllerHarness(SimRobot(robot, seed=2, noise=noise), robot=robot)


def true_pose(rig: ControllerHarness) -> SE2 | SO3:
    assert rig.simulated is not None
    return rig.simulated.truth(rig.now_s).pose


def estimated(rig: ControllerHarness) -> SE2 | SO3:
    message = rig.controller.odometry(0)
    return SE2(message.xy_heading) if message.wxyz is None else SO3(message.wxyz)


def apart(a: SE2 | SO3, b: SE2 | SO3) -> Array:
    """Pose difference, in m and rad."""
    return (a.inverse() @ b).log()  # pyright: ignore[reportOperatorIssue]


@every_robot
def test_it_is_driven_as_asked_and_knows_where_it_is(name: str) -> None:
    """After 2 s, the twist matches the command and the estimate matches the true pose."""
    rig = simulated(name)
    pilot = rig.get_ready()
    rig.drive(pilot, GENTLE, 2.0)
    np.testing.assert_allclose(rig.twist, GENTLE, atol=1e-12)
    np.testing.assert_allclose(rig.controller.odometry(0).twist, GENTLE, atol=0.06)
    np.testing.assert_allclose(apart(true_pose(rig), estimated(rig)), 0.0, atol=0.02)
    assert rig.status().consistency.suspect is None


@every_robot
def test_perfect_joints_move_it_by_the_twist(name: str) -> None:
    rig = ControllerHarness(robot=with_exact_setpoints(robots.load_robot(name)))
    drive = rig.controller.kinematics
    pilot = rig.get_ready()
    rig.drive(pilot, GENTLE, 1.0)
    before = estimated_plain(rig)
    rig.drive(pilot, GENTLE, 1.0)
    after = drive.integrate(before, GENTLE, 1.0)
    np.testing.assert_allclose(apart(after, estimated_plain(rig)), 0.0, atol=1e-3)


def estimated_plain(rig: ControllerHarness) -> SE2 | SO3:
    """Wheel odometry, which is exact for ideal joints."""
    message = rig.controller.alternative_odometry(0) or rig.controller.odometry(0)
    return SE2(message.xy_heading) if message.wxyz is None else SO3(message.wxyz)


@every_robot
def test_a_stop_latches_and_brings_it_to_rest(name: str) -> None:
    rig = simulated(name)
    pilot = rig.get_ready()
    rig.drive(pilot, GENTLE, 1.0)
    assert rig.ask(Service.STOP).ok
    rig.drive(pilot, GENTLE, 1.5)
    assert rig.mode is Mode.STOPPED
    assert not rig.setpoint.any()
    assert rig.simulated is not None
    np.testing.assert_allclose(rig.simulated.truth(rig.now_s).twist, 0.0, atol=1e-3)
    assert rig.ask(Service.ARM, lease=pilot.lease).ok is False


@every_robot
def test_without_commands_it_stops_by_itself_within_what_its_limits_give(name: str) -> None:
    """Bound: timeout times speed, braking and actuator lag; measured at the top of a sphere."""
    rig = simulated(name)
    limits, twist_scale_m = rig.controller.robot.limits, rig.controller.kinematics.twist_scale_m
    pilot = rig.get_ready()
    rig.drive(pilot, (limits.speed_mps / twist_scale_m, 0.0, 0.0), 2.0)
    speed = twist_scale_m * np.hypot(*rig.twist[:2])
    assert speed == pytest.approx(limits.speed_mps, rel=1e-6)
    start = true_pose(rig)
    rig.wait(2.0)
    assert rig.mode is Mode.READY
    moved = twist_scale_m * np.hypot(*apart(start, true_pose(rig))[:2])
    late_m = speed * (limits.command_timeout_s + 0.02)
    assert moved <= 1.1 * (late_m + speed**2 / (2.0 * limits.deceleration_mps2)) + 0.05 * speed
    assert moved > 0.9 * late_m


@pytest.mark.parametrize("name", STANDING)
def test_wheels_that_stand_at_rest_are_armed_at_once_and_stand_until_driven(name: str) -> None:
    rig = simulated(name)
    pilot = rig.acquire()
    assert rig.ask(Service.ARM, lease=pilot.lease).ok
    rig.wait(0.1)
    assert rig.mode is Mode.READY
    assert not rig.setpoint.any()
    rig.drive(pilot, GENTLE, 0.1)
    assert rig.setpoint.any()


@pytest.mark.parametrize("name", STANDING)
def test_wheels_that_turn_already_are_not_armed(name: str) -> None:
    """The wheels turn because the robot is pushed or a motor controller fails."""
    rig = ControllerHarness(robot=robots.load_robot(name))
    pilot = rig.acquire()
    joints = np.full(len(rig.setpoint), 5.0)
    assert rig.ask(Service.ARM, lease=pilot.lease).ok
    for i in range(600):
        rig.now_s += 0.01
        rig.controller.step(rig.now_s, joints, ())
        if i % 100 == 0:
            rig.ask(Service.LEASE, op="renew", operator="alice", lease=pilot.lease)
        assert rig.mode is not Mode.READY
    assert rig.mode is Mode.DISARMED
    assert rig.status().stop == because(Code.NOT_AT_SPEED)


@pytest.mark.parametrize("name", STANDING)
@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_a_wheel_that_measures_no_number_counts_as_not_measured(name: str, number: float) -> None:
    """A robot with encoders must not drive if the wheel speeds are unknown."""
    rig = ControllerHarness(robot=robots.load_robot(name))
    rig.get_ready()
    joints = np.zeros(len(rig.setpoint))
    joints[1] = number
    for _ in range(20):
        rig.now_s += 0.01
        rig.controller.step(rig.now_s, joints, ())
    assert rig.mode is Mode.FAULT
    assert np.isfinite(rig.pose).all()


@every_robot
def test_what_it_says_about_itself_goes_into_messages(name: str) -> None:
    rig = simulated(name, noise=1.0)
    pilot = rig.get_ready()
    rig.drive(pilot, GENTLE, 0.5)
    assert rig.simulated is not None
    status = rig.status()
    assert json.loads(encode_status(status))["mode"] == "driving"
    json.dumps(rig.simulated.hardware())
    robot = rig.controller.robot
    measured, setpoint = rig.controller.joint_state(0), rig.controller.setpoint_state(0)
    names = [joint.name for joint in robot.kinematics().joints]
    assert list(setpoint.names) == names
    assert list(measured.names) == names + [sensor.name for sensor in robot.sensors]
    both = np.stack([measured.position_rad, measured.velocity_rad_per_s])
    assert np.isfinite(both).any(axis=0).all()


def test_omni4_shows_its_dead_wheels_and_gyro_with_the_joints() -> None:
    rig = simulated("omni4")
    pilot = rig.get_ready()
    rig.drive(pilot, (0.5, 0.0, 0.3), 1.0)
    state = rig.controller.joint_state(0)
    angles = dict(zip(state.names, state.position_rad, strict=True))
    speeds = dict(zip(state.names, state.velocity_rad_per_s, strict=True))
    assert angles["dead1"] > 5.0
    assert np.isnan(speeds["dead1"])
    assert speeds["gyro"] == pytest.approx(0.3, abs=0.01)
    assert np.isnan(angles["gyro"])


@pytest.mark.parametrize("connected", [True, False])
def test_a_singularity_robot_shows_its_gyro_with_the_joints(*, connected: bool) -> None:
    """Hardware may omit quantities it does not measure; they become NaN."""
    robot = robots.parse_description(robots.read_description("tsd") + "\n[gyro]\n", "my.toml")
    rig = ControllerHarness(SimRobot(robot) if connected else None, robot=robot)
    pilot = rig.get_ready()
    rig.drive(pilot, (0.5, 0.0, 0.3), 1.0)
    state = rig.controller.joint_state(0)
    assert state.names[-1] == "gyro"
    assert len(state.names) == len(state.position_rad) == len(state.velocity_rad_per_s) == 10
    assert np.isnan(state.position_rad[-1])
    expected = pytest.approx(0.3, abs=0.03) if connected else pytest.approx(np.nan, nan_ok=True)
    assert state.velocity_rad_per_s[-1] == expected
    np.testing.assert_allclose(rig.controller.odometry(0).twist, [0.5, 0.0, 0.3], atol=0.03)


# The sphere.


def test_the_axes_of_a_sphere_are_those_of_its_base_in_either_frame() -> None:
    """The base frame is fixed in the world, whatever the sphere's orientation."""
    for frame in ("base_link", "odom"):
        rig = simulated("atlas")
        pilot = rig.get_ready()
        rig.drive(pilot, (0.0, 0.0, 1.0), 1.5, frame=frame)
        rig.drive(pilot, (1.0, 0.5, 0.0), 1.0, frame=frame)
        np.testing.assert_allclose(rig.twist, [1.0, 0.5, 0.0])


def test_a_sphere_is_set_to_a_quaternion_or_upright() -> None:
    rig = simulated("atlas")
    pilot = rig.get_ready()
    half = np.sqrt(0.5)
    for given in ([0.0, 0.0, half, half], [0.0, 0.0, -3e200, -3e200], [0.0, 0.0, 1e-200, 1e-200]):
        assert rig.ask(Service.SET_POSE, lease=pilot.lease, xyzw=given).ok
        turned = SO3(rig.pose).rotate(np.array([1.0, 0.0, 0.0]))
        np.testing.assert_allclose(turned, [0.0, 1.0, 0.0], atol=1e-12)
    assert rig.ask(Service.SET_POSE, lease=pilot.lease).ok
    np.testing.assert_array_equal(rig.pose, [1.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("bad", ["[0, 0, 0, 0]", "[0, 0, 0, 1e999]", "[1, 2, 3]", '"up"', "null"])
def test_what_is_no_orientation_is_refused(bad: str) -> None:
    rig = simulated("atlas")
    pilot = rig.acquire()
    rig.ask(Service.SET_POSE, lease=pilot.lease, xyzw=[0.0, 1.0, 0.0, 0.0])
    before = rig.pose
    payload = f'{{"lease": "{pilot.lease}", "xyzw": {bad}}}'
    reply = rig.controller.serve(Service.SET_POSE, payload.encode(), rig.now_s)
    assert not reply.ok
    assert reply.reason
    np.testing.assert_array_equal(rig.pose, before)


def test_limits_hold_for_the_top_of_a_sphere() -> None:
    """0.45 m/s at 0.15 m radius are 3 rad/s; about the vertical, the turn rate limit holds."""
    rig = simulated("atlas")
    pilot = rig.get_ready()
    rig.drive(pilot, (30.0, 40.0, 0.0), 2.0)
    np.testing.assert_allclose(rig.twist, [1.8, 2.4, 0.0], rtol=1e-9)
    rig.drive(pilot, (0.0, 0.0, 40.0), 2.0)
    np.testing.assert_allclose(rig.twist, [0.0, 0.0, 3.0], atol=1e-12)
