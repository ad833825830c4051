"""Runs of scripts as a user starts them, beside other tests that want the processor."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import tsd_twin
from tests.app.conftest import HELD_UP, Program, reset_if_held_up

PATIENCE_S = 90.0
_GOES = 3
_STARVED = re.compile(
    rf"(RobotStopped: .* stopped by itself|RobotSilent): |{HELD_UP}|commands came too late"
)


@contextmanager
def mock_endpoint() -> Generator[str]:
    """Endpoint of a mock that scripts drive, one after the other."""
    mock = Program(["tsd_mock", "--listen", "tcp/127.0.0.1:0"])
    try:
        yield mock.ready().split()[-1]
    finally:
        mock.end()
        mock.clean_up()


def run_script(script: Path, folder: Path, *arguments: str, endpoint: str = "") -> str:
    """Run a script with `folder` as its working directory; return what it prints.

    A robot stops by itself when a script gets no processor for 0.2 s, and the script ends with that
    error. Beside other tests it may happen once or twice, and the script has another go; any other
    error is one of the script. The robot there that was held up itself is in a fault, and is reset.
    """
    for _ in range(_GOES):
        if endpoint:
            reset_if_held_up(endpoint)
        done = subprocess.run(
            [sys.executable, str(script), *arguments],
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
        )
        if done.returncode == 0 or not _STARVED.search(done.stderr):
            break
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
    """Drive a robot; another time when it stopped by itself, as above, or was held up itself."""
    for left in reversed(range(_GOES)):
        try:
            with (
                tsd_twin.connect(endpoint) as robot,
                robot.control(operator, take_over=left < _GOES - 1) as base,
            ):
                base.drive(
                    vx_mps=vx_mps,
                    vy_mps=vy_mps,
                    omega_rad_per_s=omega_rad_per_s,
                    duration_s=duration_s,
                )
        except tsd_twin.ClientError as error:
            starved = isinstance(error, tsd_twin.RobotStopped | tsd_twin.RobotSilent)
            if not left or not (reset_if_held_up(endpoint) or starved):
                raise
        else:
            return
