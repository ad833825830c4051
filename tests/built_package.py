"""Building the package, and programs that see nothing of the checkout."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from tests.support.withheld import AS_OTHERS, PATIENCE_S


def build(source: Path, target: str, into: Path) -> None:
    """Build a `wheel` or an `sdist` from a folder."""
    command = [*AS_OTHERS, sys.executable, "-m", "hatchling"]
    command += ["build", "-t", target, "-d", str(into)]
    subprocess.run(command, cwd=source, check=True, capture_output=True)


def outside_environment() -> dict[str, str]:
    """Environment variables without those that lead Python to the checkout."""
    return {name: text for name, text in os.environ.items() if not name.startswith("PYTHON")}


def run_outside(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a program in a folder, away from the checkout."""
    return subprocess.run(
        [*AS_OTHERS, *command],
        cwd=folder,
        env=outside_environment(),
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )


def pip_into(python: Path) -> list[str]:
    """Command of this environment's pip for another environment."""
    return [sys.executable, "-m", "pip", "--disable-pip-version-check", "--python", str(python)]
