"""Path tracking: exact without disturbances, and back on the path after one."""

from __future__ import annotations

import numpy as np
import pytest

from tests.motion.random_paths import SQUARE, by_hand
from tsd_twin import robots
from tsd_twin.lie import SE2, Array
from tsd_twin.motion.paths import line, polyline
from tsd_twin.motion.routes import FixedHeading, Route, SampledHeading, TangentHeading
from tsd_twin.motion.tracking import Gains, Pid, TrackingController, tracking_errors
from tsd_twin.motion.trajectory import Trajectory, plan

ROBOT = robots.load_robot("tsd")
DRIVE, LIMITS = ROBOT.kinematics(), ROBOT.limits
LAG_S, DT_S = 0.03, 0.002


def trajectory_of(name: str, turning: bool = False) -> Trajectory:
    path = by_hand()[name]
    heading = SampledHeading([0.0, path.length_m], [0.5, 2.5]) if turning else FixedHeading(0.5)
    return plan(Route(path, heading), DRIVE, LIMITS)


class Laggard:
    """A robot whose body twist follows the command with an exact first-order lag."""

    def __init__(self, pose: Array, lag_s: float) -> None:
        self.pose, self.twist, self.lag_s = SE2(np.array(pose)), np.zeros(3), lag_s

    def drive(self, wanted: Array, drift: Array | float = 0.0) -> None:
        keep = np.exp(-DT_S / self.lag_s) if self.lag_s > 0.0 else 0.0
        following = wanted + (self.twist - wanted) * keep
        mean = following if self.lag_s == 0.0 else 0.5 * (self.twist + following)
        self.pose = self.pose @ SE2.exp((mean + drift) * DT_S)
        self.twist = following


def worst(poses: list[Array], trajectory: Trajectory) -> tuple[float, float]:
    """Maximum position and heading error along the path."""
    off = np.array(poses) - trajectory.at(DT_S * np.arange(1, len(poses) + 1)).pose
    return float(np.hypot(off[:, 0], off[:, 1]).max()), float(np.abs(off[:, 2]).max())


def run(
    trajectory: Trajectory,
    tracker: TrackingController,
    robot: Laggard,
    *,
    closed: bool,
    drift: Array | float = 0.0,
) -> list[Array]:
    poses: list[Array] = []
    for i in range(round((trajectory.duration_s + 0.2) / DT_S)):
        # Each command is held for a period, so use the middle of it.
        t_s = (i + 0.5) * DT_S
        told = tracker.advance(t_s, robot.pose, DT_S) if closed else tracker.feed_forward(t_s)
        robot.drive(told, drift)
        poses.append(robot.pose.xy_heading)
    return poses


@pytest.mark.parametrize("name", ["line", "rounded", "square", "spline"])
def test_open_loop_without_lag_arrives_everywhere_in_time(name: str) -> None:
    trajectory = trajectory_of(name)
    robot = Laggard(trajectory.at(0.0).pose, 0.0)
    tracker = TrackingController(trajectory, lag_s=0.0)
    away, turned = worst(run(trajectory, tracker, robot, closed=False), trajectory)
    assert away < 1e-4 * trajectory.length_m
    assert turned < 1e-4


@pytest.mark.parametrize("turning", [False, True])
@pytest.mark.parametrize("name", ["line", "rounded", "square"])
def test_feeding_acceleration_forward_undoes_the_lag_of_the_actuators(
    name: str, turning: bool
) -> None:
    trajectory = trajectory_of(name, turning)
    results = {}
    for lag_s in (0.0, LAG_S):
        robot = Laggard(trajectory.at(0.0).pose, LAG_S)
        tracker = TrackingController(trajectory, lag_s=lag_s)
        results[lag_s], _ = worst(run(trajectory, tracker, robot, closed=False), trajectory)
    assert results[0.0] > 0.9 * LAG_S * LIMITS.speed_mps * 0.9, "late by its lag"
    # Where acceleration jumps by a, an error of a lag^2 remains: 10 m/s^2 at a corner.
    assert results[LAG_S] < 0.75 * 10.0 * LAG_S**2


def test_closed_loop_comes_back_from_beside_the_path_and_from_another_heading() -> None:
    trajectory = trajectory_of("spline")
    start = trajectory.at(0.0).pose + np.array([0.05, -0.08, 0.2])
    robot = Laggard(start, LAG_S)
    poses = run(trajectory, TrackingController(trajectory), robot, closed=True)
    late = poses[1000:]
    off = np.array(late) - trajectory.at(DT_S * np.arange(1001, len(poses) + 1)).pose
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.01
    assert np.abs(off[:, 2]).max() < 0.02


def test_what_drifts_steadily_is_held_by_the_integral() -> None:
    """The robot drifts and turns steadily, as with a wheel that spins too slowly."""
    trajectory = plan(Route(line([0, 0], [4, 0])), DRIVE, LIMITS, speed_mps=0.8)
    drift = np.array([-0.02, 0.03, 0.1])
    ends = {}
    for closed in (False, True):
        robot = Laggard(np.zeros(3), LAG_S)
        run(trajectory, TrackingController(trajectory), robot, closed=closed, drift=drift)
        ends[closed] = robot.pose.xy_heading - trajectory.at(99.0).pose
    assert np.hypot(*ends[False][:2]) > 0.3
    assert np.hypot(*ends[True][:2]) < 0.006
    assert abs(ends[True][2]) < 0.01


def test_errors_are_along_and_across_the_path() -> None:
    trajectory = plan(Route(line([0, 0], [0, 1])), DRIVE, LIMITS)
    reference = trajectory.at(0.5 * trajectory.duration_s)
    here = np.array([0.1, float(reference.pose[1]) - 0.2, 2 * np.pi - 0.3])
    # The path goes up and is 0.2 ahead and 0.1 to the left.
    np.testing.assert_allclose(tracking_errors(reference, SE2(here)), [0.2, 0.1, 0.3], atol=1e-12)


@pytest.mark.parametrize("heading", [FixedHeading(0.7), TangentHeading()])
def test_a_batch_is_each_of_its_members(heading: FixedHeading | TangentHeading) -> None:
    trajectory = plan(Route(polyline(SQUARE, 0.2), heading), DRIVE, LIMITS)
    random = np.random.default_rng(0)
    poses = trajectory.at(0.4).pose + 0.1 * random.standard_normal((5, 4, 3))
    together, alone = (
        TrackingController(trajectory),
        [TrackingController(trajectory) for _ in range(4)],
    )
    for i, batch in enumerate(poses):
        told = together.advance(0.4 + 0.01 * i, SE2(batch), 0.01)
        for k, tracker in enumerate(alone):
            one = tracker.advance(0.4 + 0.01 * i, SE2(batch[k]), 0.01)
            np.testing.assert_allclose(told[k], one, atol=1e-12)


def test_pid_by_hand() -> None:
    pid = Pid(Gains(2.0, 1.0, 0.5, integral_limit=0.15))
    assert pid.advance(np.array([1.0]), 0.1) == pytest.approx([2.0 + 0.1])
    assert pid.advance(np.array([2.0]), 0.1) == pytest.approx([4.0 + 0.15 + 5.0])
    assert pid.advance(np.array([2.0]), 0.0) == pytest.approx([4.0 + 0.15])
    # The integral does not wind up, because it leaves its limit at once.
    assert pid.advance(np.array([-1.0]), 0.1) == pytest.approx([-2.0 + 0.05 - 15.0])
    pid.reset()
    assert pid.advance(np.array([1.0]), 0.1) == pytest.approx([2.1])
