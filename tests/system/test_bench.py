"""Benchmarks: every part runs, ratios are judged per target and machine, machines compare."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from bench.__main__ import OVERLOADED, PARTS
from bench.table import BUSY, MAX_WITHHELD, MISS, OK, Row, Run, compare, write_json
from bench.targets import TARGETS
from tests.support.withheld import PATIENCE_S

ROOT = Path(__file__).parents[2]
HEAVY = {"firmware", "bridge", "page", "pictures", "plots", "response", "router", "fleet"}
NAME = "kinematics.single"
LIMIT = TARGETS[NAME].limit


def bench(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "bench", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S)


@pytest.mark.system
@pytest.mark.parametrize(
    "part", [pytest.param(part, marks=[pytest.mark.busy] * (part in HEAVY)) for part in PARTS]
)
def test_each_part_runs_at_its_smallest_size(part: str, tmp_path: Path) -> None:
    file = tmp_path / "rows.json"
    done = bench("--smallest", part, "--json", str(file))
    assert "Traceback" not in done.stderr, done.stderr
    assert done.returncode in (0, 1, OVERLOADED), done.stdout + done.stderr
    rows = json.loads(file.read_text())["rows"]
    assert [row["name"] for row in rows] == [name for name in TARGETS if _part(name) == part]
    assert all(0.0 < row["ratio"] < 1e4 for row in rows), rows


def _part(name: str) -> str:
    return name.partition(".")[0]


@pytest.mark.system
def test_a_single_row_is_chosen_by_name() -> None:
    done = bench("--smallest", NAME)
    assert re.findall(r"^kinematics\.\w+", done.stdout, re.MULTILINE) == [NAME]


@pytest.mark.system
def test_an_unknown_row_is_refused_with_the_known_ones() -> None:
    done = bench("kinematics.twice")
    assert done.returncode == 2
    assert NAME in done.stderr


@pytest.mark.system
def test_help_has_examples() -> None:
    assert "examples:" in bench("--help").stdout


def test_verdict_follows_the_median_ratio() -> None:
    """A single slow round of either side does not change it."""
    assert Row(NAME, [LIMIT, LIMIT, 90.0], [1.0, 1.0, 1.0]).verdict == OK
    assert Row(NAME, [LIMIT, 1.1 * LIMIT, 1.1 * LIMIT], [1.0, 1.0, 1.0]).verdict == MISS


def test_a_withheld_machine_is_not_judged() -> None:
    for subject in (0.5 * LIMIT, 2.0 * LIMIT):
        assert Row(NAME, [subject], [1.0], 1.01 * MAX_WITHHELD).verdict == BUSY


def test_subject_and_peer_alternate() -> None:
    calls: list[str] = []

    def measure(who: str) -> list[float]:
        calls.append(who)
        return [float(len(calls))]

    (row,) = Run().alternate([NAME], lambda: measure("A"), lambda: measure("B"), rounds=3)
    assert "".join(calls) == "ABABAB"
    assert row.ratios == [1 / 2, 3 / 4, 5 / 6]


@pytest.mark.system
def test_ratios_of_two_machines_agree_within_15_percent(tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("first.json", "second.json", "third.json")]
    for file, ratio in zip(files, (1.0, 1.14, 1.32), strict=True):
        write_json(file, {"python_ms": 10.0 * ratio}, [Row(NAME, [ratio], [1.0])])
    assert [agrees for _, agrees in compare(files[0], files[1])] == [True, True]
    assert [agrees for _, agrees in compare(files[1], files[2])] == [True, False]
    assert bench("--compare", *map(str, files[:2])).returncode == 0
    assert bench("--compare", *map(str, files[1:])).returncode == 1
