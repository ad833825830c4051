"""Pose fusion applies each measurement at its own time, in any order, or rejects it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from random import Random

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tsd_twin import robots
from tsd_twin.estimation import FusedEstimate, FusionResult, PlanarOdometry, exponential_error
from tsd_twin.estimation.pose_fusion import MAX_REPLAYED
from tsd_twin.lie import SE2, Array, wrap

ROBOT = robots.load_robot("tsd")
DRIVE = ROBOT.kinematics()
DT_S = 0.01
SIGMA = np.array([0.005, 0.005, np.radians(1.15)])
seeds = st.integers(0, 999)


class Ride:
    """Odometry along smooth random twists, with the true poses."""

    def __init__(self, seed: int, *, still: bool = False) -> None:
        self.random = np.random.default_rng(seed)
        self.odometry = PlanarOdometry(DRIVE, ROBOT.joint_errors())
        self.estimate = FusedEstimate(DRIVE, self.odometry, ROBOT.pose_sensor)
        self.now_s = 0.0
        self.truth = SE2.identity()
        self.past: list[tuple[float, SE2]] = []
        size = 0.0 if still else 1.0
        self.sizes = size * self.random.normal(size=(3, 3)) * [0.3, 0.3, 0.5]

    def step(self) -> None:
        self.now_s += DT_S
        waves = np.array([1.0, np.sin(2.0 * self.now_s), np.cos(3.0 * self.now_s)])
        # Ramp up, because a step would slip as far as the floor allows.
        twist = min(1.0, 2.0 * self.now_s) * waves @ self.sizes
        self.odometry.advance(DRIVE.inverse(twist), DT_S)
        self.truth = DRIVE.integrate(self.truth, self.odometry.motion.twist, DT_S)
        self.past.append((self.now_s, self.truth))
        self.estimate.follow(self.now_s)

    def steps(self, count: int) -> None:
        for _ in range(count):
            self.step()

    def seen(self, at: tuple[float, SE2]) -> SE2:
        """True pose with the noise stated in the description."""
        return SE2(at[1].xy_heading + SIGMA * self.random.standard_normal(3))

    def state(self) -> tuple[Array, Array]:
        return self.estimate.pose.xy_heading, self.estimate.pose_covariance


def same(one: Ride, other: Ride, tolerance: float = 1e-9) -> None:
    for a, b in zip(one.state(), other.state(), strict=True):
        np.testing.assert_allclose(a, b, rtol=tolerance, atol=tolerance)


@given(seed=seeds)
@settings(max_examples=10)
def test_while_nobody_sends_poses_it_is_the_inner_estimate(seed: int) -> None:
    ride = Ride(seed)
    ride.steps(30)
    assert ride.estimate.pose is ride.odometry.pose
    assert ride.estimate.pose_covariance is ride.odometry.pose_covariance
    assert not ride.estimate.is_corrected


@given(
    seed=seeds,
    when=st.lists(st.integers(0, 98), min_size=2, max_size=6, unique=True),
    shuffled=st.randoms(use_true_random=False),
)
@settings(max_examples=25)
def test_neither_the_order_nor_the_time_of_arrival_matters(
    seed: int, when: list[int], shuffled: Random
) -> None:
    at_once, late, mixed = Ride(seed), Ride(seed), Ride(seed)
    rides = (at_once, late, mixed)
    for ride in rides:
        ride.steps(20)
    seen: list[tuple[float, SE2]] = []
    for i in range(99):
        for ride in rides:
            ride.step()
        if i in when:
            seen.append((at_once.now_s - 0.004, at_once.seen(at_once.past[-1])))
            # One estimate fuses each pose at once, the others fuse all at the end.
            if (
                at_once.estimate.fuse(seen[-1][1], seen[-1][0], at_rest=False)
                is not FusionResult.USED
            ):
                seen.pop()
    in_any_order = shuffled.sample(seen, len(seen))
    for ride, order in ((late, seen), (mixed, in_any_order)):
        for at_s, pose in order:
            assert ride.estimate.fuse(pose, at_s, at_rest=False) is FusionResult.USED
        same(ride, at_once)


# Farther away than the robot can have been when a late pose was measured.
@given(seed=seeds, size=st.floats(3.0, 1e8), late=st.floats(0.0, 3.0), turn=st.floats(-3.0, 3.0))
@settings(max_examples=25)
def test_what_is_refused_changes_nothing(seed: int, size: float, late: float, turn: float) -> None:
    ride, other = Ride(seed), Ride(seed)
    for each in (ride, other):
        each.steps(120)
        each.estimate.fuse(each.truth, each.now_s, at_rest=False)
    for k in range(12):
        away = SE2(ride.truth.xy_heading + np.array([size * np.cos(k), size * np.sin(k), turn]))
        expected = (
            {FusionResult.GATED}
            if late < 0.99
            else {FusionResult.OLD}
            if late > 1.01
            else set(FusionResult)
        )
        assert ride.estimate.fuse(away, ride.now_s - late, at_rest=False) in expected
    assert ride.estimate.fuse(ride.truth, np.nan, at_rest=True) is FusionResult.OLD
    for each in (ride, other):
        each.steps(5)
    same(ride, other)


@given(seed=seeds)
@settings(max_examples=10)
def test_the_twist_is_that_of_the_joints_wherever_the_robot_is_seen(seed: int) -> None:
    ride, alone = Ride(seed), Ride(seed)
    for i in range(100):
        ride.step()
        alone.step()
        ride.estimate.fuse(ride.seen(ride.past[-1]), ride.now_s, at_rest=i % 2 == 0)
        np.testing.assert_array_equal(ride.estimate.end_twist, alone.estimate.end_twist)
        np.testing.assert_array_equal(
            ride.estimate.twist_covariance, alone.estimate.twist_covariance
        )


def test_no_more_are_kept_than_a_second_has_room_for() -> None:
    ride = Ride(0, still=True)
    ride.steps(110)
    fates = [
        ride.estimate.fuse(ride.truth, ride.now_s - 0.005 * i, at_rest=True)
        for i in range(189, -1, -1)
    ]
    assert fates == [FusionResult.USED] * 128 + [FusionResult.QUEUE_FULL] * 62
    ride.steps(110)
    assert ride.estimate.fuse(ride.truth, ride.now_s, at_rest=True) is FusionResult.USED


@given(seed=seeds, size=st.floats(0.0, 1e8))
@settings(max_examples=10)
def test_what_comes_after_many_that_are_newer_is_not_run_over_all_of_them(
    seed: int, size: float
) -> None:
    """In reverse order, the work per pose would otherwise keep growing."""
    ride = Ride(seed, still=True)
    ride.steps(110)
    backwards = [
        ride.estimate.fuse(ride.truth, ride.now_s - 0.01 * i, at_rest=True) for i in range(90)
    ]
    assert backwards == [FusionResult.USED] * (MAX_REPLAYED + 1) + [FusionResult.OLD] * (
        89 - MAX_REPLAYED
    )
    before = ride.estimate.pose.xy_heading.copy()
    late = SE2(ride.truth.xy_heading + np.array([size, 0.0, 0.0]))
    assert ride.estimate.fuse(late, ride.now_s - 0.9, at_rest=True) is FusionResult.OLD
    np.testing.assert_array_equal(ride.estimate.pose.xy_heading, before)
    assert ride.estimate.fuse(ride.truth, ride.now_s, at_rest=True) is FusionResult.USED


@given(seed=seeds)
@settings(max_examples=10)
def test_when_the_poses_end_it_goes_on_from_where_they_left_it(seed: int) -> None:
    ride = Ride(seed)
    ride.steps(100)
    for _ in range(20):
        ride.step()
        ride.estimate.fuse(ride.seen(ride.past[-1]), ride.now_s, at_rest=False)
    poses = [ride.estimate.pose.xy_heading]
    corrected: list[bool] = []
    for _ in range(300):
        ride.step()
        poses.append(ride.estimate.pose.xy_heading)
        corrected.append(ride.estimate.is_corrected)
    assert corrected[0]
    assert not corrected[-1]
    # No step exceeds the robot's motion in a period, so the handover causes no jump.
    steps = np.abs(np.diff(np.array(poses), axis=0)).max()
    assert steps < 0.05
    assert ride.estimate.pose is ride.odometry.pose


@pytest.mark.parametrize("mounting", [0.0, 1.0], ids=["exact", "mounted"])
def test_what_it_claims_is_right_while_all_is_wrong_as_described(mounting: float) -> None:
    """Normalized squared distances average three for three numbers.

    Twist errors are constant; the camera has a bias and noise.
    """
    distances: list[float] = []
    results: Counter[FusionResult] = Counter()
    sensor = ROBOT.pose_sensor
    sensor = msgspec.structs.replace(
        sensor,
        mounting_m=mounting * sensor.mounting_m,
        mounting_deg=mounting * sensor.mounting_deg,
    )
    sigma = np.array([sensor.mounting_m, sensor.mounting_m, np.radians(sensor.mounting_deg)])
    for seed in range(60):
        ride = Ride(seed)
        ride.estimate = FusedEstimate(DRIVE, ride.odometry, sensor)
        biases = ride.random.standard_normal(ride.odometry.uncertainty.bias_count)
        off = sigma * ride.random.standard_normal(3)
        for i in range(150):
            before = ride.truth
            ride.step()
            errors = ride.odometry.errors
            white = np.linalg.cholesky(errors.white_per_s + 1e-18 * np.eye(3)) * np.sqrt(DT_S)
            twist = ride.odometry.motion.twist + errors.bias_jacobian @ biases
            slip = white @ ride.random.standard_normal(3)
            ride.truth = DRIVE.integrate(before, twist + slip / DT_S, DT_S)
            ride.past[-1] = (ride.now_s, ride.truth)
            if i % 4 == 0 and i > 8:
                seen = SE2(ride.seen(ride.past[-9]).xy_heading + off)
                results[ride.estimate.fuse(seen, ride.past[-9][0], at_rest=False)] += 1
        errors = exponential_error(ride.estimate.pose, ride.truth)
        distances.append(float(errors @ np.linalg.solve(ride.estimate.pose_covariance, errors)))
    assert 2.2 < np.mean(distances) < 4.0
    # One in 10,000 correct poses is rejected, so three or more occur once in a thousand runs.
    assert results[FusionResult.USED] >= results.total() - 2 > 2000


def test_a_camera_that_is_off_all_the_time_is_not_believed_to_a_millimetre() -> None:
    """A constant offset of 2 cm does not average out, and the covariance reflects it."""
    ride = Ride(3)
    off = np.array([0.02, 0.0, 0.0])
    for i in range(2000):
        ride.step()
        if i % 4 == 0:
            seen = SE2(ride.seen(ride.past[-1]).xy_heading + off)
            ride.estimate.fuse(seen, ride.now_s, at_rest=False)
    errors = exponential_error(ride.estimate.pose, ride.truth)
    covariance = ride.estimate.pose_covariance
    assert float(errors @ np.linalg.solve(covariance, errors)) < 10.0
    assert 0.005 < np.sqrt(covariance[0, 0]) < 0.015


@pytest.mark.parametrize("turned", [0.0, 2.0, -3.0, 9.0])
def test_a_robot_at_rest_is_found_again_where_it_is_always_seen(turned: float) -> None:
    ride = Ride(1, still=True)
    ride.steps(10)
    elsewhere = (5.0, SE2(np.array([3.0, -2.0, turned])))
    fates: list[FusionResult] = []
    for _ in range(15):
        ride.steps(4)
        fates.append(ride.estimate.fuse(ride.seen(elsewhere), ride.now_s - 0.08, at_rest=True))
    # Relocalization after 0.5 s of gated frames at 25 Hz.
    first = fates.index(FusionResult.RELOCALIZED)
    assert fates == [FusionResult.GATED] * first + [FusionResult.RELOCALIZED] + [
        FusionResult.USED
    ] * (14 - first)
    assert first == 13
    off = ride.estimate.pose.xy_heading - elsewhere[1].xy_heading
    assert np.hypot(*off[:2]) < 0.03
    assert abs(wrap(off[2])) < 0.1
    assert abs(ride.estimate.pose.xy_heading[2]) <= np.pi + 0.1


@pytest.mark.parametrize(("at_rest", "scattered"), [(False, 0.0), (True, 0.5)])
def test_in_motion_or_by_poses_that_disagree_it_is_not_moved(
    at_rest: bool, scattered: float
) -> None:
    ride, random = Ride(1, still=True), np.random.default_rng(0)
    ride.steps(10)
    for _ in range(100):
        ride.step()
        seen = SE2(np.array([3.0, -2.0, 0.0]) + scattered * random.standard_normal(3))
        assert ride.estimate.fuse(seen, ride.now_s, at_rest=at_rest) is FusionResult.GATED
    np.testing.assert_allclose(ride.estimate.pose.xy_heading, 0.0, atol=1e-12)


def test_what_was_seen_before_the_pose_was_set_is_of_the_past() -> None:
    ride = Ride(2)
    ride.steps(50)
    seen_s = ride.now_s
    assert ride.estimate.fuse(ride.truth, seen_s, at_rest=True) is FusionResult.USED
    ride.estimate.set_pose(SE2(np.array([7.0, 7.0, 0.0])))
    assert (
        ride.estimate.fuse(SE2(np.array([7.0, 7.0, 0.0])), seen_s, at_rest=True) is FusionResult.OLD
    )
    ride.step()
    assert (
        ride.estimate.fuse(SE2(np.array([7.0, 7.0, 0.0])), seen_s, at_rest=True) is FusionResult.OLD
    )
    assert ride.estimate.fuse(ride.estimate.pose, ride.now_s, at_rest=True) is FusionResult.USED
    assert ride.estimate.pose.xy_heading[0] == pytest.approx(7.0, abs=0.1)


def drive_past(ride: Ride, frames: int, shown: Callable[[SE2], SE2]) -> list[FusionResult]:
    """Drive straight at 0.5 m/s under a 25 fps camera that shows wrong poses."""
    fates: list[FusionResult] = []
    for _ in range(frames):
        ride.steps(4)
        seen = ride.seen((ride.now_s, shown(ride.truth)))
        fates.append(ride.estimate.fuse(seen, ride.now_s, at_rest=False))
    return fates


def straight_ride(blind_s: float) -> Ride:
    ride = Ride(0, still=True)
    ride.sizes[0, 0] = 0.5
    ride.steps(round(blind_s / DT_S))
    return ride


def beside(by_m: float) -> Callable[[SE2], SE2]:
    return lambda truth: SE2(truth.xy_heading + np.array([0.0, by_m, 0.0]))


def test_after_a_gap_poses_that_agree_are_believed_in_motion_and_one_that_jumps_is_not() -> None:
    ride = straight_ride(20.0)
    assert drive_past(ride, 1, beside(0.5)) == [FusionResult.GATED]
    fates = drive_past(ride, 24, beside(0.1))
    first = fates.index(FusionResult.USED)
    assert first * 0.04 < 0.8
    assert fates[first:] == [FusionResult.USED] * (24 - first)
    off = ride.estimate.pose.xy_heading - ride.truth.xy_heading
    assert off[1] == pytest.approx(0.1, abs=0.03)


def test_after_a_gap_a_picture_that_stands_still_is_not_believed_in_motion() -> None:
    ride = straight_ride(20.0)
    frozen = ride.truth
    assert set(drive_past(ride, 100, lambda _truth: frozen)) == {FusionResult.GATED}


def test_a_shifted_picture_does_not_win_in_motion_however_uncertain_it_makes_the_estimate() -> None:
    """The covariance covers the shift after some seconds, but the poses still do not win."""
    ride = straight_ride(0.1)
    assert set(drive_past(ride, 20, beside(0.0))) == {FusionResult.USED}
    assert set(drive_past(ride, 230, beside(0.3))) == {FusionResult.GATED}
    covariance = ride.estimate.pose_covariance
    assert covariance[1, 1] * 21.0 > 0.3**2
    # Once the poses are right again, a new majority wins.
    assert drive_past(ride, 30, beside(0.0))[-5:] == [FusionResult.USED] * 5
