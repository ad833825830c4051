"""The pose filter against batch least squares and Monte Carlo runs."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tsd_twin import robots
from tsd_twin.estimation import PoseFilter, with_gyro
from tsd_twin.estimation.pose_filter import GATE
from tsd_twin.lie import SE2, Array
from tsd_twin.motion.paths import spline
from tsd_twin.motion.routes import Route, TangentHeading
from tsd_twin.motion.trajectory import plan

ROBOT = robots.load_robot("tsd")
DRIVE = ROBOT.kinematics()
DT_S = 0.01
GROWTH = np.diag([1e-4, 2e-4, 3e-4])


def origin(batch: tuple[int, ...] = ()) -> PoseFilter:
    return PoseFilter(DRIVE, SE2.identity(batch))


def steps(filtered: PoseFilter, twist: Array, count: int) -> None:
    for _ in range(count):
        filtered.advance(filtered.now_s + DT_S, twist, GROWTH)


def fuse_position(
    filtered: PoseFilter, xy: Array, sigma: float, measured_s: float | None = None
) -> bool:
    rows, none = np.eye(3)[:2], np.zeros((2, 0))
    return filtered.fuse_linear(rows, xy, sigma**2 * np.eye(2), none, measured_s)


def fuse_heading(filtered: PoseFilter, heading: Array, sigma: float) -> bool:
    rows, none = np.eye(3)[2:], np.zeros((1, 0))
    return filtered.fuse_linear(rows, heading[..., None], np.array([[sigma**2]]), none)


def test_without_measurements_it_is_dead_reckoning_with_growing_doubt() -> None:
    filtered, twist = origin(), np.array([0.5, -0.2, 1.0])
    steps(filtered, twist, 100)
    np.testing.assert_allclose(
        filtered.pose.xy_heading, SE2.exp(twist).xy_heading, rtol=1e-12, atol=1e-12
    )
    assert np.linalg.eigvalsh(filtered.covariance).min() > 0.0
    assert filtered.covariance[2, 2] == pytest.approx(3e-4)


@given(
    speeds=st.lists(st.floats(-1.0, 1.0), min_size=12, max_size=12),
    seen=st.lists(st.booleans(), min_size=12, max_size=12),
    seed=st.integers(0, 99),
)
@settings(max_examples=30)
def test_straight_on_it_is_the_least_squares_over_all_that_was_measured(
    speeds: list[float], seen: list[bool], seed: int
) -> None:
    """Along a line the problem is linear: one system of all positions and measurements."""
    random, sigma = np.random.default_rng(seed), 0.02
    filtered = PoseFilter(DRIVE, SE2.identity(), memory_s=2.0)
    ends_s = [0.1 * (i + 1) for i in range(12)]
    moves = np.array(speeds) * 0.1
    rows, values = [], []
    for i, move in enumerate(moves):
        filtered.advance(ends_s[i], np.array([speeds[i], 0.0, 0.0]), GROWTH)
        row = np.zeros(12)
        row[i] = 1.0
        row[i - 1] -= 1.0 if i else 0.0
        rows.append(row / np.sqrt(1e-4 * 0.1))
        values.append(move / np.sqrt(1e-4 * 0.1))
    for i in np.flatnonzero(seen):
        z = moves[: i + 1].sum() + sigma * random.standard_normal()
        # All measurements arrive at the end.
        assert fuse_position(filtered, np.array([z, 0.0]), sigma, ends_s[i])
        rows.append(np.eye(12)[i] / sigma)
        values.append(z / sigma)
    best = np.linalg.lstsq(np.array(rows), np.array(values), rcond=None)[0]
    assert filtered.pose.xy_heading[0] == pytest.approx(best[-1], abs=1e-7)
    variance = np.linalg.inv(np.array(rows).T @ np.array(rows))[-1, -1]
    assert filtered.covariance[0, 0] == pytest.approx(variance, rel=1e-5)


@given(late=st.floats(0.0, 0.9), order=st.permutations(range(4)), seed=st.integers(0, 99))
@settings(max_examples=30)
def test_what_comes_late_counts_as_if_it_had_come_in_time(
    late: float, order: list[int], seed: int
) -> None:
    random = np.random.default_rng(seed)
    twists = random.normal(size=(100, 3))
    poses = [SE2(0.1 * random.normal(size=3)) for _ in range(4)]
    times = np.sort(1.0 - late * random.random(4))
    covariance = np.diag([1e-4, 1e-4, 1e-3])
    in_time, afterwards = origin(), origin()
    due = list(zip(times, poses, strict=True))
    for i, twist in enumerate(twists):
        end_s = DT_S * (i + 1)
        while due and due[0][0] <= end_s:
            at_s, pose = due.pop(0)
            in_time.advance(at_s, twist, GROWTH)
            assert in_time.fuse_pose(pose, covariance)
        in_time.advance(end_s, twist, GROWTH)
        afterwards.advance(end_s, twist, GROWTH)
    for k in order:
        assert afterwards.fuse_pose(poses[k], covariance, float(times[k]))
    np.testing.assert_allclose(
        afterwards.pose.xy_heading, in_time.pose.xy_heading, rtol=1e-9, atol=1e-9
    )
    np.testing.assert_allclose(afterwards.covariance, in_time.covariance, rtol=1e-9, atol=1e-12)


def test_what_is_too_old_or_no_number_is_refused_and_changes_nothing() -> None:
    filtered = origin()
    steps(filtered, np.array([0.5, 0.0, 0.0]), 300)
    before = filtered.pose.xy_heading.copy()
    assert not fuse_position(filtered, np.zeros(2), 0.01, filtered.now_s - 1.5)
    assert not fuse_heading(filtered, np.array(np.nan), 0.01)
    assert not fuse_position(filtered, np.zeros(2), 0.01, np.nan)
    np.testing.assert_array_equal(filtered.pose.xy_heading, before)
    assert fuse_position(filtered, np.zeros(2), 0.01, filtered.now_s - 0.99)
    assert filtered.pose.xy_heading[0] < before[0]


def test_it_forgets_what_is_older_than_its_memory() -> None:
    filtered = origin()
    steps(filtered, np.array([0.5, 0.0, 0.1]), 1000)
    assert filtered.now_s - filtered.oldest_s < 102.5 * DT_S


def test_time_that_stands_still_or_runs_back_moves_nothing() -> None:
    filtered = origin()
    filtered.advance(0.0, np.ones(3), GROWTH)
    filtered.advance(-1.0, np.ones(3), GROWTH)
    np.testing.assert_array_equal(filtered.pose.xy_heading, 0.0)


def test_headings_are_compared_around_the_circle() -> None:
    filtered = PoseFilter(DRIVE, SE2(np.array([0.0, 0.0, 7.0])), np.eye(3))
    assert fuse_heading(filtered, np.array(7.1 - 2.0 * np.pi), 0.01)
    assert filtered.pose.xy_heading[2] == pytest.approx(7.1, abs=1e-4)


def test_a_batch_is_each_of_its_members() -> None:
    random = np.random.default_rng(0)
    together, alone = origin((3,)), [origin() for _ in range(3)]
    for i in range(30):
        twists, seen = random.normal(size=(3, 3)), random.normal(size=(3, 2))
        for filtered, k in [(together, slice(None)), *zip(alone, range(3), strict=True)]:
            filtered.advance(DT_S * (i + 1), twists[k], GROWTH)
            if i % 7 == 3:
                assert fuse_position(filtered, seen[k], 0.05, DT_S * i - 0.013)
    for k, filtered in enumerate(alone):
        np.testing.assert_allclose(together.pose.xy_heading[k], filtered.pose.xy_heading)
        np.testing.assert_allclose(together.covariance[k], filtered.covariance)


def test_a_gyro_turns_what_the_wheels_say_and_takes_along_what_hangs_together() -> None:
    """Against least squares over four measurements: three by the wheels, one by the gyro."""
    random = np.random.default_rng(0)
    root = random.normal(size=(3, 3))
    covariance, twist, rate, sigma = root @ root.T, random.normal(size=3), 0.7, 0.3
    rows = np.concatenate([np.linalg.inv(root), [[0.0, 0.0, 1.0 / sigma]]])
    values = np.concatenate([np.linalg.solve(root, twist), [rate / sigma]])
    best = np.linalg.lstsq(rows, values, rcond=None)[0]
    found, spread = with_gyro(twist, covariance, np.array(rate), sigma)
    np.testing.assert_allclose(found, best, atol=1e-9)
    np.testing.assert_allclose(spread, np.linalg.inv(rows.T @ rows), atol=1e-9)


def test_with_the_noise_of_wpilib_the_end_is_within_half_a_percent_of_the_path() -> None:
    """Over 200 seeds of a figure of eight at 100 Hz, below 0.5 % of the path in 95 % of runs.

    The noise is white, as in WPILib's test of swerve odometry: 0.1 m/s along and 0.005 rad across
    each wheel's motion, and 0.05 rad in the gyro heading. WPILib requires 0.1 m.
    """
    runs, dt_s, random = 200, 0.01, np.random.default_rng(1)
    corners = [[0, 0], [1.5, 1], [3, 0], [1.5, -1], [0, 0], [-1.5, 1], [-3, 0], [-1.5, -1], [0, 0]]
    trajectory = plan(Route(spline(corners), TangentHeading()), DRIVE, ROBOT.limits, cell_m=0.02)
    assert trajectory.length_m == pytest.approx(15.2, abs=0.1)
    filtered = PoseFilter(DRIVE, SE2(np.tile(trajectory.at(0.0).pose, (runs, 1))))
    rim_mps = DRIVE.wheel_radius_m * DRIVE.spin_rad_per_s
    for i in range(int(trajectory.duration_s / dt_s) + 1):
        now_s = (i + 1) * dt_s
        rolling = DRIVE.contact_from_twist @ trajectory.at(now_s - 0.5 * dt_s).twist
        speed, angle = np.hypot(*rolling.T), np.arctan2(rolling[:, 1], rolling[:, 0])
        # Twist noise from 0.1 m/s along and 0.005 rad across, to first order.
        along = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        across = np.stack([-np.sin(angle), np.cos(angle)], axis=-1) * speed[:, None]
        to_twist = DRIVE.twist_from_contacts.reshape(3, 3, 2)
        spread = np.concatenate(
            [
                0.1 * np.einsum("iwj,wj->wi", to_twist, along),
                0.005 * np.einsum("iwj,wj->wi", to_twist, across),
            ]
        )
        speed = speed + 0.1 * random.standard_normal((runs, 3))
        angle = angle + 0.005 * random.standard_normal((runs, 3))
        lx, ly = -speed * np.sin(angle) / rim_mps, speed * np.cos(angle) / rim_mps
        joints = np.stack(
            [np.arcsin(ly), np.arcsin(lx / np.sqrt(1 - ly**2)), 0.0 * lx + DRIVE.spin_rad_per_s],
            axis=-1,
        )
        twist = DRIVE.forward(joints.reshape(runs, 9)).twist
        filtered.advance(now_s, twist, np.broadcast_to(spread.T @ spread * dt_s, (runs, 3, 3)))
        seen = trajectory.at(now_s).pose[2] + 0.05 * random.standard_normal(runs)
        assert fuse_heading(filtered, seen, 0.05)
    end = trajectory.at(trajectory.duration_s).pose
    off = filtered.pose.xy_heading - end
    errors = np.hypot(off[:, 0], off[:, 1])
    assert np.quantile(errors, 0.95) <= 0.005 * trajectory.length_m
    assert errors.max() < 0.125
    # Consistency: the normalized squared distance is two on average.
    claimed = filtered.covariance[:, :2, :2]
    normalised = np.einsum("ni,nij,nj->n", off[:, :2], np.linalg.inv(claimed), off[:, :2])
    assert 1.4 < normalised.mean() < 2.8


def driven_by(filtered: PoseFilter, twist: Array, by: Array, seconds: float) -> None:
    for _ in range(round(seconds / DT_S)):
        filtered.advance(filtered.now_s + DT_S, twist, 1e-12 * np.eye(3), by)


@pytest.mark.parametrize("sigma", [0.001, 0.005, 0.01])
@pytest.mark.parametrize("speed", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("share", [0.0, 0.04, 0.1])
def test_a_frozen_picture_is_accepted_only_while_noise_explains_it(
    share: float, speed: float, sigma: float
) -> None:
    """After a way d > sqrt(21.1 (2 s^2 + (e^2 + 0.1^2) d^2)) for noise s and a speed error e.

    In all these cases the robot moves by d within a second, which the filter remembers. The large
    error of the camera mounting does not matter.
    """
    twist, covariance = np.array([speed, 0.0, 0.0]), np.diag([sigma**2, sigma**2, 4e-4])
    mounting = np.array([[0.0, 0.1], [0.0, 0.1], [0.0, 0.0]])
    by = np.array([[share * speed, 0.0], [0.0, 0.0], [0.0, 0.0]])
    filtered = PoseFilter(DRIVE, SE2.identity(), bias_jacobian=np.zeros((3, 2)))

    def is_accepted(x_m: float) -> bool:
        pose = SE2(np.array([x_m, 0.0, 0.0]))
        now_s = filtered.now_s
        if filtered.mahalanobis_sq(pose, covariance, now_s, mounting) > GATE:
            return False
        return filtered.fuse_pose(pose, covariance, now_s, mounting)

    for i in range(25):
        driven_by(filtered, twist, by, 0.04)
        assert is_accepted(0.04 * speed * (i + 1))
    explained_m = sigma * np.sqrt(2.0 / (1.0 / GATE - share**2 - 0.01))
    accepted = []
    for _ in range(100):
        driven_by(filtered, twist, by, 0.04)
        accepted.append(is_accepted(speed))
    assert sum(accepted) * 0.04 * speed <= explained_m


@pytest.mark.parametrize("share", [0.01, 0.1])
@pytest.mark.parametrize("twist", [(0.0, 0.0, 0.0), (0.7, -0.5, 1.5)])
def test_one_of_10_000_correct_poses_is_rejected(
    twist: tuple[float, float, float], share: float
) -> None:
    """Six rejections are expected in 60,000 poses; 17 occur once in 5,000 such tests."""
    random, runs = np.random.default_rng(7), 2000
    sigma, mean = np.array([0.005, 0.005, 0.02]), np.array(twist)
    by = np.concatenate([np.diag(share * mean), np.zeros((3, 3))], axis=1)
    mounting = np.concatenate([np.zeros((3, 3)), np.diag([0.01, 0.01, 0.01])], axis=1)
    biases = random.standard_normal((runs, 6))
    truth = SE2.identity((runs,))
    filtered = PoseFilter(DRIVE, truth, bias_jacobian=np.zeros((runs, 3, 6)))
    rejected = 0
    for i in range(120):
        noise = np.sqrt(np.diag(GROWTH) / DT_S) * random.standard_normal((runs, 3))
        truth = DRIVE.integrate(truth, mean + biases @ by.T + noise, DT_S)
        filtered.advance((i + 1) * DT_S, np.tile(mean, (runs, 1)), GROWTH, by)
        if i % 4 == 3:
            off = biases @ mounting.T + sigma * random.standard_normal((runs, 3))
            seen = SE2(truth.xy_heading + off)
            covariance = np.diag(np.square(sigma))
            distances = filtered.mahalanobis_sq(seen, covariance, filtered.now_s, mounting)
            rejected += int(np.count_nonzero(distances > GATE))
            filtered.fuse_pose(seen, covariance, filtered.now_s, mounting)
    assert rejected < 17
