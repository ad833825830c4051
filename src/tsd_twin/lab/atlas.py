"""Fig. 7 of Weiss et al. 2008: how far ideal kinematics of the sphere are from the true ones."""

from __future__ import annotations

import argparse

import msgspec
import numpy as np

from tsd_twin import robots
from tsd_twin.lab import look
from tsd_twin.lab.experiment import Experiment
from tsd_twin.lab.output import Output
from tsd_twin.lab.row_effect import RowEffect, row_effect
from tsd_twin.lie import Array
from tsd_twin.robots import SphereRobot, of_kind

PAPER_MM = 12.5
_ROUNDING = 1e-6


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Compute both error curves, draw them and say their peaks."""
    robot = of_kind(robots.load(args.robot), SphereRobot)
    if args.row_distance_mm is not None:
        distance_m = max(0.0, args.row_distance_mm / 1000.0)
        geometry = msgspec.structs.replace(robot.drive, row_distance_m=distance_m)
        robot = msgspec.structs.replace(robot, drive=geometry)
    effect = row_effect(robot.kinematics())
    out.table("atlas", effect.columns())
    _draw(robot, effect, out)
    angle, share = np.degrees(effect.angle_rad), 100.0 * np.abs(effect.share)
    return [
        f"{robot.title}, rows {1000 * robot.drive.row_distance_m:g} mm apart, inputs of Table 1",
        f"  (the paper has 3.2 deg and 3.8 % for rows {PAPER_MM:g} mm apart):",
        f"  peak angle     {_peak(angle, effect.t_s, 'deg')}",
        f"  peak magnitude {_peak(share, effect.t_s, '%')}",
    ]


def _peak(values: Array, t_s: Array, unit: str) -> str:
    """Return the largest of `values` in words, and when it was, unless they are all rounding."""
    peak = float(values.max())
    when = f" at {t_s[values.argmax()]:.2f} s" if peak > _ROUNDING else ""
    return f"{peak:.2f} {unit}{when}"


def _draw(robot: SphereRobot, effect: RowEffect, out: Output) -> None:
    title = f"{robot.title}: what is left out when a wheel has two rows of rollers"
    figure = look.figure(10.0, 6.4, title)
    inputs, angle, share = figure.subplots(3, 1, sharex=True, height_ratios=[2, 3, 3])
    for i in range(effect.speeds.shape[1]):
        colour, label = look.SERIES[i], f"wheel {i + 1}"
        inputs.plot(effect.t_s, effect.speeds[:, i], color=colour, linewidth=1.2, label=label)
    look.dress(inputs, "", "speed (rad/s)", "inputs: Table 1, linear in time")
    look.legend(inputs, ncols=3)
    angle.plot(effect.t_s, np.degrees(effect.angle_rad), color=look.ESTIMATE, linewidth=1.0)
    look.dress(angle, "", "angle (deg)", "between ideal and true angular velocity")
    share.plot(effect.t_s, 100.0 * effect.share, color=look.TRUTH, linewidth=1.0)
    look.dress(share, "time (s)", "magnitude (%)", "by how much the ideal one is too slow")
    out.picture("atlas", figure)


def _flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--robot", default="atlas", metavar="NAME|FILE", help="default atlas")
    parser.add_argument(
        "--row-distance-mm",
        type=float,
        metavar="D",
        help="distance of the two rows, instead of that of the file; 0 is an ideal wheel",
    )


EXPERIMENT = Experiment(
    name="atlas",
    purpose="Fig. 7 of the Atlas paper: ideal against dual-row kinematics over 13 seconds.",
    run=run,
    examples=["tsd-lab atlas --out lab", "tsd-lab atlas --row-distance-mm 0"],
    add_flags=_flags,
)
