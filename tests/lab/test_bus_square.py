"""The square of the thesis by guided drive; its errors use the true path."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.guided_stage import ROBOT, Stage
from tsd_twin.calibration.bus_drive import BusDrive
from tsd_twin.calibration.guided_drive import THESIS_LEG, plan_thesis_square
from tsd_twin.errors import TwinError
from tsd_twin.lab.bus_square import camera_errors, tracking_record
from tsd_twin.lab.tracking import tracking_errors
from tsd_twin.lie import SE2, Array


def driven() -> tuple[Stage, BusDrive]:
    """Drive the square in virtual time, with zeros off by up to 0.5°."""
    stage = Stage(plan=plan_thesis_square)
    stage.run()
    return stage, BusDrive("tsd", "", ROBOT, stage.recording(), stage.guide, {})


def test_errors_by_the_camera_are_those_of_the_true_path() -> None:
    stage, found = driven()
    assert stage.farthest_m < stage.tour.fence_m
    record, frames = tracking_record(found)
    errors = camera_errors(record, frames)
    # The camera has 5 mm noise on each axis, also at the start, the reference of all poses.
    at_s, poses = (np.array(column) for column in zip(*stage.truths, strict=True))
    steps = [step for step in stage.guide.steps if step.leg == THESIS_LEG]
    assert stage.guide.start is not None
    local = (stage.guide.start.inverse() @ SE2(poses)).xy_heading[:, :2]
    times = [step.now_s for step in steps]
    true: Array = np.column_stack([np.interp(times, at_s, axis) for axis in local.T])
    truly = tracking_errors(true, record.reference[:, :2], record.path_xy)
    # Only feedback corrects the creep of these zeros.
    assert 0.01 < truly.rms_m < 0.05
    assert errors.size_m == pytest.approx(2 * stage.tour.half_m)
    assert errors.rms_m**2 == pytest.approx(truly.rms_m**2 + 2 * 0.005**2, abs=5e-5)
    assert errors.cross_track_m == pytest.approx(truly.cross_track_m, abs=0.02)
    # The robot completes the square, and its last corner is the first.
    assert record.reference[[0, -1], :2] == pytest.approx(np.full((2, 2), -stage.tour.half_m))
    assert np.ptp(true, axis=0) == pytest.approx(2 * stage.tour.half_m, abs=0.03)


def test_gap_in_the_frames_of_the_square_is_an_error() -> None:
    _, found = driven()
    steps = [step for step in found.driver.steps if step.leg == THESIS_LEG]
    middle_s = steps[len(steps) // 2].now_s
    found.driver.poses[:] = [each for each in found.driver.poses if abs(each[0] - middle_s) > 0.2]
    with pytest.raises(TwinError, match=r"did not see the robot for 0\.4"):
        tracking_record(found)
