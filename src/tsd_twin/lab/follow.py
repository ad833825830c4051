"""Experiments `follow` and `omni-paths`: paths timed to the limits, driven in open or closed loop.

`follow` drives any path on any robot. `omni-paths` drives those of Savnani et al. 2019, line,
parabola, sine and circle, under PID with noise.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from tsd_twin import experiment, flag_types, robots
from tsd_twin.client.simulated import VirtualRobot
from tsd_twin.experiment import Experiment, Output
from tsd_twin.lab import tracking
from tsd_twin.lab.observer import Loop, make_observer
from tsd_twin.lab.tracking import TrackingRecord, follow_trajectory, named_path
from tsd_twin.lie import SE2
from tsd_twin.motion.paths import Path
from tsd_twin.motion.routes import FixedHeading, HeadingProfile, Route, TangentHeading
from tsd_twin.motion.tracking import TrackingController, TrackingSettings
from tsd_twin.motion.trajectory import plan
from tsd_twin.robots import OmniDescription, description_of_kind
from tsd_twin.simulation import Frame, SimRobot

SHARE = 0.8
"""Share of the limits used by the trajectory; the rest is a margin for correction."""


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
        TrackingController(trajectory, TrackingSettings(lag_s=robot.lag_s)),
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
        return tracking.path_through(args.points, args.cut, smooth=args.smooth)
    return tracking.named_path(args.path, args.cut)


def _draw(
    args: argparse.Namespace, record: TrackingRecord, frames: list[Frame], out: Output
) -> None:
    name = "given points" if args.points else args.path
    figure: Any = experiment.new_figure(10.5, 5.2, f"Following: {name}, loop: {args.loop}")
    grid = figure.add_gridspec(2, 2, width_ratios=[1.15, 1.0])
    tracking.draw_positions(figure.add_subplot(grid[:, 0]), record, frames, "position from above")
    tracking.draw_speeds(figure.add_subplot(grid[0, 1]), record, frames, "speed over the floor")
    tracking.draw_errors(figure.add_subplot(grid[1, 1]), record, "error in time")
    out.figure("follow", figure)


def add_loop_flag(parser: argparse.ArgumentParser, loop: Loop) -> None:
    """Add the flag that chooses the feedback."""
    parser.add_argument(
        "--loop",
        choices=[kind.value for kind in Loop],
        default=loop.value,
        help=f"feedback of the controller; each adds to the one before it; default {loop.value}",
    )


def _flags(parser: argparse.ArgumentParser) -> None:
    add_loop_flag(parser, Loop.GYRO)
    parser.add_argument(
        "--path",
        default="square",
        choices=list(tracking.NAMED_PATHS),
        help="one of these; default square",
    )
    parser.add_argument(
        "--points", nargs="+", metavar="X,Y", help="a path of your own, metres; 0,0 1,0 1,0.5"
    )
    parser.add_argument("--smooth", action="store_true", help="a spline through the points")
    parser.add_argument(
        "--cut",
        type=flag_types.number(0.0),
        default=0.0,
        metavar="M",
        help="round corners, from so far before",
    )
    parser.add_argument("--heading", choices=["fixed", "tangent"], default="fixed")
    parser.add_argument(
        "--speed", type=flag_types.POSITIVE, metavar="MPS", help="a lower limit of speed"
    )
    parser.add_argument(
        "--share",
        type=flag_types.number(most=1.0, above=0.0),
        default=SHARE,
        help=f"of the limits that the timing uses; default {SHARE}",
    )


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
    """Line, parabola, sine and circle under PID with noise: error figures of each."""
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
    """Record of one path under feed-forward and PID."""
    virtual = VirtualRobot(robot, SimRobot(robot, seed=seed, noise=noise))
    drive = robot.kinematics()
    trajectory = plan(Route(named_path(name), heading), drive, robot.limits, share=SHARE)
    tracker = TrackingController(trajectory, TrackingSettings(lag_s=robot.lag_s))
    return follow_trajectory(virtual, trajectory, tracker, _estimated_pose)


def _estimated_pose(virtual: VirtualRobot) -> SE2:
    return SE2(virtual.odometry().xy_heading)


def _draw_omni_paths(
    robot: OmniDescription, records: Mapping[str, TrackingRecord], out: Output
) -> None:
    figure = experiment.new_figure(14.0, 6.6, f"{robot.title}: paths under PID with noise")
    above, below = figure.subplots(2, len(records), height_ratios=[3, 2])
    for from_above, error, (name, record) in zip(above, below, records.items(), strict=True):
        tracking.draw_positions(from_above, record, [], name)
        tracking.draw_errors(error, record, "error in time")
    out.figure("omni-paths", figure)


OMNI_PATHS = Experiment(
    "omni-paths",
    run_omni_paths,
    ["tsd-lab omni-paths --out lab", "tsd-lab omni-paths --robot kiwi --noise 0"],
    robot="omni4",
    noise=True,
    seed_of="the noise",
)
