"""Every part of `make bench` runs: at its smallest size, since its figures are for people."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from pathlib import Path

import pytest

from bench.__main__ import PARTS

ROOT = Path(__file__).parents[2]
ROWS = {
    "kinematics": 2,
    "simulation": 7,
    "firmware": 4,
    "bus": 4,
    "bridge": 3,
    "dashboard": 4,
    "page": 2,
    "plots": 2,
    "start": 1,
    "idle": 2,
    "recording": 7,
    "seek": 5,
    "foxglove": 3,
    "ros": 3,
}
ROW = re.compile(r"^(\S.+?) +([-+.e\d]+) .*[<>]= .* (ok  |MISS)")
"""What is measured, how much, and whether that reaches what it is to reach."""
BUSY = {"firmware", "bridge", "page", "plots"}


@pytest.mark.system
@pytest.mark.parametrize(
    "part", [pytest.param(part, marks=[pytest.mark.busy] * (part in BUSY)) for part in PARTS]
)
def test_each_part_runs_at_its_smallest_size(part: str) -> None:
    command = [sys.executable, "-m", "bench", "--smallest", part]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=110)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    _head, *lines, end = done.stdout.splitlines()
    rows = [ROW.match(line) for line in lines]
    measured = [float(row[2]) for row in rows if row]
    assert len(measured) == len(lines) == ROWS[part], done.stdout
    assert all(map(math.isfinite, measured))
    assert end == "all met" or re.fullmatch(r"\d+ missed", end)
