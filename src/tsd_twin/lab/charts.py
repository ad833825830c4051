"""Pictures of a robot that followed a path: where it was, how fast, and how far off."""

from __future__ import annotations

import numpy as np

from tsd_twin.lab import look
from tsd_twin.lab.drive_path import Record
from tsd_twin.lab.look import Axes
from tsd_twin.lie import SE2, Array
from tsd_twin.sim import Frame


def draw_positions(axes: Axes, record: Record, frames: list[Frame], title: str) -> None:
    """Draw the path and where the robot went, from above; what the camera saw as dots."""
    axes.plot(*record.path_xy.T, color=look.REFERENCE, linewidth=1.2, linestyle="--", label="path")
    axes.plot(*record.truth[:, :2].T, color=look.TRUTH, linewidth=1.8, label="robot")
    if frames:
        seen = camera_xy(record, frames)
        axes.plot(*seen.T, ".", color=look.CAMERA, markersize=4, label="camera")
    axes.plot(*record.truth[0, :2], "o", color=look.TRUTH, markersize=6)
    axes.plot(*record.truth[-1, :2], "s", color=look.TRUTH, markersize=6)
    axes.set_aspect("equal", adjustable="datalim")
    look.dress(axes, "x (m)", "y (m)", title)
    look.legend(axes, loc="best")


def draw_speeds(axes: Axes, record: Record, frames: list[Frame], title: str) -> None:
    """Draw the speed over the floor against time; of the camera from frame to frame."""
    for twists, colour, style, name in (
        (record.reference_twist, look.REFERENCE, "--", "reference"),
        (record.true_twist, look.TRUTH, "-", "robot"),
    ):
        speed = np.hypot(twists[:, 0], twists[:, 1])
        axes.plot(record.t_s, speed, style, color=colour, linewidth=1.3, label=name)
    if len(frames) > 1:
        taken = np.array([frame.taken_s for frame in frames])
        steps = np.hypot(*np.diff(camera_xy(record, frames), axis=0).T)
        middle = 0.5 * (taken[1:] + taken[:-1])
        axes.plot(
            middle, steps / np.diff(taken), ".", color=look.CAMERA, markersize=4, label="camera"
        )
    look.dress(axes, "time (s)", "speed (m/s)", title)
    look.legend(axes, loc="best")


def draw_errors(axes: Axes, record: Record, title: str) -> None:
    """Draw the distance to where the robot should be, and what it knows of it itself."""
    for poses, colour, style, name in (
        (record.truth, look.TRUTH, "-", "robot"),
        (record.estimate, look.ESTIMATE, "--", "as it estimates"),
    ):
        off = np.hypot(*(poses - record.reference)[:, :2].T)
        axes.plot(record.t_s, 1000 * off, style, color=colour, linewidth=1.3, label=name)
    look.dress(axes, "time (s)", "error (mm)", title)
    axes.set_ylim(bottom=0.0)
    look.legend(axes, loc="best")


def camera_xy(record: Record, frames: list[Frame]) -> Array:
    """Return where the camera saw the robot (n, 2), in the axes of the path."""
    start = SE2(record.reference[0])
    return start.transform(np.array([frame.pose[:2] for frame in frames]))
