"""Experiment `omni-paths`: line, parabola, sine and circle under PID with noise, and their tracking
errors.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping

from tsd_twin import experiment, robots
from tsd_twin.experiment import Experiment, Output
from tsd_twin.lab import tracking
from tsd_twin.lab.tracking import TrackingRecord, follow_trajectory, named_path
from tsd_twin.lie import SE2
from tsd_twin.motion.routes import FixedHeading, HeadingProfile, Route, TangentHeading
from tsd_twin.motion.tracking import TrackingController, TrackingSettings
from tsd_twin.motion.trajectory import plan
from tsd_twin.robots import OmniDescription, description_of_kind
from tsd_twin.simulation import SimRobot
from tsd_twin.virtual_robot import VirtualRobot

HEADING_PROFILES: Mapping[str, HeadingProfile] = {
    "line": FixedHeading(),
    "parabola": FixedHeading(),
    "sine": FixedHeading(),
    "circle": TangentHeading(),
}
"""Paths of the paper (Eq. 17 to 20) with their headings: tangential on arcs."""
_SHARE = 0.8
"""Share of the limits used by the trajectory; the rest is a margin for correction."""


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Line, parabola, sine and circle under PID with noise: error figures of each."""
    robot = description_of_kind(robots.load_robot(args.robot), OmniDescription)
    records: dict[str, TrackingRecord] = {}
    for name, heading in out.progress(HEADING_PROFILES.items(), "driving", len(HEADING_PROFILES)):
        records[name] = run_path(robot, name, heading, args.noise, args.seed)
        out.table(f"omni-paths_{name}", records[name].columns())
    _draw(robot, records, out)
    return [f"{name}: {record.errors().sentence()}" for name, record in records.items()]


def run_path(
    robot: OmniDescription, name: str, heading: HeadingProfile, noise: float, seed: int
) -> TrackingRecord:
    """Record of one path under feed-forward and PID."""
    virtual = VirtualRobot(robot, SimRobot(robot, seed=seed, noise=noise))
    drive = robot.kinematics()
    trajectory = plan(Route(named_path(name), heading), drive, robot.limits, share=_SHARE)
    tracker = TrackingController(trajectory, TrackingSettings(lag_s=robot.lag_s))
    return follow_trajectory(virtual, trajectory, tracker, _estimated_pose)


def _estimated_pose(virtual: VirtualRobot) -> SE2:
    return SE2(virtual.odometry().xy_heading)


def _draw(robot: OmniDescription, records: Mapping[str, TrackingRecord], out: Output) -> None:
    figure = experiment.new_figure(14.0, 6.6, f"{robot.title}: paths under PID with noise")
    above, below = figure.subplots(2, len(records), height_ratios=[3, 2])
    for from_above, error, (name, record) in zip(above, below, records.items(), strict=True):
        tracking.draw_positions(from_above, record, [], name)
        tracking.draw_errors(error, record, "error in time")
    out.figure("omni-paths", figure)


EXPERIMENT = Experiment(
    "omni-paths",
    run,
    ["tsd-lab omni-paths --out lab", "tsd-lab omni-paths --robot kiwi --noise 0"],
    robot="omni4",
    noise=True,
    seed_of="the noise",
)
