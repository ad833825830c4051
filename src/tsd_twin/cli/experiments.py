"""Command line of programs that consist of experiments: `tsd-lab` and `python -m research`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from tsd_twin.cli import flags, program
from tsd_twin.cli.experiment import Experiment, Output
from tsd_twin.errors import TwinError


def run_experiments(parser: argparse.ArgumentParser, experiments: Sequence[Experiment]) -> None:
    """Add a subcommand for each experiment to a parser, read the flags, and run one."""
    commands = parser.add_subparsers(metavar="EXPERIMENT", required=True)
    for each in experiments:
        purpose, settings = each.purpose, program.with_examples(each.examples)
        own = commands.add_parser(each.name, help=purpose, description=purpose, **settings)
        each.add_flags(own)
        flags.add(own, "--out", "default lab", Path, Path("lab"), "FOLDER")
        own.add_argument("--quiet", action="store_true", help="show no progress")
        own.set_defaults(experiment=each)
    program.run(parser, _experiment)


def _experiment(args: argparse.Namespace) -> None:
    """Run one experiment; print its results and the files it wrote."""
    out = Output(args.out, quiet=args.quiet)
    try:
        lines = args.experiment.run(args, out)
    except KeyboardInterrupt:
        raise TwinError("interrupted, nothing is complete") from None
    for line in lines:
        print(line)  # noqa: T201
    for path in out.written:
        print(f"wrote {path}")  # noqa: T201
