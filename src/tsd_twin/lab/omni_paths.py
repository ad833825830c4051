"""Line, parabola, sine and circle under PID, with noise: what each is off by."""

from __future__ import annotations

import argparse
from collections.abc import Mapping

from tsd_twin import robots
from tsd_twin.lab import charts, look
from tsd_twin.lab.drive_path import Record, follow
from tsd_twin.lab.experiment import Experiment
from tsd_twin.lab.output import Output
from tsd_twin.lab.shapes import shape
from tsd_twin.lab.virtual_robot import VirtualRobot
from tsd_twin.lie import SE2
from tsd_twin.motion.heading import FixedHeading, HeadingLaw, TangentHeading
from tsd_twin.motion.route import Route
from tsd_twin.motion.tracker import Tracker, TrackerSettings
from tsd_twin.motion.trajectory import plan
from tsd_twin.robots import OmniRobot, of_kind
from tsd_twin.sim import SimRobot

PATHS: Mapping[str, HeadingLaw] = {
    "line": FixedHeading(),
    "parabola": FixedHeading(),
    "sine": FixedHeading(),
    "circle": TangentHeading(),
}
"""Paths of the paper (Eq. 17 to 20), and where the robot looks: on arcs along the tangent."""
_SHARE = 0.8
"""Of the limits: the rest is for corrections."""


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Follow each path by the robot's own estimate, draw what it did and say what it is off by."""
    robot = of_kind(robots.load(args.robot), OmniRobot)
    records: dict[str, Record] = {}
    for name, heading in out.progress(PATHS.items(), "driving", len(PATHS)):
        records[name] = ride(robot, name, heading, args.noise, args.seed)
        out.table(f"omni-paths_{name}", records[name].columns())
    _draw(robot, records, out)
    return [f"{name}: {record.errors().sentence()}" for name, record in records.items()]


def ride(robot: OmniRobot, name: str, heading: HeadingLaw, noise: float, seed: int) -> Record:
    """Return what a robot made of one path under feed-forward and PID."""
    virtual = VirtualRobot(robot, SimRobot(robot, seed=seed, noise=noise))
    drive = robot.kinematics()
    trajectory = plan(Route(shape(name), heading), drive, robot.limits, share=_SHARE)
    tracker = Tracker(trajectory, TrackerSettings(lag_s=robot.lag_s))
    return follow(virtual, trajectory, tracker, _believed)


def _believed(virtual: VirtualRobot) -> SE2:
    return SE2(virtual.odometry().xy_heading)


def _draw(robot: OmniRobot, records: Mapping[str, Record], out: Output) -> None:
    figure = look.figure(14.0, 6.6, f"{robot.title}: paths under PID with noise")
    above, below = figure.subplots(2, len(records), height_ratios=[3, 2])
    for from_above, error, (name, record) in zip(above, below, records.items(), strict=True):
        charts.draw_positions(from_above, record, [], name)
        charts.draw_errors(error, record, "error in time")
    out.picture("omni-paths", figure)


def _flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--robot", default="omni4", metavar="NAME|FILE", help="default omni4")
    parser.add_argument("--noise", type=float, default=1.0, metavar="SCALE", help="default 1")
    parser.add_argument("--seed", type=int, default=0, help="of the noise; default 0")


EXPERIMENT = Experiment(
    name="omni-paths",
    purpose="Line, parabola, sine and circle under PID with noise: error figures of each.",
    run=run,
    examples=["tsd-lab omni-paths --out lab", "tsd-lab omni-paths --robot kiwi --noise 0"],
    add_flags=_flags,
)
