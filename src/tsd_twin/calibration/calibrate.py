"""Experiment `calibrate`: gimbal zeros, radii and wheel spins of one robot, from squares that a
camera saw.

Squares driven both ways tell errors of scale and of direction apart, as in UMBmark (Borenstein and
Feng 1996); this fit finds the causes, not two factors for them.
"""

from __future__ import annotations

import argparse
import math
from typing import Any

import numpy as np

from tsd_twin.calibration import report
from tsd_twin.calibration.collect import (
    LOG_TABLE,
    CalibrationData,
    collect,
    next_run_advice,
    spin_ratio_of,
)
from tsd_twin.calibration.fit import CalibrationFit, fit_calibration
from tsd_twin.calibration.report import write_description
from tsd_twin.calibration.robot_client import add_bus_flags
from tsd_twin.calibration.terminal import ask_yes, print_line
from tsd_twin.experiment import Experiment, Output
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityDescription
from tsd_twin.simulation import CameraNoise
from tsd_twin.virtual_robot import VOLT_STEP


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Drive or read squares, say what is wrong with the machine, and write it down."""
    drives = collect(args, out)
    robot, recordings = drives.robot, drives.recordings
    volt_share = VOLT_STEP / math.sqrt(12.0) / robot.battery.nominal_v
    found = fit_calibration(
        robot.kinematics(), recordings, _camera(robot), robot.joint_errors(), volt_share
    )
    rows = report.parameter_table(robot, found, drives.true)
    out.table("calibrate", report.parameter_columns(rows))
    out.figure("calibrate", report.draw_calibration(recordings, found, rows))
    lines = [_summary(drives), *report.parameter_lines(rows), *_remarks(found)]
    if args.drive:
        lines += next_run_advice(out, f"{LOG_TABLE}.csv", drives.text, recordings)
    if args.write_to and args.drive and not args.yes:
        for line in lines:
            print_line(line)
        if not ask_yes(f"Write this into {args.write_to}? y or n: "):
            return [f"{args.write_to} was left as it is"]
        lines = []
    if args.write_to:
        lines.append(_write_description(args, drives, report.description_changes(rows)))
    return lines


def _camera(robot: SingularityDescription) -> CameraNoise:
    """Return what the description says of those who see the robot."""
    seen = robot.pose_sensor
    return CameraNoise(sigma_m=seen.sigma_m, sigma_rad=math.radians(seen.sigma_deg))


def _summary(drives: CalibrationData) -> str:
    recordings = drives.recordings
    seconds = sum(run.t_s[-1] - run.t_s[0] for run in recordings)
    frames = sum(len(run.camera_s) for run in recordings)
    runs = f"{len(recordings)} run{'s' if len(recordings) > 1 else ''}"
    return f"{drives.what}: {runs}, {seconds:.0f} s, {frames} frames of the camera"


def _remarks(found: CalibrationFit) -> list[str]:
    before, after = (1000 * _rms_m(each) for each in (found.before, found.after))
    lines = [f"camera and joints disagree by {before:.0f} mm RMS before, {after:.1f} mm after"]
    late_ms, about_ms = 1000 * found.found.delay_s, 1000 * found.sigma.delay_s
    lines.append(f"joints tell {late_ms:.1f} +- {about_ms:.1f} ms later what the camera sees")
    if not found.common_spin_known:
        lines.append(
            "no speed of a wheel was measured: wheel radius times the speed that all wheels have "
            "in common is known, and stands as the wheel radius"
        )
    if found.unobservable:
        lines.append("these data do not tell, so it was left as small as it can be:")
        lines += [f"  {combination}" for combination in found.unobservable]
    return lines


def _rms_m(residuals: list[Array]) -> float:
    squared = np.concatenate([np.square(each[:, :2]).sum(axis=1) for each in residuals])
    return float(np.sqrt(squared.mean()))


def _write_description(
    args: argparse.Namespace, drives: CalibrationData, changes: dict[str, dict[str, Any]]
) -> str:
    """Write what was found; return where."""
    usual, last = (spin_ratio_of(drives.recordings[i]) for i in (0, -1))
    if args.drive and (usual != last).any():
        # The robot has been started with other speeds for the last run only.
        changes["drive"]["spin_ratio"] = usual.tolist()
    write_description(args.write_to, drives.text, changes)
    return f"written into {args.write_to}"


def _flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--drive",
        action="store_true",
        help="drive a robot on the bus, guided; else a simulated one, or --log",
    )
    parser.add_argument(
        "--room",
        type=float,
        default=1.0,
        metavar="METRES",
        help="free floor on all sides of its centre, beyond its own size; default 1",
    )
    parser.add_argument(
        "--speed", type=float, default=0.5, metavar="MPS", help="at most, m/s; default 0.5"
    )
    add_bus_flags(parser)
    parser.add_argument(
        "--log",
        metavar="FILE.csv",
        help="drives that were recorded, not simulated; with --drive, one more is added to them",
    )
    parser.add_argument(
        "--robot",
        default="tsd",
        metavar="NAME|FILE",
        help="default tsd; one on the bus tells itself what it is",
    )
    parser.add_argument(
        "--seed", type=int, default=0, help="of the simulated machine and its noise; default 0"
    )
    parser.add_argument(
        "--errors",
        type=float,
        default=1.0,
        metavar="SCALE",
        help="times [errors], what else is wrong with the simulated machine; default 1",
    )
    parser.add_argument(
        "--tachometer",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="the simulated machine measures the speeds of its wheels; default yes",
    )
    parser.add_argument(
        "--same-speed",
        action="store_true",
        help="simulated wheels all at one speed: to see what such drives cannot tell",
    )
    parser.add_argument(
        "--write-to",
        metavar="FILE.toml",
        help="description to put it into, its comments kept; a new one is a copy of the robot's",
    )


EXPERIMENT = Experiment(
    name="calibrate",
    purpose="Zeros of the gimbals, radii and spins of one machine, from squares that a camera saw.",
    run=run,
    examples=[
        "tsd-lab calibrate --seed 1                      a simulated machine, the truth beside it",
        "tsd-lab calibrate --no-tachometer               what is left when no speed is measured",
        "tsd-lab calibrate --same-speed                  what drives at one speed cannot tell",
        "tsd-lab calibrate --drive --room 1.5            drive the robot of this machine, guided",
        "tsd-lab calibrate --drive --log lab/calibrate_log.csv    and add to what was recorded",
        "tsd-lab calibrate --log run.csv --robot my.toml --write-to my.toml     write it down",
    ],
    add_flags=_flags,
)
