"""One robot that follows one trajectory in virtual time, and a record of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from tsd_twin.lab.tracking import TrackingErrors, tracking_errors
from tsd_twin.lab.virtual_robot import PERIOD_S, VirtualRobot
from tsd_twin.lie import SE2, Array
from tsd_twin.motion.tracker import Tracker
from tsd_twin.motion.trajectory import Trajectory

SETTLE_S = 0.5
"""Time after the end of the trajectory in which the robot comes to rest."""
_AHEAD_S = 1.5 * PERIOD_S
"""A command is taken up a period later, and holds for one: it is meant for the middle of that."""


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """What happened, a row for each period; poses are x, y, heading since the mark."""

    t_s: Array
    reference: Array
    """(n, 3)."""
    truth: Array
    """(n, 3)."""
    estimate: Array
    """(n, 3)."""
    reference_twist: Array
    """(n, 3): in the body frame of the reference."""
    true_twist: Array
    """(n, 3): in the body frame."""
    path_xy: Array
    """(m, 2): points close together along the path."""

    def errors(self) -> TrackingErrors:
        """Return the three errors of the true positions."""
        return tracking_errors(self.truth[:, :2], self.reference[:, :2], self.path_xy)

    def columns(self) -> dict[str, Array]:
        """Return the columns of a table."""
        table = {"t_s": self.t_s}
        for name, poses in (
            ("reference", self.reference),
            ("truth", self.truth),
            ("estimate", self.estimate),
        ):
            table |= {
                f"{name}_{axis}": poses[:, i]
                for i, axis in enumerate(("x_m", "y_m", "heading_rad"))
            }
        for name, twists in (("reference", self.reference_twist), ("true", self.true_twist)):
            axes = ("vx_mps", "vy_mps", "omega_rad_per_s")
            table |= {f"{name}_{axis}": twists[:, i] for i, axis in enumerate(axes)}
        return table


def follow(
    robot: VirtualRobot,
    trajectory: Trajectory,
    tracker: Tracker,
    estimate: Callable[[VirtualRobot], SE2] | None,
    periods: Callable[[range], Iterable[int]] = iter,
) -> Record:
    """Drive the trajectory and return what happened; `estimate` is None for open loop.

    The mark of the robot is the start of the path: trajectories may start anywhere.
    """
    start = SE2(trajectory.at(0.0).pose)
    steps = range(round((trajectory.duration_s + SETTLE_S) / PERIOD_S))
    rows: dict[str, list[Array]] = {name: [] for name in ("reference", "truth", "estimate")}
    rows |= {"reference_twist": [], "true_twist": []}
    for i in periods(steps):
        t_s = i * PERIOD_S
        seen = SE2(robot.odometry().xy_heading) if estimate is None else estimate(robot)
        pose = start @ seen
        reference = trajectory.at(t_s)
        for name, row in (
            ("reference", reference.pose),
            ("truth", (start @ robot.truth).xy_heading),
            ("estimate", pose.xy_heading),
            ("reference_twist", reference.twist),
            ("true_twist", robot.true_twist),
        ):
            rows[name].append(row)
        if estimate is None:
            robot.drive(tracker.feed_forward(t_s + _AHEAD_S))
        else:
            robot.drive(tracker.advance(t_s, pose, PERIOD_S, _AHEAD_S))
    s_m = np.linspace(0.0, trajectory.length_m, 2001)
    joints = np.array([*trajectory.route.breaks_m])
    return Record(
        t_s=PERIOD_S * np.arange(len(steps), dtype=np.float64),
        path_xy=trajectory.route.path.at(np.sort(np.concatenate([s_m, joints]))).xy,
        **{name: np.array(row) for name, row in rows.items()},
    )
