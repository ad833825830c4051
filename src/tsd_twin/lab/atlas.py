"""Experiment `atlas`: error of the ideal kinematics of a sphere on wheels with two rows of rollers,
Fig. 7 of Weiss et al. 2008.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import msgspec
import numpy as np

from tsd_twin import experiment, flag_types, robots
from tsd_twin.errors import TwinError
from tsd_twin.experiment import Experiment, Output
from tsd_twin.kinematics import SphereKinematics
from tsd_twin.lie import Array
from tsd_twin.robots import SphereDescription, description_of_kind

TABLE_1 = np.array(
    [
        [0.0, 1.0, 0.0, 0.0],
        [0.1, 1.0, 1.0, 1.0],
        [1.0, 1.0, 2.0, 2.0],
        [2.0, 2.0, 1.0, 1.0],
        [3.0, 2.0, 1.0, 2.0],
        [4.0, 0.0, 0.0, 1.0],
        [5.0, 1.0, 0.0, 0.0],
        [6.0, 0.0, 1.0, 0.0],
        [7.0, 1.0, 2.0, 3.0],
        [8.0, 2.0, 1.0, 3.0],
        [9.0, 1.0, 3.0, 2.0],
        [10.0, 2.0, 3.0, 1.0],
        [11.0, 3.0, 1.0, 2.0],
        [12.0, 3.0, 2.0, 1.0],
        [13.0, 0.0, 0.0, 0.0],
    ]
)
"""Time, s, and speeds of the three wheels, rad/s; straight lines between the rows."""
STEP_S = 0.001


@dataclass(frozen=True, slots=True, eq=False)
class RowEffect:
    """Ideal and dual-row motion of a sphere at the same wheel speeds, a row for each time."""

    t_s: Array
    speeds: Array
    """(n, 3): wheel speeds, rad/s."""
    ideal: Array
    """(n, 3): angular velocity with contacts half-way between the rows, rad/s."""
    true: Array
    """(n, 3): angular velocity by the dual-row model, rad/s."""

    @property
    def angle_rad(self) -> Array:
        """(n,): angle between the two angular velocities; 0 at standstill."""
        across = np.linalg.norm(np.cross(self.ideal, self.true), axis=-1)
        return np.arctan2(across, np.sum(self.ideal * self.true, axis=-1))

    @property
    def share(self) -> Array:
        """(n,): relative magnitude error 1 - |ideal| / |true|; 0 at standstill."""
        ideal, true = (np.linalg.norm(each, axis=-1) for each in (self.ideal, self.true))
        return np.where(true > 0.0, 1.0 - ideal / np.where(true > 0.0, true, 1.0), 0.0)

    def columns(self) -> dict[str, Array]:
        """Columns of a table."""
        table = {"t_s": self.t_s}
        for i in range(self.speeds.shape[1]):
            table[f"wheel{i + 1}_rad_per_s"] = self.speeds[:, i]
        for name, twist in (("ideal", self.ideal), ("true", self.true)):
            for i, axis in enumerate("xyz"):
                table[f"{name}_w{axis}_rad_per_s"] = twist[:, i]
        return table | {"angle_deg": np.degrees(self.angle_rad), "share_percent": 100 * self.share}


def row_effect(
    drive: SphereKinematics, table: Array = TABLE_1, step_s: float = STEP_S
) -> RowEffect:
    """Dual-row effect for wheel speeds (r, 1 + k) that are linear between times."""
    start, end = float(table[0, 0]), float(table[-1, 0])
    t: Array = np.linspace(start, end, round((end - start) / step_s) + 1)
    columns = [np.interp(t, table[:, 0], table[:, i]) for i in range(1, table.shape[1])]
    speeds = np.stack(columns, axis=-1)
    # The trapezoidal rule is exact for a speed that is linear in time.
    steps: Array = 0.5 * (speeds[1:] + speeds[:-1]) * np.diff(t)[:, None]
    angles: Array = np.concatenate([np.zeros((1, speeds.shape[1])), np.cumsum(steps, axis=0)])
    ideal = drive.forward(speeds).twist
    return RowEffect(t, speeds, ideal, drive.true_twist(speeds, drive.side(angles)))


PAPER_MM = 12.5
_ROUNDING = 1e-6


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Fig. 7 of the Atlas paper: ideal against dual-row kinematics over 13 seconds."""
    robot = description_of_kind(robots.load_robot(args.robot), SphereDescription)
    if args.row_distance_mm is not None:
        distance_m = args.row_distance_mm / 1000.0
        geometry = msgspec.structs.replace(robot.drive, row_distance_m=distance_m)
        robot = msgspec.structs.replace(robot, drive=geometry)
        for problem, _ in robot.problems():
            raise TwinError(f"--row-distance-mm {args.row_distance_mm:g}: {problem}")
    effect = row_effect(robot.kinematics())
    out.table("atlas", effect.columns())
    _draw_effect(robot, effect, out)
    angle, share = np.degrees(effect.angle_rad), 100.0 * np.abs(effect.share)
    return [
        f"{robot.title}, rows {1000 * robot.drive.row_distance_m:g} mm apart, inputs of Table 1",
        f"  (the paper has 3.2 deg and 3.8 % for rows {PAPER_MM:g} mm apart):",
        f"  peak angle     {_peak_text(angle, effect.t_s, 'deg')}",
        f"  peak magnitude {_peak_text(share, effect.t_s, '%')}",
    ]


def _peak_text(values: Array, t_s: Array, unit: str) -> str:
    """Text of the largest of `values` and its time, without the time for rounding."""
    peak = float(values.max())
    when = f" at {t_s[values.argmax()]:.2f} s" if peak > _ROUNDING else ""
    return f"{peak:.2f} {unit}{when}"


def _draw_effect(robot: SphereDescription, effect: RowEffect, out: Output) -> None:
    title = f"{robot.title}: what is left out when a wheel has two rows of rollers"
    figure = experiment.new_figure(10.0, 6.4, title)
    inputs, angle, share = figure.subplots(3, 1, sharex=True, height_ratios=[2, 3, 3])
    for i in range(effect.speeds.shape[1]):
        colour, label = experiment.SERIES_COLOURS[i], f"wheel {i + 1}"
        inputs.plot(effect.t_s, effect.speeds[:, i], color=colour, linewidth=1.2, label=label)
    experiment.label_axes(inputs, "", "speed (rad/s)", "inputs: Table 1, linear in time")
    experiment.add_legend(inputs, ncols=3)
    angle.plot(
        effect.t_s, np.degrees(effect.angle_rad), color=experiment.ESTIMATE_COLOUR, linewidth=1.0
    )
    experiment.label_axes(angle, "", "angle (deg)", "between ideal and true angular velocity")
    share.plot(effect.t_s, 100.0 * effect.share, color=experiment.TRUTH_COLOUR, linewidth=1.0)
    experiment.label_axes(
        share, "time (s)", "magnitude (%)", "by how much the ideal one is too slow"
    )
    out.figure("atlas", figure)


def _flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--row-distance-mm",
        type=flag_types.number(0.0),
        metavar="D",
        help="distance of the two rows, instead of that of the file; 0 is an ideal wheel",
    )


EXPERIMENT = Experiment(
    "atlas",
    run,
    ["tsd-lab atlas --out lab", "tsd-lab atlas --row-distance-mm 0"],
    robot="atlas",
    add_own_flags=_flags,
)
