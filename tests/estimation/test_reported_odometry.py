"""A pose reported by another program is the estimate, relative to the pose set."""

from __future__ import annotations

import numpy as np
import pytest

from tsd_twin import robots
from tsd_twin.adapters.ros.external_robot import ExternalLimits, describe
from tsd_twin.control.state_estimator import StateEstimator
from tsd_twin.lie import SE2
from tsd_twin.robots import ExternalDescription

ROBOT = robots.parse_description(describe("cart", "", ExternalLimits(sideways=True)), "cart")
DT_S = 0.01


def test_the_pose_is_what_is_reported_and_jumps_with_it() -> None:
    assert isinstance(ROBOT, ExternalDescription)
    estimator, random = StateEstimator(ROBOT), np.random.default_rng(1)
    for i in range(50):
        twist, pose = random.normal(size=3), random.normal(size=3)
        estimator.advance(i * DT_S, np.concatenate([twist, pose]), np.zeros(3), DT_S)
        assert estimator.odometry(0).xy_heading == pytest.approx(pose)
        assert estimator.joints == pytest.approx(twist)
        assert estimator.alternative_odometry(0) is None, "there is one odometry only"
        verdict = estimator.consistency(wheels_spin=True)
        assert (verdict.residual_mps, verdict.suspect) == (0.0, None)


def test_a_pose_that_is_set_moves_all_later_ones_and_a_gap_keeps_it() -> None:
    estimator = StateEstimator(ROBOT)
    first, later = np.array([3.0, 1.0, 0.5]), np.array([3.4, 1.3, 0.7])
    estimator.advance(0.0, np.concatenate([np.zeros(3), first]), np.zeros(3), DT_S)
    estimator.set_pose(SE2(np.array([-1.0, 0.0, 2.0])))
    moved = SE2(first).inverse() @ SE2(later)
    estimator.advance(DT_S, np.concatenate([np.ones(3), later]), np.zeros(3), DT_S)
    expected = (SE2(np.array([-1.0, 0.0, 2.0])) @ moved).xy_heading
    assert estimator.pose.xy_heading == pytest.approx(expected)
    for i in range(5):
        estimator.advance((i + 2) * DT_S, None, np.zeros(3), DT_S)
    assert estimator.pose.xy_heading == pytest.approx(expected)
