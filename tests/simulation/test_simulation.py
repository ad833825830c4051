"""Whole robots in virtual time end at the calculated pose, alone or in a batch."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from tsd_twin.lie import SE2, Array
from tsd_twin.robots import RobotDescription, SingularityDescription, load_robot
from tsd_twin.simulation import Simulation, simulate

ROBOT = load_robot("tsd")
DRIVE = ROBOT.kinematics()
CRUISE = 2500.0 * 2.0 * np.pi / 60.0
STEP = 2.0 * np.pi / 4096


def command(twist: list[float] | Array) -> Array:
    return DRIVE.inverse(np.asarray(twist, dtype=float))


def spun_up(
    robot: RobotDescription = ROBOT, batch: tuple[int, ...] = (), **options: float
) -> Simulation:
    """A robot at rest at the origin, with its wheels at cruising speed."""
    simulation = simulate(robot, batch, **options)
    idle = command([0.0, 0.0, 0.0])
    idle[2::3] = 0.0
    simulation.command(idle)
    simulation.advance(2.0)
    simulation.command(command([0.0, 0.0, 0.0]))
    simulation.advance(30.0)
    return simulation


def test_wheels_spin_up_to_the_cruising_speed_and_the_robot_stands() -> None:
    simulation = spun_up()
    np.testing.assert_allclose(simulation.joints[2::3], CRUISE, rtol=1e-9)
    np.testing.assert_array_equal(simulation.joints[0::3], 0.0)
    np.testing.assert_array_equal(simulation.joints[1::3], 0.0)
    np.testing.assert_array_equal(simulation.pose.xy_heading, 0.0)


@pytest.mark.parametrize(
    "twist",
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-0.7, 0.0, 0.0], [0.0, 0.0, 1.5], [0.0, 0.0, -3.0]],
    ids=["straight", "strafe", "back", "left", "right"],
)
def test_a_drive_ends_where_dead_reckoning_says(twist: list[float]) -> None:
    """A command for 2 s, then rest for 1 s; lag only delays the motion.

    By hand: a wheel whose axle is tilted by (l_x, l_y) moves the robot by r spin (l_y, -l_x), in
    whole servo steps, and a turn by r spin l / R.
    """
    simulation = spun_up()
    for goal, seconds in ((twist, 2.0), ([0.0, 0.0, 0.0], 1.0)):
        simulation.command(command(goal))
        for _ in range(round(seconds * 100)):
            simulation.advance(0.01)
    x, y, heading = simulation.pose.xy_heading
    steps = 2.0 * (0.04 * CRUISE) * STEP / 2.0
    for value, wanted in zip((x, y), twist, strict=False):
        assert value == pytest.approx(2.0 * wanted, abs=steps + 0.002)
    assert heading == pytest.approx(2.0 * twist[2], abs=steps / 0.15 + 0.005)


def test_a_turn_on_the_spot_stays_on_the_spot() -> None:
    """All modules lean by the same number of steps, so the result is exact."""
    simulation = spun_up()
    simulation.command(command([0.0, 0.0, 1.5]))
    simulation.advance(1.0)
    steady = simulation.pose
    simulation.advance(1.0)
    lean = round(float(np.arcsin(0.15 * 1.5 / (0.04 * CRUISE))) / STEP) * STEP
    turned = (steady.inverse() @ simulation.pose).log()
    expected = [0.0, 0.0, 0.04 * CRUISE * np.sin(lean) / 0.15]
    np.testing.assert_allclose(turned, expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose(simulation.pose.xy_heading[:2], 0.0, atol=1e-12)


def rolling(joints: Array, rates: Array) -> Array:
    """Twist by rolling, written out for the robot of the thesis: r_w = 40 mm, R = 150 mm."""
    rows, velocities = [], []
    for azimuth, (a, b, spin), (a_rate, b_rate, _) in zip(
        np.radians([90.0, 210.0, 330.0]), joints, rates, strict=True
    ):
        outward = np.array([np.cos(azimuth), np.sin(azimuth)])
        tangential = np.array([outward[1], -outward[0]])
        along = 0.04 * (spin * np.sin(a) + b_rate)
        across = 0.04 * (-spin * np.cos(a) * np.sin(b) + a_rate * np.cos(b))
        velocities.append(along * tangential + across * outward)
        rows += [[1.0, 0.0, -0.15 * outward[1]], [0.0, 1.0, 0.15 * outward[0]]]
    return np.linalg.lstsq(np.array(rows), np.concatenate(velocities), rcond=None)[0]


def test_the_whole_chain_solves_its_differential_equations() -> None:
    """Servos, motors and pose together, against 50 times finer midpoint steps."""
    random = np.random.default_rng(3)
    goals = [command(twist) for twist in random.uniform(-1.0, 1.0, size=(6, 3)) * [1, 1, 3]]
    goals[3][2::3] = np.array([2600.0, 3000.0, 0.0]) * np.pi / 30.0
    simulation = spun_up()
    joints, pose, h = np.zeros((3, 3)), np.zeros(3), 2e-4
    joints[:, 2] = CRUISE
    for goal in goals:
        simulation.command(goal)
        for _ in range(5):
            simulation.advance(0.01)
        wanted = np.round(goal.reshape(3, 3) / STEP) * STEP
        wanted[:, 2] = goal[2::3]

        def rates(joints: Array, wanted: Array = wanted) -> Array:
            error = wanted - joints
            rate = np.clip(32.0 * error, -63.0 * np.pi / 30.0, 63.0 * np.pi / 30.0)
            rate[:, 2] = error[:, 2] / np.where(error[:, 2] > 0.0, 0.12, 0.3)
            return rate

        for _ in range(250):
            middle = joints + 0.5 * h * rates(joints)
            tangent = h * rolling(middle, rates(middle))
            pose = (SE2(pose) @ SE2.exp(tangent)).xy_heading
            joints = joints + h * rates(middle)
    np.testing.assert_allclose(simulation.joints.reshape(3, 3), joints, rtol=0, atol=2e-3)
    np.testing.assert_allclose(simulation.pose.xy_heading, pose, rtol=0, atol=2e-5)
    assert np.abs(pose).max() > 0.05


def wander(simulation: Simulation, twists: Array) -> None:
    for twist in twists:
        simulation.command(DRIVE.inverse(twist))
        simulation.advance(0.01)


def test_a_batch_is_its_members() -> None:
    twists = np.random.default_rng(0).normal(size=(40, 2, 3, 3))
    together = spun_up(batch=(2, 3))
    wander(together, twists)
    for at in np.ndindex(2, 3):
        alone = spun_up()
        wander(alone, twists[:, *at])
        close = {"rtol": 1e-12, "atol": 1e-13}
        np.testing.assert_allclose(together.pose.xy_heading[at], alone.pose.xy_heading, **close)
        np.testing.assert_allclose(together.joints[at], alone.joints, **close)
        np.testing.assert_allclose(together.twist()[at], alone.twist(), **close)
        np.testing.assert_allclose(together.measure()[at], alone.measure(), **close)


def test_one_robot_in_plain_floats_has_the_bits_of_a_batch() -> None:
    random = np.random.default_rng(1)
    alone, batch = spun_up(), spun_up(batch=(1,))
    for _ in range(60):
        # Servos at their top speed and near their goals; motors on, off, faster and slower.
        twist = random.uniform(-1.0, 1.0, 3) * random.choice([0.01, 1.0])
        setpoint = ROBOT.kinematics().inverse(twist)
        setpoint[2::3] *= random.choice([0.0, 0.9, 1.0])
        for simulation in (alone, batch):
            simulation.command(setpoint)
        for dt_s in random.choice([0.003, 0.01, 0.2], 5).tolist():
            alone.advance(dt_s)
            batch.advance(dt_s)
            assert alone.joints.tobytes() == batch.joints[0].tobytes()
            assert alone.measure().tobytes() == batch.measure()[0].tobytes()


def test_one_command_serves_a_whole_batch() -> None:
    simulation = spun_up(batch=(4,))
    simulation.command(command([0.5, 0.0, 0.0]))
    simulation.advance(1.0)
    poses = simulation.pose.xy_heading
    np.testing.assert_array_equal(poses, np.tile(poses[0], (4, 1)))
    assert poses[0, 0] > 0.4


def test_noise_has_the_size_that_the_description_gives_it() -> None:
    """Spins differ by a constant 1 %; angles by 0.025 degrees and rounding to steps."""
    simulation = spun_up(batch=(2000,), noise=1.0, seed=5)
    spins = simulation.joints[:, 2::3].copy()
    assert spins.mean() == pytest.approx(CRUISE, rel=1e-3)
    assert spins.std() / CRUISE == pytest.approx(0.01, rel=0.03)
    simulation.advance(1.0)
    np.testing.assert_allclose(simulation.joints[:, 2::3], spins, rtol=1e-9)
    angles = simulation.measure().reshape(-1, 3, 3)[..., :2]
    assert angles.mean() == pytest.approx(0.0, abs=2e-5)
    # A normal 0.025 degrees wide falls beyond half a step of 0.0879 in 7.9 % of all cases.
    assert np.count_nonzero(angles) / angles.size == pytest.approx(0.079, abs=0.01)
    np.testing.assert_array_equal(simulation.joints.reshape(-1, 3, 3)[..., :2], 0.0)


def test_without_noise_nothing_is_random() -> None:
    one, other = spun_up(seed=1), spun_up(seed=2)
    wander(one, np.full((5, 3), 0.3))
    wander(other, np.full((5, 3), 0.3))
    np.testing.assert_array_equal(one.measure(), other.measure())
    np.testing.assert_array_equal(one.pose.xy_heading, other.pose.xy_heading)


def test_a_flat_battery_slows_motors_and_servos() -> None:
    fresh, flat = spun_up(), spun_up(battery_v=6.0)
    np.testing.assert_allclose(flat.joints[2::3], 0.5 * fresh.joints[2::3], rtol=1e-9)
    for simulation in (fresh, flat):
        simulation.command(np.tile([0.5, 0.0, CRUISE], 3))
        simulation.advance(0.02)
    np.testing.assert_allclose(flat.joints[0::3], 0.5 * fresh.joints[0::3], rtol=1e-12)


def test_a_calibrated_robot_drives_as_one_that_needs_no_calibration() -> None:
    """The end differs by the rounding of different angles: at most one step per gimbal."""
    odd = msgspec.structs.replace(
        ROBOT,
        calibration=type(ROBOT.calibration)(
            tilt_offset_deg=[(1.3, -0.4), (0.2, 2.0), (-1.0, 0.7)], spin_scale=[1.05, 0.93, 1.0]
        ),
    )
    plain, calibrated = spun_up(), spun_up(odd)
    np.testing.assert_allclose(calibrated.joints, plain.joints, atol=STEP / 2 + 1e-6)
    np.testing.assert_allclose(calibrated.measure(), calibrated.joints, atol=1e-9)
    for simulation in (plain, calibrated):
        simulation.pose = SE2(np.zeros(3))
        simulation.command(command([0.5, -0.2, 0.4]))
        simulation.advance(1.0)
    apart = calibrated.pose.xy_heading - plain.pose.xy_heading
    assert np.abs(apart[:2]).max() < np.sqrt(2.0) * 0.04 * CRUISE * STEP
    assert not np.allclose(calibrated.joints, plain.joints, atol=1e-9)


def test_a_robot_can_start_anywhere() -> None:
    start = SE2(np.array([1.0, -2.0, np.pi / 2]))
    simulation = spun_up(pose=start)
    simulation.command(command([0.5, 0.0, 0.0]))
    simulation.advance(1.0)
    elsewhere = spun_up()
    elsewhere.command(command([0.5, 0.0, 0.0]))
    elsewhere.advance(1.0)
    np.testing.assert_allclose(
        simulation.pose.xy_heading, (start @ elsewhere.pose).xy_heading, atol=1e-12
    )
    np.testing.assert_array_equal(start.xy_heading, [1.0, -2.0, np.pi / 2])


def test_set_points_must_be_numbers_one_for_each_joint() -> None:
    simulation = spun_up()
    for bad in (np.nan, np.inf, -np.inf):
        setpoint = command([0.5, 0.0, 0.0])
        setpoint[4] = bad
        with pytest.raises(ValueError, match="must be finite"):
            simulation.command(setpoint)
    with pytest.raises(ValueError, match="shape"):
        simulation.command(np.zeros(8))
    simulation.advance(1.0)
    np.testing.assert_array_equal(simulation.pose.xy_heading, 0.0)


def test_another_number_of_wheels_is_another_description_and_nothing_else() -> None:
    """Four wheels, with separate motor curves, drive like three do."""
    tables = msgspec.to_builtins(ROBOT)
    tables["drive"]["azimuths_deg"] = [45.0, 135.0, 225.0, 315.0]
    tables["motor"]["speed_rpm"].append(tables["motor"]["speed_rpm"][0])
    robot = msgspec.convert(tables, SingularityDescription)
    drive = robot.kinematics()
    simulation = simulate(robot)
    idle = drive.inverse(np.zeros(3))
    idle[2::3] = 0.0
    for setpoint, seconds in ((idle, 2.0), (drive.inverse(np.zeros(3)), 30.0)):
        simulation.command(setpoint)
        simulation.advance(seconds)
    simulation.command(drive.inverse(np.array([0.0, 1.0, 0.0])))
    simulation.advance(1.0)
    np.testing.assert_allclose(simulation.twist(), [0.0, 1.0, 0.0], atol=0.008)


@pytest.mark.parametrize("errors", [0.0, 1.0])
@pytest.mark.parametrize("times_s", [(0.01,), (0.01, 0.0101, 0.03, 0.2)])
def test_a_set_point_that_is_withdrawn_at_once_changes_nothing(
    errors: float, times_s: tuple[float, ...]
) -> None:
    # Steps that change no joint are cached, so make one of the two robots forget them.
    robot = ROBOT.with_errors(errors)
    steady, disturbed = spun_up(robot), spun_up(robot)
    setpoint, other = command([0.2, 0.1, 0.5]), command([-0.2, 0.3, 0.0])
    for step in range(1500):
        dt_s = times_s[step % len(times_s)]
        steady.command(setpoint)
        disturbed.command(other)
        disturbed.command(setpoint)
        steady.advance(dt_s)
        disturbed.advance(dt_s)
    np.testing.assert_array_equal(steady.joints, disturbed.joints)
    np.testing.assert_array_equal(steady.pose.xy_heading, disturbed.pose.xy_heading)
    np.testing.assert_array_equal(steady.measure(), disturbed.measure())
    steady.command(other)
    steady.advance(0.1)
    assert np.abs(steady.joints - disturbed.joints).max() > 1e-3, "it obeys as before"
