"""Experiment `follow`: a path, timed to the limits, on the simulated robot, open or closed loop."""

from __future__ import annotations

import argparse
from typing import Any

from tsd_twin import experiment, flag_types, robots
from tsd_twin.experiment import Experiment, Output
from tsd_twin.lab import tracking
from tsd_twin.lab.observer import Loop, make_observer
from tsd_twin.lab.tracking import TrackingRecord, follow_trajectory
from tsd_twin.motion.paths import Path
from tsd_twin.motion.routes import FixedHeading, HeadingProfile, Route, TangentHeading
from tsd_twin.motion.tracking import TrackingController, TrackingSettings
from tsd_twin.motion.trajectory import plan
from tsd_twin.simulation import Frame, SimRobot
from tsd_twin.virtual_robot import VirtualRobot

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
