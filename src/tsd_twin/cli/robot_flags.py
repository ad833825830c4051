"""Flags of programs that load robot descriptions; others need not import the robots for theirs."""

from __future__ import annotations

import argparse

from tsd_twin import robots
from tsd_twin.cli import flags
from tsd_twin.simulation import PLANTS


def add_robot_flags(made: argparse.ArgumentParser, *, several: bool = False) -> None:
    """Add `--robot`, a list when there may be `several`, and `--id`."""
    shipped = ", ".join(robots.robot_names())
    text = f"a shipped robot ({shipped}) or a TOML file of yours; default tsd"
    usual = None if several else "tsd"
    flags.add(made, "--robot", text, default=usual, metavar="NAME|FILE", repeated=several)
    made.add_argument("--id", help="id on the bus, 1 to 32 of a-z 0-9 _ -; default: its name")


def add_errors_flag(made: argparse.ArgumentParser, default: float = 0.0) -> None:
    """Add `--errors`."""
    text = "factor on [errors], the model errors of a built robot"
    flags.add(made, "--errors", text, flags.SCALE, default, "SCALE")


def add_plant_flag(made: argparse.ArgumentParser) -> None:
    """Add `--plant`."""
    text = (
        "plant: rolling by the equations (default), or rigid bodies in MuJoCo, "
        "for which the extra `mujoco` must be installed"
    )
    flags.add(made, "--plant", text, default="kinematic", choices=sorted(PLANTS))
