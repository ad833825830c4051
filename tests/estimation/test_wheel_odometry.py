"""Odometry against an independent integration, and its covariance against Monte Carlo runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tsd_twin import robots
from tsd_twin.estimation import PlanarOdometry, exponential_error
from tsd_twin.estimation.joint_errors import FloorEffects
from tsd_twin.lie import SE2, Array
from tsd_twin.robots import FloorErrors, JointErrors

ROBOT = robots.load_robot("tsd")
DRIVE = ROBOT.kinematics()
EXACT = JointErrors()
DT_S = 0.01

unhurried = settings(max_examples=25)


def new_odometry(noise: JointErrors = EXACT) -> PlanarOdometry:
    return PlanarOdometry(DRIVE, noise)


# The pose.


def body_velocity(joints: Array, rates: Array) -> Array:
    """Least-squares twist of a plate on gimbals with rolling spheres."""
    return solved(joints, rates)[0]


def solved(joints: Array, rates: Array) -> tuple[Array, float]:
    """That twist and its squared rolling residual, from rigid bodies without formulas."""
    rows, ground = [], []
    for i, azimuth in enumerate(DRIVE.azimuths_rad):
        alpha, beta, spin = joints[3 * i : 3 * i + 3]
        alpha_rate, beta_rate = rates[3 * i : 3 * i + 2]
        outward = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        up = np.array([0.0, 0.0, 1.0])
        along = np.cross(outward, up)
        # The inner gimbal's axis is turned by the outer one; positive alpha tips the axle outward.
        inner = np.cos(beta) * along - np.sin(beta) * up
        upright = np.sin(beta) * along + np.cos(beta) * up
        axle = np.cos(alpha) * upright + np.sin(alpha) * outward
        omega = spin * axle + beta_rate * outward - alpha_rate * inner
        # The contact point is one wheel radius below the centre of the sphere.
        ground.append(-np.cross(omega, -DRIVE.wheel_radius_m * up)[:2])
        x, y = DRIVE.pivot_radius_m * outward[:2]
        rows.append([[1.0, 0.0, -y], [0.0, 1.0, x]])
    twist, left, *_ = np.linalg.lstsq(np.concatenate(rows), np.concatenate(ground), rcond=None)
    return twist, float(left[0])


def integrated(joints_at: Callable[[float], Array], seconds: float, step_s: float) -> Array:
    """Integrate x, y and heading in world axes by fourth-order Runge-Kutta."""

    def rate(t_s: float, pose: Array) -> Array:
        nudge = 1e-6
        rates = (joints_at(t_s + nudge) - joints_at(t_s - nudge)) / (2 * nudge)
        vx, vy, omega = body_velocity(joints_at(t_s), rates)
        c, s = np.cos(pose[2]), np.sin(pose[2])
        return np.array([c * vx - s * vy, s * vx + c * vy, omega])

    pose = np.zeros(3)
    for i in range(round(seconds / step_s)):
        t_s = i * step_s
        k1 = rate(t_s, pose)
        k2 = rate(t_s + step_s / 2, pose + step_s / 2 * k1)
        k3 = rate(t_s + step_s / 2, pose + step_s / 2 * k2)
        k4 = rate(t_s + step_s, pose + step_s * k3)
        pose = pose + step_s / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return pose


@unhurried
@given(
    amplitudes=st.lists(st.floats(-0.2, 0.2), min_size=6, max_size=6),
    phases=st.lists(st.floats(0.0, 6.0), min_size=6, max_size=6),
    spins=st.lists(st.floats(200.0, 300.0), min_size=3, max_size=3),
)
def test_it_follows_rolling_spheres_also_when_they_disagree(
    amplitudes: list[float], phases: list[float], spins: list[float]
) -> None:
    """Each gimbal swings separately, up to 0.5 rad/s and 11 degrees, more than driving needs."""

    def joints_at(t_s: float) -> Array:
        joints = np.zeros(9)
        for i, (amplitude, phase) in enumerate(zip(amplitudes, phases, strict=True)):
            joints[i + i // 2] = amplitude * np.sin(2.5 * t_s + phase)
        joints[2::3] = spins
        return joints

    odometry = new_odometry()
    for i in range(201):
        odometry.advance(joints_at(i * DT_S), DT_S)
    # The first sample is the start, with its motion over one period.
    start = new_odometry()
    start.advance(joints_at(0.0), DT_S)
    moved = (start.pose.inverse() @ odometry.pose).xy_heading
    np.testing.assert_allclose(moved, integrated(joints_at, 2.0, 0.02), atol=5e-4)


@given(
    twist=st.tuples(*[st.floats(-0.7, 0.7)] * 2, st.floats(-3.0, 3.0)),
    periods=st.integers(1, 300),
)
def test_a_constant_twist_is_an_arc_to_the_last_digit(
    twist: tuple[float, float, float], periods: int
) -> None:
    odometry = new_odometry()
    for _ in range(periods):
        odometry.advance(DRIVE.inverse(np.array(twist)), DT_S)
    t_s = periods * DT_S
    vx, vy, omega = twist
    # The integral of a rotating velocity, as a complex number.
    turn = 1j * omega * t_s
    chord = (np.expm1(turn) / turn if abs(turn) > 1e-8 else 1.0 + turn / 2) * t_s * (vx + 1j * vy)
    np.testing.assert_allclose(
        odometry.pose.xy_heading, [chord.real, chord.imag, omega * t_s], atol=1e-9
    )
    np.testing.assert_allclose(odometry.motion.twist, twist, atol=1e-12)


def test_tilting_and_coming_back_leaves_no_more_than_was_driven() -> None:
    """The gimbal-rate terms cancel over a closed movement, for any period."""
    for dt_s in (0.002, 0.01, 0.04):
        odometry = new_odometry()
        for t_s in np.arange(0.0, 1.0 + dt_s / 2, dt_s):
            joints = np.zeros(9)
            joints[0::3] = 0.3 * np.sin(np.pi * t_s) ** 2
            odometry.advance(joints, dt_s)
        np.testing.assert_allclose(odometry.pose.xy_heading[:2], 0.0, atol=1e-12)


def test_the_first_measurement_moves_nothing_by_being_the_first() -> None:
    odometry = new_odometry()
    tilted = np.zeros(9)
    tilted[0::3] = 0.4  # With wheels at rest.
    odometry.advance(tilted, DT_S)
    np.testing.assert_array_equal(odometry.pose.xy_heading, 0.0)


def test_a_pose_that_is_set_is_kept_and_certain() -> None:
    odometry = new_odometry(ROBOT.joint_errors())
    drive_for(odometry, np.array([0.5, 0.0, 1.0]), 1.0)
    where = np.array([1.0, -2.0, 7.0])
    odometry.set_pose(SE2(where))
    np.testing.assert_array_equal(odometry.pose.xy_heading, [1.0, -2.0, 7.0])
    np.testing.assert_array_equal(odometry.pose_covariance, 0.0)


# The covariance.


def drive_for(odometry: PlanarOdometry, twist: Array, seconds: float) -> None:
    for _ in range(round(seconds / DT_S)):
        odometry.advance(DRIVE.inverse(twist), DT_S)


twists = st.tuples(*[st.floats(-0.7, 0.7)] * 2, st.floats(-3.0, 3.0)).map(np.array)


@given(script=st.lists(twists, min_size=1, max_size=5))
def test_covariances_are_symmetric_and_never_negative(script: list[Array]) -> None:
    odometry = new_odometry(ROBOT.joint_errors())
    for twist in script:
        drive_for(odometry, twist, 0.1)
        for covariance in (odometry.pose_covariance, odometry.twist_covariance):
            scale = np.abs(covariance).max()
            np.testing.assert_allclose(covariance, covariance.T, rtol=0, atol=1e-12 * scale)
            assert np.linalg.eigvalsh(covariance).min() >= -1e-12 * scale


WHITE = JointErrors(angle_rad=4e-4)
"""Errors drawn independently for each sample."""
ANGLES = JointErrors(angle_rad=4e-4, zero_rad=2e-4)
"""Errors whose effect does not depend on the motion."""


@given(script=st.lists(twists, min_size=1, max_size=5))
def test_doubt_of_what_is_new_in_each_sample_never_shrinks(script: list[Array]) -> None:
    odometry = new_odometry(WHITE)
    volume, heading_variance = 0.0, 0.0
    for twist in script:
        drive_for(odometry, twist, 0.1)
        # Driving redistributes uncertainty but never reduces it.
        assert np.linalg.det(odometry.pose_covariance) >= volume * (1.0 - 1e-9)
        assert odometry.pose_covariance[2, 2] > heading_variance
        volume = np.linalg.det(odometry.pose_covariance)
        heading_variance = odometry.pose_covariance[2, 2]


def test_what_a_wrong_spin_adds_on_the_way_out_it_takes_off_on_the_way_back() -> None:
    """A constant relative error cancels exactly when a twist is driven forward and backward."""
    odometry = new_odometry(JointErrors(speed_scale_sigma=0.01, common_spin_share=0.02))
    drive_for(odometry, np.array([0.5, 0.0, 0.0]), 2.0)
    out_m = np.sqrt(np.diag(odometry.pose_covariance))
    assert out_m[0] == pytest.approx(np.hypot(0.01 / np.sqrt(3.0), 0.02), rel=0.01)
    drive_for(odometry, np.array([-0.5, 0.0, 0.0]), 2.0)
    back_m = np.sqrt(np.diag(odometry.pose_covariance))
    assert (back_m < 0.02 * out_m).all()


@given(twist=twists, heading=st.floats(-3.0, 3.0))
def test_how_much_is_known_does_not_depend_on_where_north_is(twist: Array, heading: float) -> None:
    """A rotated drive has the rotated covariance."""
    straight, turned = new_odometry(ROBOT.joint_errors()), new_odometry(ROBOT.joint_errors())
    turned.set_pose(SE2(np.array([0.0, 0.0, heading])))
    for odometry in (straight, turned):
        drive_for(odometry, twist, 0.5)
    c, s = np.cos(heading), np.sin(heading)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(
        turned.pose_covariance, turn @ straight.pose_covariance @ turn.T, rtol=1e-9, atol=1e-15
    )


@given(
    twist=twists.map(lambda twist: 0.5 * twist),
    joint=st.sampled_from([0, 1, 3, 4, 6, 7]),
    off_rad=st.floats(0.01, 0.02),
)
def test_what_joints_contradict_one_another_by_is_doubted_as_much(
    twist: Array, joint: int, off_rad: float
) -> None:
    """With a stuck gimbal, variances grow with the squares of the residual."""
    doubts, lefts = [], []
    for size in (0.0, off_rad, 2.0 * off_rad):
        joints = DRIVE.inverse(twist)
        joints[joint] += size
        odometry = new_odometry(ANGLES)
        for _ in range(100):
            odometry.advance(joints, DT_S)
        doubts.append((np.trace(odometry.twist_covariance), odometry.pose_covariance[2, 2]))
        lefts.append(solved(joints, np.zeros(9))[1])
    grown, expected = np.array(doubts[2]) / doubts[1], lefts[2] / lefts[1]
    # The residual caused by noise depends slightly on the gimbal angles.
    np.testing.assert_allclose(grown, expected, rtol=0.25)
    assert doubts[1][0] > 4.0 * doubts[0][0]
    assert doubts[1][1] > 4.0 * doubts[0][1]


SPIN_RAD_PER_S = float(DRIVE.inverse(np.zeros(3))[2])
FLOOR = FloorErrors(
    at_rad_per_s=SPIN_RAD_PER_S,
    speed_scale_sigma=0.01,
    slip_lag_s=0.012,
    droop_s2_per_m2=0.08,
    restore_up_s=0.12,
    restore_down_s=0.3,
)
"""Errors with three causes, none of which turns the robot."""
START_MPS = [*[0.0] * 20, *np.linspace(0.0, 0.5, 13), *[0.5] * 92]
"""Speeds during 1.25 s: at rest, then accelerating at 4 m/s2."""


def spread_of(floor: FloorErrors, joints: Sequence[Array]) -> Array:
    """Standard deviations (3,) from the floor alone, after steps at `joints` (n,) from rest."""
    variances: list[Array] = []
    for each in (floor, FloorErrors()):
        # Without angle noise, interpolation would be doubted.
        odometry = new_odometry(JointErrors(angle_rad=1e-4, floor=each))
        drive_for(odometry, np.zeros(3), 0.1)
        odometry.set_pose(SE2.identity())
        for one in joints:
            odometry.advance(one, DT_S)
        variances.append(np.diag(odometry.pose_covariance))
    return np.sqrt(np.maximum(variances[0] - variances[1], 0.0))


def test_drag_lag_and_lost_energy_at_a_start_are_independent() -> None:
    """A start to 1 m/s within 0.25 s, then 2 m: drag, slip and lost energy."""
    speeds = np.minimum(4.0 * DT_S * np.arange(225), 1.0)
    joints = [DRIVE.inverse(np.array([speed, 0.0, 0.0])) for speed in speeds]
    alone = [
        spread_of(floor, joints)[0]
        for floor in (
            # Without lag there is no floor term.
            replace(FLOOR, slip_lag_s=1e-9, droop_s2_per_m2=0.0),
            replace(FLOOR, speed_scale_sigma=0.0, droop_s2_per_m2=0.0),
            replace(FLOOR, slip_lag_s=1e-9, speed_scale_sigma=0.0),
        )
    ]
    assert alone[0] == pytest.approx(0.01 * DT_S * speeds.sum(), rel=0.05)
    assert alone[1] == pytest.approx(0.012 * 1.0, rel=0.05)
    # The motors restore it during the acceleration.
    assert 0.5 * 0.08 * 0.12 < alone[2] < 0.08 * 0.12
    assert spread_of(FLOOR, joints)[0] == pytest.approx(math.hypot(*alone), rel=1e-3)


def test_faster_wheels_slide_further_and_turn_the_robot_faster() -> None:
    """At twice the wheel speed, the rim of the contact patch is twice as fast."""
    fast = replace(DRIVE, spin_rad_per_s=2.0 * SPIN_RAD_PER_S)
    lag = FloorErrors(SPIN_RAD_PER_S, slip_lag_s=0.01)
    turn = FloorErrors(SPIN_RAD_PER_S, slip_lag_s=1e-9, turn_rad_per_s=0.002)
    for floor, i, expected in ((lag, 0, 0.01 * 0.5), (turn, 2, 0.002 * 1.25)):
        for drive, times in ((DRIVE, 1.0), (fast, 2.0)):
            rests = [drive.inverse(np.zeros(3))] * 25
            joints = [drive.inverse(np.array([speed, 0.0, 0.0])) for speed in START_MPS]
            still = np.asarray(spread_of(floor, rests)[i])
            assert spread_of(floor, rests + joints)[i] - still == pytest.approx(
                times * expected, rel=0.05
            )


def test_wheels_that_change_their_speed_turn_the_robot() -> None:
    """By the lag at the mean speed, times the turn rate equivalent to the change of the spin."""
    floor = FloorErrors(SPIN_RAD_PER_S, slip_lag_s=0.01, turn_per_spin=0.001)
    at_rest = DRIVE.inverse(np.zeros(3))
    shares = [*[1.0] * 20, *np.linspace(1.0, 2.0, 50), *[2.0] * 80]
    joints = [np.where(at_rest == SPIN_RAD_PER_S, share * at_rest, 0.0) for share in shares]
    expected_rad = 0.01 * 1.5 * 3.0 * 0.001 * SPIN_RAD_PER_S
    turned_rad = spread_of(floor, joints)[2]
    assert turned_rad == pytest.approx(expected_rad, rel=0.1)
    # It turns back when they slow down, except for a random quarter of the rate, which lasts 0.2 s,
    # in both changes of 0.5 s.
    left_rad = 0.25 * expected_rad * math.sqrt(2.0 * 0.2 / 0.5)
    slower = joints + joints[:20:-1] + 30 * joints[:1]
    assert spread_of(floor, slower)[2] == pytest.approx(left_rad, rel=0.1)
    # It does not turn at constant wheel speed.
    assert spread_of(floor, joints + 100 * joints[-1:])[2] == pytest.approx(turned_rad, rel=1e-6)


def test_a_robot_that_has_stopped_does_not_slide_on() -> None:
    """Also if its encoders have shown the same steps since."""
    floor = FloorErrors(SPIN_RAD_PER_S, slip_lag_s=0.01)
    speeds_mps = [*START_MPS, *np.linspace(0.5, 0.0, 12), *[0.0] * 400]
    joints = [DRIVE.inverse(np.array([speed, 0.0, 0.0])) for speed in speeds_mps]
    assert spread_of(floor, joints[: len(START_MPS)])[0] == pytest.approx(5e-3, rel=0.05)
    # A random quarter of the slip does not cancel. It lasts 0.2 s, in two accelerations of 0.12 s,
    # which roughly fill a refresh period of 0.1 s.
    shortest, longest = (0.25 * 5e-3 * math.sqrt(2.0 * 0.2 / lasts_s) for lasts_s in (0.22, 0.12))
    assert shortest < spread_of(floor, joints)[0] < longest
    assert spread_of(floor, joints + 200 * joints[-1:])[0] == pytest.approx(
        spread_of(floor, joints)[0], rel=1e-3
    )


def slid_m(lag_s: float, grip_mps2: float, wheels_mps: Sequence[float], dt_s: float) -> float:
    """Way by which a body gains on its braking wheels: Euler steps of its equation of motion."""
    body_mps, way_m = wheels_mps[0], 0.0
    for speed_mps in wheels_mps:
        slip_mps = body_mps - speed_mps
        body_mps -= dt_s * grip_mps2 * slip_mps / (abs(slip_mps) + lag_s * grip_mps2)
        way_m += dt_s * slip_mps
    return way_m


@unhurried
@given(lag_s=st.floats(0.01, 0.1), grip_mps2=st.floats(1.0, 20.0), brakes_mps2=st.floats(3.0, 8.0))
def test_a_robot_slides_on_until_friction_has_stopped_it(
    lag_s: float, grip_mps2: float, brakes_mps2: float
) -> None:
    """Also if the wheels demand more than the floor transmits."""
    fine_s, step_s = 1e-3, 0.02
    speeds = np.maximum(1.0 - brakes_mps2 * fine_s * np.arange(3000), 0.0)
    floor = FloorEffects(
        np.array([True]), FloorErrors(slip_lag_s=lag_s, grip_per_s2=(grip_mps2, grip_mps2, 1e3))
    )
    spin, way_m = np.array([1.0]), 0.0
    for _ in range(200):
        floor.follow(np.array([1.0, 0.0, 0.0]), spin, step_s)
    for speed_mps in speeds[:: round(step_s / fine_s)]:
        floor.follow(np.array([speed_mps, 0.0, 0.0]), spin, step_s)
        way_m += step_s * float(floor.of_twist(spin)[0, 1])
    assert way_m == pytest.approx(slid_m(lag_s, grip_mps2, speeds.tolist(), fine_s), rel=0.1)


def test_without_a_limit_a_robot_slides_by_the_lag_times_the_change_of_its_speed() -> None:
    """For steps of any length and changes in any direction."""
    random, spin, way, twist = np.random.default_rng(0), np.array([1.0]), np.zeros(3), np.zeros(3)
    floor = FloorEffects(
        np.array([True]), FloorErrors(slip_lag_s=0.03, grip_per_s2=(1e5, 1e5, 1e5))
    )
    for i in range(400):
        if i < 20:
            twist = np.array([*random.normal(size=2), 0.0])
        dt_s = float(random.uniform(0.002, 0.2))
        floor.follow(twist, spin, dt_s)
        way -= dt_s * floor.of_twist(spin)[:, 1]
    np.testing.assert_allclose(way, 0.03 * twist, rtol=2e-3)


def test_without_noise_in_the_description_nothing_is_uncertain() -> None:
    odometry = new_odometry()
    drive_for(odometry, np.array([0.5, 0.2, 1.0]), 2.0)
    assert np.abs(odometry.pose_covariance).max() < 1e-9


@pytest.mark.parametrize(
    ("twist", "turned"),
    [([1.0, 0.0, 0.0], 0.3), ([0.0, -0.7, 0.0], 2.0), ([0.0, 0.0, 2.0], 0.0), ([0.5, 0.0, 1.0], 0)],
    ids=["straight", "strafe", "turn", "circle"],
)
def test_constant_errors_spread_as_far_as_is_claimed(twist: list[float], turned: float) -> None:
    """Drive robots with random zeros and spins for 10 s; compare means and covariances."""
    random = np.random.default_rng(1)
    noise = JointErrors(speed_scale_sigma=0.01, common_spin_share=0.01, zero_rad=2e-4)
    joints, runs, seconds = DRIVE.inverse(np.array(twist)), 600, 10.0
    is_wheel = np.arange(9) % 3 == 2
    claim = new_odometry(noise)
    claim.set_pose(SE2(np.array([1.0, 2.0, turned])))
    start = claim.pose
    drive_for(claim, np.array(twist), seconds)
    own = noise.speed_scale_sigma * random.standard_normal((runs, 9))
    common = noise.common_spin_share * random.standard_normal((runs, 1))
    zeros = noise.zero_rad * random.standard_normal((runs, 9))
    wrong = joints + np.where(is_wheel, (own + common) * joints, zeros)
    ends = DRIVE.integrate(start, DRIVE.forward(wrong).twist, seconds)
    errors = exponential_error(claim.pose, ends)
    # The normalized squared distance averages three if the covariance is right.
    squared = np.einsum("ij,jk,ik->i", errors, np.linalg.inv(claim.pose_covariance), errors)
    assert 2.5 < squared.mean() < 3.5
    plane = claim.pose_covariance[:2, :2]
    inside = np.einsum("ij,jk,ik->i", errors[:, :2], np.linalg.inv(plane), errors[:, :2]) < 4.0
    assert 0.80 < inside.mean() < 0.95
    ratio = np.sqrt(np.square(errors).mean(axis=0) / np.diag(claim.pose_covariance))
    np.testing.assert_allclose(ratio, 1.0, atol=0.15)


def test_the_twist_at_the_end_of_a_step_is_that_of_its_end() -> None:
    """At constant acceleration, half a step adds half: 0.1 rad/s at 20 rad/s2."""
    odometry = new_odometry()
    for i in range(15):
        odometry.advance(DRIVE.inverse(np.array([0.0, 0.0, 20.0 * DT_S * i])), DT_S)
    assert odometry.end_twist[2] == pytest.approx(20.0 * DT_S * 14, rel=1e-3)
    assert odometry.motion.twist[2] == pytest.approx(20.0 * DT_S * 13.5, rel=1e-3)


def test_errors_of_a_pose_are_kept_when_it_is_set_with_them() -> None:
    one = new_odometry(ROBOT.joint_errors())
    drive_for(one, np.array([0.5, 0.1, 0.7]), 1.0)
    state = one.uncertainty.state
    if state is None:
        drive_for(one, np.array([0.5, 0.1, 0.7]), 0.01)
        state = one.uncertainty.state
    errors = one.uncertainty.errors_at(state)
    other = new_odometry(ROBOT.joint_errors())
    other.set_pose(one.pose, errors)
    np.testing.assert_allclose(errors.covariance, one.pose_covariance, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(other.pose_covariance, one.pose_covariance, rtol=1e-6, atol=1e-12)
