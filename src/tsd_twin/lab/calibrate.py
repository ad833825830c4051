"""Zeros of the gimbals, radii and spins of one machine, from squares that a camera saw.

Squares driven both ways tell errors of scale and of direction apart, as in UMBmark (Borenstein and
Feng 1996); what is found here are the causes, not two factors for them.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from tsd_twin import robots
from tsd_twin.lab import calibration_picture, excitation, figures, recording
from tsd_twin.lab.experiment import Experiment
from tsd_twin.lab.fit import Fit, fit
from tsd_twin.lab.machine import Machine, built
from tsd_twin.lab.observer import VOLT_STEP
from tsd_twin.lab.output import Output
from tsd_twin.lab.recording import Recording
from tsd_twin.lab.write_back import write_back
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityRobot, of_kind
from tsd_twin.sim import CameraNoise

_RUN_S = 60.0
"""From the start of one run to that of the next: each is shorter."""


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Drive or read squares, say what is wrong with the machine, and write it down."""
    robot = of_kind(robots.load(args.robot), SingularityRobot)
    true = None
    if args.log:
        recordings = recording.read(args.log, robot.drive.modules)
    else:
        true = built(robot, np.random.default_rng(args.seed))
        recordings = _simulated(robot, true, args, out)
        out.table("calibrate_log", recording.columns(recordings))
    volt_share = VOLT_STEP / math.sqrt(12.0) / robot.battery.nominal_v
    found = fit(robot.kinematics(), recordings, CameraNoise(), robot.joint_errors(), volt_share)
    rows = figures.table(robot, found, true)
    out.table("calibrate", figures.columns(rows))
    out.picture("calibrate", calibration_picture.draw(recordings, found, rows))
    lines = [_source(args, recordings), *figures.lines(rows), *_remarks(found)]
    if args.write_to:
        write_back(args.write_to, robots.text(args.robot), figures.changes(rows))
        lines.append(f"written into {args.write_to}")
    return lines


def _simulated(
    robot: SingularityRobot, true: SingularityRobot, args: argparse.Namespace, out: Output
) -> list[Recording]:
    ratios = excitation.patterns(robot.drive.modules)
    ratios = ratios[:1] if args.same_speed else ratios
    machine = Machine(robot, true, args.seed, noise=1.0, errors=args.errors)
    return [
        excitation.drive(
            robot,
            machine,
            ratio,
            args.seed * len(ratios) + i,
            i * _RUN_S,
            tachometer=args.tachometer,
        )
        for i, ratio in enumerate(out.progress(ratios, "driving squares", len(ratios)))
    ]


def _source(args: argparse.Namespace, recordings: list[Recording]) -> str:
    seconds = sum(run.t_s[-1] - run.t_s[0] for run in recordings)
    frames = sum(len(run.seen_s) for run in recordings)
    what = args.log or "simulated machine with errors of its own"
    return f"{what}: {len(recordings)} runs, {seconds:.0f} s, {frames} frames of the camera"


def _remarks(found: Fit) -> list[str]:
    before, after = (1000 * _rms_m(each) for each in (found.before, found.after))
    lines = [f"camera and joints disagree by {before:.0f} mm RMS before, {after:.1f} mm after"]
    late_ms, about_ms = 1000 * found.found.late_s, 1000 * found.sigma.late_s
    lines.append(f"joints tell {late_ms:.1f} +- {about_ms:.1f} ms later what the camera sees")
    if not found.common_spin_known:
        lines.append(
            "no speed of a wheel was measured: wheel radius times the speed that all wheels have "
            "in common is known, and stands as the wheel radius"
        )
    if found.unseen:
        lines.append("these data do not tell, so it was left as small as it can be:")
        lines += [f"  {combination}" for combination in found.unseen]
    return lines


def _rms_m(residuals: list[Array]) -> float:
    squared = np.concatenate([np.square(each[:, :2]).sum(axis=1) for each in residuals])
    return float(np.sqrt(squared.mean()))


def _flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--robot", default="tsd", metavar="NAME|FILE", help="default tsd")
    parser.add_argument(
        "--log",
        metavar="FILE.csv",
        help="drives that were recorded, not simulated; columns as in calibrate_log.csv",
    )
    parser.add_argument(
        "--seed", type=int, default=0, help="of the machine and its noise; default 0"
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
        help="all wheels at one speed: to see what such drives cannot tell",
    )
    parser.add_argument(
        "--write-to",
        metavar="FILE.toml",
        help="description to put it into, its comments kept; a new one is a copy of --robot",
    )


EXPERIMENT = Experiment(
    name="calibrate",
    purpose="Zeros of the gimbals, radii and spins of one machine, from squares that a camera saw.",
    run=run,
    examples=[
        "tsd-lab calibrate --seed 1                      a simulated machine, the truth beside it",
        "tsd-lab calibrate --no-tachometer               what is left when no speed is measured",
        "tsd-lab calibrate --same-speed                  what drives at one speed cannot tell",
        "tsd-lab calibrate --log run.csv --robot my.toml --write-to my.toml    a machine of yours",
    ],
    add_flags=_flags,
)
