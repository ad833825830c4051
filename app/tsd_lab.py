"""`tsd-lab`: experiments and calibration, each with a figure and a table."""

from __future__ import annotations

import argparse
from pathlib import Path

from tsd_twin import program
from tsd_twin.calibration import calibrate, zeroing
from tsd_twin.errors import TwinError
from tsd_twin.experiment import Experiment, Output
from tsd_twin.lab import (
    alarms,
    budget,
    camera_gap,
    consistency,
    go_to,
    health,
    mismatch,
    motors,
    papers,
    square,
    tracking,
)
from tsd_twin.recording import rerun_experiment

EXPERIMENTS: tuple[Experiment, ...] = (
    motors.EXPERIMENT,
    square.EXPERIMENT,
    mismatch.EXPERIMENT,
    tracking.EXPERIMENT,
    go_to.EXPERIMENT,
    budget.EXPERIMENT,
    consistency.EXPERIMENT,
    alarms.EXPERIMENT,
    camera_gap.EXPERIMENT,
    health.EXPERIMENT,
    calibrate.EXPERIMENT,
    zeroing.EXPERIMENT,
    papers.OMNI_STEP,
    tracking.OMNI_PATHS,
    papers.ATLAS,
    rerun_experiment.EXPERIMENT,
)
"""Experiments of `tsd-lab`, one module each."""

__all__ = ["EXPERIMENTS", "Experiment", "Output"]


PARSER = program.parser(
    "tsd-lab",
    "Experiments in virtual time: each prints figures, and leaves PNG and CSV in a folder.",
    [
        "tsd-lab motors                          Table 1 of the thesis to its Table 2",
        "tsd-lab square --loop camera            its 1 m square, closed loop",
        "tsd-lab follow --path eight --out run1  a path, timed to the limits",
        "tsd-lab atlas                           Fig. 7 of the paper on the spherical platform",
        "tsd-lab square --help                   flags and examples of one experiment",
    ],
)


def experiment(args: argparse.Namespace) -> None:
    """Run an experiment; print its results and the written files."""
    out = Output(args.out, quiet=args.quiet)
    try:
        lines = args.experiment.run(args, out)
    except KeyboardInterrupt:
        raise TwinError("interrupted, nothing is complete") from None
    for line in lines:
        print(line)
    for path in out.written:
        print(f"wrote {path}")


def main() -> None:
    """Parse the flags and run."""
    commands = PARSER.add_subparsers(metavar="EXPERIMENT", required=True)
    for each in EXPERIMENTS:
        parser = commands.add_parser(
            each.name,
            help=each.purpose,
            description=each.purpose,
            epilog="examples:\n" + "\n".join(f"  {example}" for example in each.examples),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        each.add_flags(parser)
        parser.add_argument(
            "--out", type=Path, default=Path("lab"), metavar="FOLDER", help="default lab"
        )
        parser.add_argument("--quiet", action="store_true", help="show no progress")
        parser.set_defaults(experiment=each)
    program.run(PARSER, experiment)


if __name__ == "__main__":
    main()
