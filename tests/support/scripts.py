"""Runs of the scripts of examples and docs, as a user starts them."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

PATIENCE_S = 90.0
_GOES = 3
_STARVED = re.compile(r"(RobotStopped: .* stopped by itself|RobotSilent): ")


def run_script(script: Path, folder: Path, *arguments: str) -> str:
    """Run a script with `folder` as its working directory; return what it prints.

    A robot stops by itself when a script gets no processor for 0.2 s, and the script ends with that
    error. Beside other tests it may happen once or twice, and the script has another go; any other
    error is one of the script.
    """
    for _ in range(_GOES):
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
