"""The square of the thesis on a robot on the bus, driven and seen by a camera."""

from __future__ import annotations

import argparse

import numpy as np

from tsd_twin.calibration.bus_drive import BusDrive, drive_on_bus
from tsd_twin.calibration.guided_drive import THESIS_LEG, GuidedStep, plan_thesis_square
from tsd_twin.cli import experiment
from tsd_twin.cli.experiment import Output
from tsd_twin.errors import TwinError
from tsd_twin.lab import tracking
from tsd_twin.lab.tracking import TrackingErrors, TrackingRecord, tracking_errors
from tsd_twin.lie import SE2
from tsd_twin.motion.trajectory import Trajectory
from tsd_twin.sensors.pose import Frame

_MAX_GAP_S = 0.25
"""Longest gap between two frames on the square; the errors in a longer one are unknown."""
_WHAT = "to a corner, then a square of {:.2f} m once around, and back"


def drive_square(args: argparse.Namespace, out: Output) -> list[str]:
    """Drive the square, write figure and tables, and return the lines to print.

    Raises:
        TwinError: As in `drive_on_bus`, or if the camera did not see the whole square.
    """
    driven = drive_on_bus(
        args, out, lambda robot: plan_thesis_square(robot, args.room, args.speed), _WHAT
    )
    record, frames = tracking_record(driven)
    errors = camera_errors(record, frames)
    x_m, y_m = tracking.camera_xy(record, frames).T
    out.table("square", record.columns())
    out.table(
        "square_camera",
        {"t_s": [frame.taken_s for frame in frames], "x_m": x_m, "y_m": y_m},
    )
    side = f"square of {errors.size_m:.2f} m"
    figure = experiment.new_figure(10.5, 4.6, f"{driven.robot_id}: {side} by a camera")
    left, right = figure.subplots(1, 2)
    tracking.draw_positions(left, record, frames, "position", robot="estimate")
    tracking.draw_speeds(right, record, frames, "speed", robot="wheels")
    out.figure("square", figure)
    top_mps = float(np.hypot(*record.reference_twist[:, :2].T).max())
    return [
        f"{driven.robot_id}: {side} in {record.t_s[-1]:.2f} s, at up to {top_mps:.2f} m/s, "
        f"{len(frames)} frames of the camera",
        errors.sentence(),
        f"largest error of position {100.0 * errors.worst_m / errors.size_m:.1f} % of the side, "
        "by the camera",
    ]


def camera_errors(record: TrackingRecord, frames: list[Frame]) -> TrackingErrors:
    """Return the errors of the positions in the frames, against the references at their times."""
    taken_s = np.array([frame.taken_s for frame in frames])
    x, y = (np.interp(taken_s, record.t_s, record.reference[:, i]) for i in (0, 1))
    seen_xy = tracking.camera_xy(record, frames)
    return tracking_errors(seen_xy, np.column_stack([x, y]), record.path_xy)


def tracking_record(driven: BusDrive) -> tuple[TrackingRecord, list[Frame]]:
    """Return the record of the square in the axes of its path, and its frames.

    Its truth is the estimate of the guided drive; frames are relative to the first reference.

    Raises:
        TwinError: If there are too few frames, or a gap between them.
    """
    driver = driven.driver
    steps = [step for step in driver.steps if step.leg == THESIS_LEG]
    if driver.start is None or len(steps) < 2:
        raise TwinError("the square was not driven")
    first_s, last_s = steps[0].now_s, steps[-1].now_s
    to_mark = (driver.start @ SE2(steps[0].reference.pose)).inverse()
    frames = [
        Frame(seen_s - first_s, (to_mark @ pose).xy_heading)
        for seen_s, pose in sorted(driver.poses, key=lambda each: each[0])
        if first_s <= seen_s <= last_s
    ]
    taken_s = np.array([0.0, *(frame.taken_s for frame in frames), last_s - first_s])
    if not np.diff(taken_s).max() <= _MAX_GAP_S:
        raise TwinError(
            f"the camera did not see the robot for {np.diff(taken_s).max():.2f} s on the square, "
            f"at most {_MAX_GAP_S:g} s: its errors are not known"
        )
    return _record(steps, driver.route.legs[THESIS_LEG]), frames


def _record(steps: list[GuidedStep], trajectory: Trajectory) -> TrackingRecord:
    """Return the record of the steps."""
    pose = np.array([step.pose.xy_heading for step in steps])
    return TrackingRecord(
        np.array([step.now_s - steps[0].now_s for step in steps]),
        np.array([step.reference.pose for step in steps]),
        pose,
        pose,
        np.array([step.reference.twist for step in steps]),
        np.array([step.twist for step in steps]),
        tracking.path_points(trajectory),
    )
