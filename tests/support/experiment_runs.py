"""Runs of `tsd-lab` experiments in this process."""

from __future__ import annotations

import argparse
import csv
from pathlib import Path
from typing import NoReturn

import numpy as np

import tsd_lab
from research.__main__ import EXPERIMENTS as STUDIES
from tsd_twin.cli.experiment import Output
from tsd_twin.errors import TwinError
from tsd_twin.lie import Array


class _Parser(argparse.ArgumentParser):
    """Parser that raises errors instead of ending the process."""

    def error(self, message: str) -> NoReturn:
        raise TwinError(message)


def run(folder: Path, name: str, *flags: str) -> list[str]:
    """Run an experiment with command-line flags; it writes its files to `folder`."""
    (experiment,) = (each for each in (*tsd_lab.EXPERIMENTS, *STUDIES) if each.name == name)
    parser = _Parser()
    experiment.add_flags(parser)
    return experiment.run(parser.parse_args(flags), Output(folder, quiet=True))


def table(path: Path) -> dict[str, Array]:
    """Return the columns of a CSV file."""
    with path.open(newline="", encoding="utf-8") as file:
        names, *rows = csv.reader(file)
    return dict(zip(names, np.array(rows, dtype=float).T, strict=True))


def is_picture(path: Path, least_width: int = 800) -> bool:
    """Return whether a file is a PNG with a minimum width that is not blank."""
    data = path.read_bytes()
    width = int.from_bytes(data[16:20], "big")
    return data.startswith(b"\x89PNG") and width >= least_width and len(data) > 10_000
