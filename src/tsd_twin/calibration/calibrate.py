"""Experiment `calibrate`: gimbal zeros, radii and wheel speeds from squares seen by a camera.

Squares driven in both directions separate scale errors from direction errors, as in UMBmark
(Borenstein and Feng 1996); this fit identifies the physical causes instead of two correction
factors.
"""

from __future__ import annotations

import argparse
import math
from typing import Any

import numpy as np

from tsd_twin.calibration import report
from tsd_twin.calibration.bus_drive import add_drive_flags
from tsd_twin.calibration.collect import (
    LOG_TABLE,
    CalibrationData,
    collect,
    next_run_advice,
    spin_ratio_of,
)
from tsd_twin.calibration.fit import CalibrationFit, fit_calibration
from tsd_twin.calibration.operator import ask_line, print_line
from tsd_twin.calibration.report import write_description
from tsd_twin.cli import flags
from tsd_twin.cli.experiment import Experiment, Output
from tsd_twin.client.virtual_robot import VOLT_STEP
from tsd_twin.lie import Array


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Calibrate gimbal zeros, radii and wheel speeds from squares seen by a camera."""
    drives = collect(args, out)
    robot, recordings = drives.robot, drives.recordings
    volt_share = VOLT_STEP / math.sqrt(12.0) / robot.battery.nominal_v
    found = fit_calibration(
        robot.kinematics(),
        recordings,
        robot.pose_sensor.camera_noise(),
        robot.joint_errors(),
        volt_share,
        drives.learned,
        robot.errors.layer_m,
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
        answer = ask_line(f"Write this into {args.write_to}? y or n: ")
        if answer.strip().lower() not in {"y", "yes"}:
            return [f"{args.write_to} was left as it is"]
        lines = []
    if args.write_to:
        lines.append(_write_description(args, drives, report.description_changes(rows, robot)))
    return lines


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
    lines.append(f"the joints lag the camera by {late_ms:.1f} +- {about_ms:.1f} ms")
    if not found.common_spin_known:
        lines.append(
            "no wheel speed was measured: only wheel radius times the speed common to all wheels "
            "is known, and reported as the wheel radius"
        )
    if found.unobservable:
        lines.append("not observable from these data, so kept as small as possible:")
        lines += [f"  {combination}" for combination in found.unobservable]
    return lines


def _rms_m(residuals: list[Array]) -> float:
    squared = np.concatenate([np.square(each[:, :2]).sum(axis=1) for each in residuals])
    return float(np.sqrt(squared.mean()))


def _write_description(
    args: argparse.Namespace, drives: CalibrationData, changes: dict[str, dict[str, Any]]
) -> str:
    """Write the fitted calibration; return a line that names the file."""
    first, last = (spin_ratio_of(drives.recordings[i]) for i in (0, -1))
    if args.drive and (first != last).any():
        # Only the last run used the wheel speeds of this description.
        changes["drive"]["spin_ratio"] = first.tolist()
    write_description(args.write_to, drives.text, changes)
    return f"written into {args.write_to}"


def _flags(parser: argparse.ArgumentParser) -> None:
    add_drive_flags(parser, "drive a robot on the bus, guided; else a simulated one, or --log")
    text = (
        "drives that were recorded, not simulated: a recording of tsd-record, run.mcap, or a "
        "CSV file; with --drive, one more is added to them"
    )
    flags.add(parser, "--log", text, metavar="FILE")
    text = "default tsd; a robot on the bus sends its own description"
    flags.add(parser, "--robot", text, default="tsd", metavar="NAME|FILE")
    text = "factor on [errors], further model errors of the simulated robot"
    flags.add(parser, "--errors", text, flags.SCALE, 1.0, "SCALE")
    parser.add_argument(
        "--tachometer",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="the simulated robot measures its wheel speeds; default yes",
    )
    text = "simulate all wheels at one speed, which leaves some zeros unobservable"
    parser.add_argument("--same-speed", action="store_true", help=text)
    text = "description to write to, comments kept; a new one is a copy of the robot's"
    flags.add(parser, "--write-to", text, metavar="FILE.toml")


EXPERIMENT = Experiment(
    "calibrate",
    run,
    [
        "tsd-lab calibrate --seed 1                      a simulated robot, with its true values",
        "tsd-lab calibrate --no-tachometer               without measured wheel speeds",
        "tsd-lab calibrate --same-speed                  what is unobservable at one speed",
        "tsd-lab calibrate --drive --room 1.5            drive the robot of this machine, guided",
        "tsd-lab calibrate --drive --log lab/calibrate_log.csv    and add to earlier recordings",
        "tsd-lab calibrate --log run.mcap --robot my.toml --write-to my.toml    write the result",
    ],
    seed_of="the simulated robot and its noise",
    add_own_flags=_flags,
)
