"""Each modelled build error alone, against its expected effect, on both plants."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from tsd_twin.errors import TwinError
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityDescription, description_of_kind, load_robot
from tsd_twin.simulation import PLANTS, Servos, Simulation, simulate

ROBOT = description_of_kind(load_robot("tsd"), SingularityDescription)
DRIVE = ROBOT.kinematics()
CRUISE = DRIVE.inverse(np.zeros(3))
ANGLES = np.array([0, 1, 3, 4, 6, 7])
STEP = 2.0 * np.pi / 4096


def only(**sizes: float) -> SingularityDescription:
    """The robot of the thesis with only these errors."""
    none = ROBOT.with_errors(0.0).errors
    return msgspec.structs.replace(ROBOT, errors=msgspec.structs.replace(none, **sizes))


def spun_up(
    robot: SingularityDescription, plant: str = "kinematic", **options: object
) -> Simulation:
    simulation = simulate(robot, plant=plant, errors=1.0, **options)  # type: ignore[arg-type]
    simulation.command(np.zeros(9))
    simulation.advance(2.1)
    simulation.command(CRUISE)
    simulation.advance(5.0)
    return simulation


def settled(simulation: Simulation, angle: float) -> Array:
    """Gimbals (..., 6) 0.5 s after commanding all of them to `angle`."""
    setpoint = CRUISE.copy()
    setpoint[ANGLES] = angle
    simulation.command(setpoint)
    simulation.advance(0.5)
    return simulation.joints[..., ANGLES]


@pytest.mark.parametrize("plant", list(PLANTS))
def test_a_gimbal_that_is_not_zeroed_stands_beside_what_it_tells(plant: str) -> None:
    zero_deg = 0.3
    simulation = spun_up(only(zero_deg=zero_deg), plant)
    stands, tells = simulation.joints[ANGLES], simulation.measure()[ANGLES]
    # Wheels that pull against each other load the servos, which yield by at most friction times
    # wheel radius, 8 N at 40 mm, over a gain of 29 N m per radian.
    np.testing.assert_allclose(tells, 0.0, atol=0.011 if plant == "mujoco" else STEP)
    assert 0.3 * np.radians(zero_deg) < np.std(stands) < 3.0 * np.radians(zero_deg)
    # The robot creeps; the thesis used this creep for zeroing.
    moved = simulation.pose
    simulation.advance(1.0)
    gone = (moved.inverse() @ simulation.pose).log()
    np.testing.assert_allclose(gone, DRIVE.forward(simulation.joints).twist, atol=0.005)


def test_zero_errors_have_their_size_and_belong_to_the_machine_not_to_the_noise() -> None:
    robot = only(zero_deg=0.1)
    many = spun_up(robot, batch=(2000,), seed=3)
    spread = np.degrees(many.joints[..., ANGLES])
    assert spread.std() == pytest.approx(0.1, rel=0.03)
    assert spread.mean() == pytest.approx(0.0, abs=0.005)
    one, noisy, other = (spun_up(robot, seed=s, noise=n) for s, n in ((3, 0.0), (3, 1.0), (4, 0.0)))
    np.testing.assert_array_equal(one.joints[ANGLES], noisy.joints[ANGLES])
    assert np.abs(one.joints[ANGLES] - other.joints[ANGLES]).max() > 1e-4


@pytest.mark.parametrize("plant", list(PLANTS))
def test_in_its_dead_band_a_servo_stands(plant: str) -> None:
    band = np.radians(0.5)
    simulation = spun_up(only(dead_band_deg=0.5), plant)
    goal = round(0.1 / STEP) * STEP
    off = goal - settled(simulation, goal)
    # A gimbal with mass overshoots into the band; without, it stops at its edge.
    assert np.abs(off).max() <= band * (1.0 + 1e-9)
    if plant == "mujoco":
        assert np.abs(off).min() > 0.2 * band
        return
    np.testing.assert_allclose(off, band, atol=1e-9)
    before = simulation.joints[ANGLES].copy()
    np.testing.assert_array_equal(settled(simulation, goal - 0.5 * band), before)


def test_readings_of_a_servo_in_its_dead_band_scatter_as_the_odometry_is_told() -> None:
    """It rests between two steps, and noise decides which of them is read."""
    robot = only(dead_band_deg=ROBOT.errors.dead_band_deg)
    simulation = spun_up(robot, batch=(1,), noise=1.0, seed=3)
    scatter: list[Array] = []
    for angle in np.linspace(-20.0, 20.0, 9) * STEP:
        stands = settled(simulation, angle)[0]
        read = np.array([simulation.measure()[0, ANGLES] - stands for _ in range(200)])
        scatter.append(np.square(read).mean(axis=0))
    found_rad = np.sqrt(np.mean(scatter))
    errors = robot.joint_errors()
    told_rad = np.hypot(errors.angle_rad, errors.rounding_rad)
    assert 0.8 * told_rad < found_rad < 1.5 * told_rad
    assert found_rad > 1.5 * errors.angle_rad
    assert only().joint_errors().rounding_rad == 0.0


@pytest.mark.parametrize("plant", list(PLANTS))
def test_a_motor_that_reverses_crosses_its_play_alone(plant: str) -> None:
    late = {}
    for backlash_deg in (0.0, 1.0):
        simulation = spun_up(only(backlash_deg=backlash_deg), plant)
        for angle in (0.0, 0.1):
            settled(simulation, angle)
        setpoint = CRUISE.copy()
        simulation.command(setpoint)
        simulation.advance(0.05)
        late[backlash_deg] = simulation.joints[ANGLES].mean()
    # At 32 per second of 0.1 rad the motor needs 5.5 ms for one degree.
    gone = 0.1 - late[0.0]
    assert 0.75 * gone < 0.1 - late[1.0] < 0.97 * gone


def test_play_solves_its_differential_equation_in_small_steps() -> None:
    """Motor and gimbal as two bodies that touch or not, by Euler's method."""
    servos = replace(Servos.of(ROBOT.with_errors(0.0), 12.0), backlash_rad=0.006)
    random = np.random.default_rng(1)
    angle, goals = np.zeros(50), random.uniform(-0.2, 0.2, size=(6, 50))
    slow, play, motor, gimbal = angle, np.zeros(50), np.zeros(50), np.zeros(50)
    for goal in goals:
        left_s, play = servos.cross(slow, goal, play, np.array(0.03))
        slow = servos.after(slow, goal, left_s)
        for _ in range(6000):
            motor = motor + 5e-6 * np.clip(32.0 * (goal - gimbal), -6.597344572538566, 6.6)
            gimbal = np.clip(gimbal, motor - 0.003, motor + 0.003)
        np.testing.assert_allclose(slow, gimbal, atol=1e-4)
        np.testing.assert_allclose(play, motor - gimbal, atol=1e-4)


def test_play_never_grows_however_often_a_servo_is_told_anew() -> None:
    """Rounding once let a motor drift away from its gimbal, which then stayed in place."""
    servos = replace(Servos.of(ROBOT.with_errors(0.0), 12.0), backlash_rad=0.0058)
    random = np.random.default_rng(2)
    angle, play = np.zeros(200), np.zeros(200)
    for _ in range(3000):
        goal = angle + random.normal(size=200) * 10.0 ** random.uniform(-9, -1, size=200)
        left_s, play = servos.cross(angle, goal, play, random.uniform(0.0, 0.01, size=200))
        angle = servos.after(angle, goal, left_s)
        assert np.abs(play).max() <= 0.0029
    goal = angle + 0.1
    for _ in range(50):
        left_s, play = servos.cross(angle, goal, play, np.array(0.01))
        angle = servos.after(angle, goal, left_s)
    np.testing.assert_allclose(angle, goal, atol=1e-5)


@pytest.mark.parametrize("plant", list(PLANTS))
def test_a_late_bus_is_late_both_ways_and_the_truth_is_not(plant: str) -> None:
    """Commands and measurements are both delayed; the true motion equals that without delay."""
    delay_s = 0.025
    prompt, late = spun_up(only(), plant), spun_up(only(delay_s=delay_s), plant)
    told, true, poses = [], [], []
    for k in range(60):
        setpoint = DRIVE.inverse(np.array([0.5, 0.1 * np.sin(k), 0.0]))
        for robot in (prompt, late):
            robot.command(setpoint)
        # Halves of 10 ms, so the delay is a whole number of them.
        for _ in range(2):
            for robot in (prompt, late):
                robot.advance(0.005)
            true.append(prompt.joints.copy())
            poses.append(prompt.pose.xy_heading)
            told.append((late.joints.copy(), late.measure(), late.pose.xy_heading))
    shift = round(delay_s / 0.005)
    for n in range(2 * shift, len(told)):
        joints, measured, pose = told[n]
        np.testing.assert_allclose(joints, true[n - shift], atol=2e-3)
        np.testing.assert_allclose(pose, poses[n - shift], atol=2e-3)
        np.testing.assert_allclose(measured[ANGLES], true[n - 2 * shift][ANGLES], atol=STEP)


def test_a_late_bus_refuses_bad_set_points_when_they_are_given() -> None:
    late = spun_up(only(delay_s=0.01))
    with pytest.raises(ValueError, match="must be finite"):
        late.command(np.full(9, np.nan))
    with pytest.raises(ValueError, match="shape"):
        late.command(np.zeros(8))


def test_a_battery_that_is_off_makes_all_wheels_alike_faster_or_slower() -> None:
    spins = spun_up(only(battery_share=0.03), batch=(2000,)).joints[:, 2::3] / CRUISE[2] - 1.0
    np.testing.assert_allclose(spins, spins[:, :1] + np.zeros(3), atol=1e-9)
    assert spins[:, 0].std() == pytest.approx(0.03, rel=0.05)
    one = spun_up(only(battery_share=0.03))
    assert float(str(one.hardware_status()["battery_v"])) / 12.0 == pytest.approx(
        one.joints[2] / CRUISE[2]
    )


def test_motor_table_that_is_off_makes_all_wheels_alike_faster_or_slower() -> None:
    """Unlike with a battery that is off, the hardware reports no cause."""
    robot = spun_up(only(motor_share=0.04), batch=(2000,))
    spins = robot.joints[:, 2::3] / CRUISE[2] - 1.0
    np.testing.assert_allclose(spins, spins[:, :1] + np.zeros(3), atol=1e-9)
    assert spins[:, 0].std() == pytest.approx(0.04, rel=0.05)
    one = spun_up(only(motor_share=0.04))
    assert one.hardware_status()["battery_v"] == 12.0


def test_layers_change_the_way_by_at_most_half_of_one() -> None:
    layer_m = 0.0002
    ways = []
    for tilt_deg in np.arange(2.0, 20.0, 0.5):
        robot = spun_up(only(layer_m=layer_m))
        # With equal gimbals, the robot turns on the spot by the mean of its wheels.
        setpoint = CRUISE.copy()
        setpoint[0::3] = np.round(np.radians(tilt_deg) / STEP) * STEP
        robot.command(setpoint)
        robot.advance(1.0)
        ways.append(robot.twist()[2] / DRIVE.forward(robot.joints).twist[2] - 1.0)
    most = 0.5 * layer_m / 0.04
    assert 0.3 * most < np.abs(ways).max() <= most * (1.0 + 1e-9)
    assert np.sign(ways).min() < 0.0 < np.sign(ways).max()


def test_the_scale_turns_all_of_them_off_and_what_is_described_has_a_size() -> None:
    sizes = msgspec.structs.asdict(ROBOT.errors)
    assert {key for key, size in sizes.items() if size == 0.0} == {
        "mount_deg", "place_m", "slope_deg",
    }  # fmt: skip
    assert not any(msgspec.structs.astuple(ROBOT.with_errors(0.0).errors))
    half = ROBOT.with_errors(0.5).errors
    assert half.backlash_deg == 0.5 * ROBOT.errors.backlash_deg
    for scale in (-1.0, float("nan"), float("inf")):
        with pytest.raises(TwinError, match="scaled by 0"):
            ROBOT.with_errors(scale)
    plain, none = simulate(ROBOT), simulate(only(), errors=1.0)
    for robot in (plain, none):
        robot.command(DRIVE.inverse(np.array([0.5, 0.0, 0.2])))
        robot.advance(1.0)
    np.testing.assert_array_equal(plain.joints, none.joints)
