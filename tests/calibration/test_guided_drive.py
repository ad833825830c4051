"""Guided drive of a miscalibrated robot by camera: it stays in its area or is stopped.

Runs in virtual time; the simulator provides the true pose.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.guided_stage import ROBOT, ROOM_M, SPEED_MPS, ZEROS_DEG, Stage, View
from tsd_twin.calibration.drive_log import Recording
from tsd_twin.calibration.fit import CalibrationProblem, fit_calibration
from tsd_twin.calibration.guided_drive import POSE_TIMEOUT_S, GuidedDriver, plan_calibration
from tsd_twin.calibration.zeroing import twist_by_zero_offsets
from tsd_twin.errors import TwinError
from tsd_twin.lie import Array
from tsd_twin.messages.status import BiasStatus
from tsd_twin.sensors.pose import CameraNoise


def test_it_drives_its_tour_within_the_area_and_what_is_wrong_is_found() -> None:
    stage = Stage(late_s=1.0)
    stage.run()
    assert stage.guide.progress == 1.0
    # The robot covers the squares and not much more, at any camera latency.
    assert stage.tour.half_m - 0.05 < stage.farthest_m < stage.tour.fence_m
    found = fit_calibration(
        ROBOT.kinematics(), [stage.recording()], CameraNoise(), ROBOT.joint_errors()
    ).found
    # One run observes only the creep twist: three combinations of the six zeros.
    creep = twist_by_zero_offsets(ROBOT)
    off = creep @ (found.offset_rad.ravel() - np.radians(ZEROS_DEG).ravel())
    # As accurate as zeros within 0.02 degrees each; the requirement is 0.05.
    assert (np.abs(off) < np.radians(0.02) * np.linalg.norm(creep, axis=1)).all()
    # Wheel speed was not measured, so the radius includes the common speed factor.
    assert 0.04 * found.wheel_radius == pytest.approx(0.0404, rel=0.005)
    assert 0.15 * found.pivot_radius == pytest.approx(0.149, rel=0.005)


@pytest.mark.parametrize("is_measured", [False, True])
def test_the_fit_starts_from_what_the_robot_has_learned(is_measured: bool) -> None:
    """Zeros start at the learned values; the radius includes the mean learned speed error."""
    told = np.full((2, 3), 260.0)
    spins = told if is_measured else np.full((2, 3), np.nan)
    poses = np.zeros((2, 3))
    run = Recording(np.arange(2.0), np.zeros((2, 6)), told, spins, np.arange(2.0), poses)
    problem = CalibrationProblem(ROBOT.kinematics(), [run])
    shares = np.array([0.02, 0.01, 0.0])
    learned = {f"module{i + 1}_wheel_share": BiasStatus(shares[i], 0.001) for i in range(3)}
    learned |= {"module2_beta_rad": BiasStatus(0.003, 0.001), "creep_x_mps": BiasStatus(1, 1)}
    start = problem.corrections(problem.start(learned))
    assert start.offset_rad == pytest.approx(np.array([[0.0, 0.0], [0.0, 0.003], [0.0, 0.0]]))
    assert start.wheel_radius == pytest.approx(1.01)
    assert start.pivot_radius == 1.0
    assert start.spin == pytest.approx(1.0 + (0.0 if is_measured else 1.0) * (shares - 0.01))
    assert not problem.start({}).any()


def test_a_robot_that_turns_by_itself_against_its_way_still_turns_both_ways() -> None:
    """The robot turns at 12 °/s without a command, while driving slowly."""
    stage = Stage(speed_mps=0.5, zeros_deg=np.array([[0.17, 0.0]] * 3))
    turns = replace(stage.tour, legs=stage.tour.legs[1::2])
    stage.guide = GuidedDriver(ROBOT, turns)
    stage.run()
    assert stage.farthest_m < stage.tour.fence_m


def lost(_pose: Array, now_s: float) -> Array | None:
    return _pose if now_s < 4.0 else None


def leaping(pose: Array, now_s: float) -> Array | None:
    return pose if now_s < 4.0 else pose + np.array([0.8, 0.0, 0.0])


def mirrored(pose: Array, _now_s: float) -> Array | None:
    return pose * np.array([1.0, -1.0, -1.0])


def turned(pose: Array, _now_s: float) -> Array | None:
    return pose + np.array([0.0, 0.0, np.pi / 2])


def frozen() -> View:
    """Like a tracker that repeats its last picture with current timestamps."""
    last = np.zeros(3)

    def view(pose: Array, now_s: float) -> Array:
        last[:] = pose if now_s < 4.0 else last
        return last.copy()

    return view


@pytest.mark.parametrize(
    ("view", "says"),
    [
        (lost, f"no pose measurement for {POSE_TIMEOUT_S:g} s"),
        (leaping, "camera and wheels disagree"),
        (mirrored, "camera and wheels disagree|off its path"),
        (turned, "camera and wheels disagree|off its path"),
        (frozen(), "camera and wheels disagree"),
    ],
    ids=["lost", "leaping", "mirrored", "turned", "frozen"],
)
def test_a_camera_that_is_wrong_ends_the_drive_and_it_rests_within_its_room(
    view: View, says: str
) -> None:
    stage = Stage(view=view)
    with pytest.raises(TwinError, match=says):
        stage.run()
    # The request cannot reach it, because the link is cut.
    stage.stop()
    assert stage.farthest_m < ROOM_M


def test_nothing_is_commanded_before_the_robot_was_seen() -> None:
    guide = GuidedDriver(ROBOT, plan_calibration(ROBOT, ROOM_M, SPEED_MPS))
    with pytest.raises(TwinError, match="no pose measurement for"):
        guide.advance(1.0)


@settings(max_examples=8)
@given(st.floats(0.0, 3.0), st.floats(0.0, 1.5))
def test_the_tour_fits_into_its_room_or_is_refused(room_m: float, speed_mps: float) -> None:
    needed_m = 0.15 + 0.1 + 0.42 * speed_mps + speed_mps**2 / 12.0
    if room_m < needed_m or not 0.1 <= speed_mps <= 1.0:
        with pytest.raises(TwinError, match=r"--room must be|--speed must be"):
            plan_calibration(ROBOT, room_m, speed_mps)
        return
    ways = plan_calibration(ROBOT, room_m, speed_mps)
    limits = ROBOT.limits
    # The lease doubles the usual command age: 0.42 s plus braking; see docs/safety.md.
    braking_m = 0.42 * speed_mps + speed_mps**2 / (2 * limits.deceleration_mps2)
    assert ways.fence_m + braking_m <= room_m + 1e-9
    for leg in ways.legs:
        at_s = np.linspace(0.0, leg.duration_s, 50)
        poses = np.array([leg.at(t_s).pose for t_s in at_s])
        assert np.abs(poses[:, :2]).max() <= ways.half_m + 1e-9
        speeds = np.array([leg.at(t_s).twist for t_s in at_s])
        # The remaining 20 % is reserved for feedback correction.
        assert np.hypot(*speeds[:, :2].T).max() <= 0.8 * speed_mps
        assert np.abs(speeds[:, 2]).max() <= 0.8 * limits.turn_rate_rad_per_s * speed_mps
    np.testing.assert_allclose(
        [leg.at(leg.duration_s).pose[2] for leg in ways.legs], [0, 2 * np.pi, 0, -2 * np.pi]
    )
