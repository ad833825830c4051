"""Runs of scripts as a user starts them."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import tsd_twin
from tests.app.conftest import Program
from tests.support.robot_node import patient_robot

PATIENCE_S = 90.0


@contextmanager
def mock_robot(*, shipped: bool = False) -> Generator[Program]:
    """A mock that scripts drive, one after the other; only the shipped robot stops at delays."""
    flags = [] if shipped else patient_robot()
    mock = Program(["tsd_mock", "--listen", "tcp/127.0.0.1:0", *flags])
    try:
        mock.ready()
        yield mock
    finally:
        mock.end()
        mock.clean_up()


def run_script(script: Path, folder: Path, *arguments: str) -> str:
    """Run a script with `folder` as its working directory; return its output."""
    done = subprocess.run(
        [sys.executable, str(script), *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""
    return done.stdout


def drive(
    endpoint: str,
    *,
    vx_mps: float,
    vy_mps: float = 0.0,
    omega_rad_per_s: float = 0.0,
    duration_s: float,
    operator: str = "script",
) -> None:
    """Drive a robot for a time."""
    with tsd_twin.connect(endpoint) as robot, robot.control(operator) as base:
        base.drive(
            vx_mps=vx_mps,
            vy_mps=vy_mps,
            omega_rad_per_s=omega_rad_per_s,
            duration_s=duration_s,
        )
