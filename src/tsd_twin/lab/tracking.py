"""Path tracking in virtual time: named paths, runs, tracking errors, and two experiments.

`follow` drives any path on any robot. `omni-paths` drives the paths of Savnani et al. 2019 (line,
parabola, sine and circle) under PID with noise.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsd_twin import robots
from tsd_twin.cli import experiment, flags
from tsd_twin.cli.experiment import Axes, Experiment, Output
from tsd_twin.client.virtual import PERIOD_S
from tsd_twin.client.virtual_robot import VirtualRobot
from tsd_twin.errors import PathError
from tsd_twin.lab.observer import Loop, make_observer
from tsd_twin.lie import SE2, Array
from tsd_twin.motion.paths import Path, arc, function, line, parabola, polyline, spline
from tsd_twin.motion.routes import FixedHeading, HeadingProfile, Route, TangentHeading
from tsd_twin.motion.tracking import TrackingController
from tsd_twin.motion.trajectory import Trajectory, plan
from tsd_twin.robots import OmniDescription, description_of_kind
from tsd_twin.sensors.pose import Frame
from tsd_twin.simulation import SimRobot

_RIGHT = np.array([[0.0, 0.0], [0.7, 0.5], [1.4, 0.0], [0.7, -0.5], [0.0, 0.0]])
_EIGHT = np.concatenate([_RIGHT, _RIGHT[1:] * [-1.0, 1.0]])
NAMED_PATHS: dict[str, Callable[[float], Path]] = {
    "square": lambda cut_m: polyline([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]], cut_m),
    "line": lambda _: line([0.0, 0.0], [2.0, 0.0]),
    "circle": lambda _: arc([0.0, 0.0], 0.0, 0.5, 2.0 * math.pi),
    "parabola": lambda _: parabola(1.0, 0.0, 0.0, -1.0, 1.0),
    "sine": lambda _: function(lambda x: 0.3 * np.sin(2.0 * math.pi * x / 1.5), 0.0, 3.0),
    "eight": lambda _: spline(_EIGHT),
}
"""Paths by name; the argument is the distance before a corner at which rounding starts."""


def named_path(name: str, cut_m: float = 0.0) -> Path:
    """Return a path by its name.

    Raises:
        PathError: If no path has that name.
    """
    if name not in NAMED_PATHS:
        raise PathError(f"there is no path '{name}': {', '.join(NAMED_PATHS)}")
    return NAMED_PATHS[name](cut_m)


_MAX_COORDINATE_M = 1000.0


def path_through(points: Sequence[str], cut_m: float = 0.0, *, smooth: bool = False) -> Path:
    """Return a path through points written as `x,y`, metres: straight legs, or a spline.

    Raises:
        PathError: If a point cannot be read or is too far away, or there are too few.
    """
    numbers: list[list[float]] = []
    for point in points:
        try:
            x, y = (float(part) for part in point.split(","))
        except ValueError:
            raise PathError(f"a point is two numbers, x,y in metres, not '{point}'") from None
        if not max(abs(x), abs(y)) <= _MAX_COORDINATE_M:
            raise PathError(
                f"a point is within {_MAX_COORDINATE_M:g} m of the start, not '{point}'"
            )
        numbers.append([x, y])
    return spline(numbers) if smooth else polyline(numbers, cut_m)


_BLOCK = 512


@dataclass(frozen=True, slots=True)
class TrackingErrors:
    """Tracking errors, metres: time lag, path deviation and drift as separate measures."""

    rms_m: float
    """RMS distance to the reference at the same time."""
    worst_m: float
    """Maximum distance to the reference at the same time."""
    cross_track_m: float
    """Maximum distance to the nearest point of the path."""
    closure_m: float
    """Distance between the final positions of robot and reference."""
    size_m: float
    """Larger side of the path's bounding box, the unit of the percentages."""

    def sentence(self) -> str:
        """Format three errors in millimetres and as percentages of the size."""
        parts = [
            f"{name} {1000 * value:.1f} mm ({100 * value / self.size_m:.2f} %)"
            for name, value in (
                ("RMS time-tracking", self.rms_m),
                ("maximum cross-track", self.cross_track_m),
                ("closure", self.closure_m),
            )
        ]
        return ", ".join(parts)


def tracking_errors(xy: Array, reference_xy: Array, path_xy: Array) -> TrackingErrors:
    """Return the errors of positions `xy` (n, 2) against simultaneous references and a path.

    `path_xy` (m, 2) are densely spaced points along the path.
    """
    error = xy - reference_xy
    error_m = np.hypot(error[:, 0], error[:, 1])
    return TrackingErrors(
        rms_m=float(np.sqrt(np.mean(np.square(error_m)))),
        worst_m=float(error_m.max()),
        cross_track_m=float(distances_to_path(xy, path_xy).max()),
        closure_m=float(error_m[-1]),
        size_m=float(np.ptp(path_xy, axis=0).max()),
    )


def distances_to_path(xy: Array, path_xy: Array) -> Array:
    """Return the distance of each of `xy` (n, 2) to the nearest leg between points (m, 2)."""
    start, legs = path_xy[:-1], np.diff(path_xy, axis=0)
    squared = np.maximum(np.square(legs).sum(axis=1), 1e-300)
    nearest: list[Array] = []
    for at in range(0, len(xy), _BLOCK):
        offset = xy[at : at + _BLOCK, None] - start
        share = np.clip((offset * legs).sum(axis=2) / squared, 0.0, 1.0)
        away = offset - share[..., None] * legs
        nearest.append(np.sqrt(np.square(away).sum(axis=2).min(axis=1)))
    return np.concatenate(nearest)


SETTLE_S = 0.5
"""Settling time after the end of the trajectory."""
_COMMAND_LEAD_S = 1.5 * PERIOD_S
"""Lead of a command, which takes effect one period later and refers to the middle of that
period."""


@dataclass(frozen=True, slots=True, eq=False)
class TrackingRecord:
    """Record of a run, a row per period; poses are x, y, heading relative to the mark."""

    t_s: Array
    reference: Array
    """(n, 3): reference poses."""
    truth: Array
    """(n, 3): true poses."""
    estimate: Array
    """(n, 3): estimated poses."""
    reference_twist: Array
    """(n, 3): in the body frame of the reference."""
    true_twist: Array
    """(n, 3): in the body frame."""
    path_xy: Array
    """(m, 2): densely spaced points along the path."""

    def errors(self) -> TrackingErrors:
        """Return three errors of the true positions."""
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


def follow_trajectory(
    robot: VirtualRobot,
    trajectory: Trajectory,
    tracker: TrackingController,
    estimate: Callable[[VirtualRobot], SE2] | None,
    periods: Callable[[range], Iterable[int]] = iter,
) -> TrackingRecord:
    """Follow the trajectory and return the record; `estimate` is None for open loop.

    The robot's mark is the start of the path, because trajectories may start anywhere.
    """
    start = SE2(trajectory.at(0.0).pose)
    steps = range(round((trajectory.duration_s + SETTLE_S) / PERIOD_S))
    rows: list[tuple[Array, ...]] = []
    for i in periods(steps):
        t_s = i * PERIOD_S
        seen = SE2(robot.odometry().xy_heading) if estimate is None else estimate(robot)
        pose = start @ seen
        goal = trajectory.at(t_s)
        true = (start @ robot.truth).xy_heading
        rows.append((goal.pose, true, pose.xy_heading, goal.twist, robot.true_twist))
        if estimate is None:
            robot.drive(tracker.feed_forward(t_s + _COMMAND_LEAD_S))
        else:
            robot.drive(tracker.advance(t_s, pose, PERIOD_S, _COMMAND_LEAD_S))
    path_xy = path_points(trajectory)
    at_s = PERIOD_S * np.arange(len(steps), dtype=np.float64)
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    reference, truth, estimated, reference_twist, true_twist = columns
    return TrackingRecord(at_s, reference, truth, estimated, reference_twist, true_twist, path_xy)


def path_points(trajectory: Trajectory) -> Array:
    """Return densely spaced points (m, 2) along the path of a trajectory, with its corners."""
    s_m = np.linspace(0.0, trajectory.length_m, 2001)
    joints = np.array([*trajectory.route.breaks_m])
    return trajectory.route.path.at(np.sort(np.concatenate([s_m, joints]))).xy


def draw_positions(
    axes: Axes, record: TrackingRecord, frames: list[Frame], title: str, robot: str = "robot"
) -> None:
    """Draw the path, the positions of the `robot` and the camera frames, from above."""
    axes.plot(
        *record.path_xy.T,
        color=experiment.REFERENCE_COLOUR,
        linewidth=1.2,
        linestyle="--",
        label="path",
    )
    axes.plot(*record.truth[:, :2].T, color=experiment.TRUTH_COLOUR, linewidth=1.8, label=robot)
    if frames:
        seen = camera_xy(record, frames)
        axes.plot(*seen.T, ".", color=experiment.CAMERA_COLOUR, markersize=4, label="camera")
    axes.plot(*record.truth[0, :2], "o", color=experiment.TRUTH_COLOUR, markersize=6)
    axes.plot(*record.truth[-1, :2], "s", color=experiment.TRUTH_COLOUR, markersize=6)
    axes.set_aspect("equal", adjustable="datalim")
    experiment.label_axes(axes, "x (m)", "y (m)", title)
    experiment.add_legend(axes, loc="best")


def draw_speeds(
    axes: Axes, record: TrackingRecord, frames: list[Frame], title: str, robot: str = "robot"
) -> None:
    """Draw the speed of the `robot` over time, and the speed between camera frames."""
    for twists, colour, style, name in (
        (record.reference_twist, experiment.REFERENCE_COLOUR, "--", "reference"),
        (record.true_twist, experiment.TRUTH_COLOUR, "-", robot),
    ):
        speed = np.hypot(twists[:, 0], twists[:, 1])
        axes.plot(record.t_s, speed, style, color=colour, linewidth=1.3, label=name)
    if len(frames) > 1:
        taken = np.array([frame.taken_s for frame in frames])
        steps = np.hypot(*np.diff(camera_xy(record, frames), axis=0).T)
        middle = 0.5 * (taken[1:] + taken[:-1])
        axes.plot(
            middle,
            steps / np.diff(taken),
            ".",
            color=experiment.CAMERA_COLOUR,
            markersize=4,
            label="camera",
        )
    experiment.label_axes(axes, "time (s)", "speed (m/s)", title)
    experiment.add_legend(axes, loc="best")


def draw_errors(axes: Axes, record: TrackingRecord, title: str) -> None:
    """Draw the true and the estimated distance to the reference."""
    for poses, colour, style, name in (
        (record.truth, experiment.TRUTH_COLOUR, "-", "robot"),
        (record.estimate, experiment.ESTIMATE_COLOUR, "--", "as it estimates"),
    ):
        error_m = np.hypot(*(poses - record.reference)[:, :2].T)
        axes.plot(record.t_s, 1000 * error_m, style, color=colour, linewidth=1.3, label=name)
    experiment.label_axes(axes, "time (s)", "error (mm)", title)
    axes.set_ylim(bottom=0.0)
    experiment.add_legend(axes, loc="best")


def camera_xy(record: TrackingRecord, frames: list[Frame]) -> Array:
    """Return the positions (n, 2) in the camera frames, in the axes of the path."""
    start = SE2(record.reference[0])
    return start.transform(np.array([frame.pose[:2] for frame in frames]))


SHARE = 0.8
"""Fraction of the limits used by the trajectory; the rest is a margin for feedback."""


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """A path, timed to the limits, on the simulated robot in virtual time."""
    robot = robots.load_robot(args.robot)
    heading: HeadingProfile = TangentHeading() if args.heading == "tangent" else FixedHeading()
    route = Route(_path(args), heading)
    trajectory = plan(
        route, robot.kinematics(), robot.limits, share=args.share, speed_mps=args.speed
    )
    virtual = VirtualRobot(robot, SimRobot(robot, seed=args.seed, noise=args.noise))
    watching = make_observer(Loop(args.loop), virtual, args.seed)
    record = follow_trajectory(
        virtual,
        trajectory,
        TrackingController(trajectory, lag_s=robot.lag_s),
        watching,
        lambda steps: out.progress(steps, "driving", len(steps)),
    )
    out.table("follow", record.columns())
    _draw(args, record, watching.frames if watching else [], out)
    return [
        f"{trajectory.length_m:.3f} m in {trajectory.duration_s:.3f} s, loop: {args.loop}",
        record.errors().sentence(),
    ]


def _path(args: argparse.Namespace) -> Path:
    if args.points:
        return path_through(args.points, args.cut, smooth=args.smooth)
    return named_path(args.path, args.cut)


def _draw(
    args: argparse.Namespace, record: TrackingRecord, frames: list[Frame], out: Output
) -> None:
    name = "given points" if args.points else args.path
    figure: Any = experiment.new_figure(10.5, 5.2, f"Following: {name}, loop: {args.loop}")
    grid = figure.add_gridspec(2, 2, width_ratios=[1.15, 1.0])
    draw_positions(figure.add_subplot(grid[:, 0]), record, frames, "position from above")
    draw_speeds(figure.add_subplot(grid[0, 1]), record, frames, "speed over the floor")
    draw_errors(figure.add_subplot(grid[1, 1]), record, "error in time")
    out.figure("follow", figure)


def add_loop_flag(parser: argparse.ArgumentParser, loop: Loop) -> None:
    """Add the flag that selects the feedback."""
    text = f"feedback of the controller; each adds to the one before it; default {loop.value}"
    flags.add(parser, "--loop", text, default=loop.value, choices=[kind.value for kind in Loop])


def _flags(parser: argparse.ArgumentParser) -> None:
    add_loop_flag(parser, Loop.GYRO)
    flags.add(parser, "--path", "one of these", default="square", choices=list(NAMED_PATHS))
    parser.add_argument(
        "--points", nargs="+", metavar="X,Y", help="a path of your own, metres; 0,0 1,0 1,0.5"
    )
    parser.add_argument("--smooth", action="store_true", help="a spline through the points")
    flags.add(parser, "--cut", "round corners, from so far before", flags.number(0.0), 0.0, "M")
    parser.add_argument("--heading", choices=["fixed", "tangent"], default="fixed")
    flags.add(parser, "--speed", "a lower limit of speed", flags.POSITIVE, metavar="MPS")
    text = "of the limits that the timing uses"
    flags.add(parser, "--share", text, flags.number(most=1.0, above=0.0), SHARE)


EXPERIMENT = Experiment(
    "follow",
    run,
    [
        "tsd-lab follow --path eight --heading tangent --out lab",
        "tsd-lab follow --path square --cut 0.2 --loop camera",
        "tsd-lab follow --points 0,0 1,0 1,0.5 2,0.5 --smooth --loop open --noise 0",
    ],
    robot="tsd",
    noise=True,
    seed_of="all noise",
    add_own_flags=_flags,
)


HEADING_PROFILES: Mapping[str, HeadingProfile] = {
    "line": FixedHeading(),
    "parabola": FixedHeading(),
    "sine": FixedHeading(),
    "circle": TangentHeading(),
}
"""Paths of the paper (Eq. 17 to 20) with their headings: tangential on arcs."""


def run_omni_paths(args: argparse.Namespace, out: Output) -> list[str]:
    """Line, parabola, sine and circle under PID with noise: errors of each."""
    robot = description_of_kind(robots.load_robot(args.robot), OmniDescription)
    records: dict[str, TrackingRecord] = {}
    for name, heading in out.progress(HEADING_PROFILES.items(), "driving", len(HEADING_PROFILES)):
        records[name] = run_path(robot, name, heading, args.noise, args.seed)
        out.table(f"omni-paths_{name}", records[name].columns())
    _draw_omni_paths(robot, records, out)
    return [f"{name}: {record.errors().sentence()}" for name, record in records.items()]


def run_path(
    robot: OmniDescription, name: str, heading: HeadingProfile, noise: float, seed: int
) -> TrackingRecord:
    """Return the record of a path under feed-forward and PID."""
    virtual = VirtualRobot(robot, SimRobot(robot, seed=seed, noise=noise))
    drive = robot.kinematics()
    trajectory = plan(Route(named_path(name), heading), drive, robot.limits, share=SHARE)
    tracker = TrackingController(trajectory, lag_s=robot.lag_s)
    return follow_trajectory(
        virtual, trajectory, tracker, lambda each: SE2(each.odometry().xy_heading)
    )


def _draw_omni_paths(
    robot: OmniDescription, records: Mapping[str, TrackingRecord], out: Output
) -> None:
    figure = experiment.new_figure(14.0, 6.6, f"{robot.title}: paths under PID with noise")
    above, below = figure.subplots(2, len(records), height_ratios=[3, 2])
    for from_above, error, (name, record) in zip(above, below, records.items(), strict=True):
        draw_positions(from_above, record, [], name)
        draw_errors(error, record, "error in time")
    out.figure("omni-paths", figure)


OMNI_PATHS = Experiment(
    "omni-paths",
    run_omni_paths,
    ["tsd-lab omni-paths --out lab", "tsd-lab omni-paths --robot kiwi --noise 0"],
    robot="omni4",
    noise=True,
    seed_of="the noise",
)
