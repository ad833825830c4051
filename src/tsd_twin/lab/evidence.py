"""What a calibration has to go by: squares that were driven, on the bus, in a log or simulated."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np

from tsd_twin import robots
from tsd_twin.lab import excitation, recording
from tsd_twin.lab.driven import driven
from tsd_twin.lab.machine import Machine, built
from tsd_twin.lab.output import Output
from tsd_twin.lab.recording import Recording
from tsd_twin.robots import SingularityRobot, of_kind

LOG = "calibrate_log"
"""The table that drives are kept in."""
_RUN_S = 60.0
"""From the start of one simulated run to that of the next: each is shorter."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """What there is to calibrate from."""

    what: str
    text: str
    """The TOML of the description in force."""
    robot: SingularityRobot
    recordings: list[Recording]
    true: SingularityRobot | None = None
    """What a simulated machine is really like."""


def evidence(args: argparse.Namespace, out: Output) -> Evidence:
    """Return what the flags ask for; what was driven now is kept in a file, too."""
    found = _from_bus(args, out) if args.drive else _without_bus(args, out)
    if args.drive or not args.log:
        out.table(LOG, recording.columns(found.recordings))
    return found


def _from_bus(args: argparse.Namespace, out: Output) -> Evidence:
    """Drive the robot on the bus; what was recorded before counts as well."""
    out.spare(f"{LOG}.csv", args.log)
    came = driven(args, out)
    return Evidence(came.id, came.text, came.robot, came.recordings)


def _without_bus(args: argparse.Namespace, out: Output) -> Evidence:
    """Read drives, or simulate them."""
    text = robots.text(args.robot)
    robot = of_kind(robots.load(args.robot), SingularityRobot)
    if args.log:
        recordings = recording.read(args.log, robot.drive.modules)
        return Evidence(args.log, text, robot, recordings)
    true = built(robot, np.random.default_rng(args.seed))
    what = "simulated machine with errors of its own"
    return Evidence(what, text, robot, _simulated(robot, true, args, out), true)


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
