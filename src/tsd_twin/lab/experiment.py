"""What an experiment is to the program that runs it."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from tsd_twin.lab.output import Output


def _no_flags(_parser: argparse.ArgumentParser) -> None:
    """Add nothing."""


@dataclass(frozen=True, slots=True)
class Experiment:
    """One subcommand of `tsd-lab`."""

    name: str
    purpose: str
    """One sentence, for the list and for its own help."""
    run: Callable[[argparse.Namespace, Output], list[str]]
    """Writes pictures and tables to the output; returns the lines to print."""
    examples: Sequence[str] = ()
    add_flags: Callable[[argparse.ArgumentParser], None] = _no_flags
