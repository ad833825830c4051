"""A short `make soak` passes, and cannot pass if a process dies, grows or slows down."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable, Generator
from pathlib import Path

import psutil
import pytest

from bench.soak import SLACK_MB, Record, verdict
from tests.support.withheld import PATIENCE_S

ROOT = Path(__file__).parents[2]

Start = Callable[[int], subprocess.Popen[str]]


@pytest.fixture
def start() -> Generator[Start]:
    """Soak for some seconds, in a process that does not outlive the test."""
    started: list[subprocess.Popen[str]] = []

    def run(seconds: int) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "bench.soak", "--seconds", str(seconds)]
        pipe = subprocess.PIPE
        started.append(subprocess.Popen(command, cwd=ROOT, stdout=pipe, stderr=pipe, text=True))
        return started[-1]

    yield run
    for process in started:
        process.kill()  # Its children end with its standard input.
        process.communicate()


@pytest.mark.system
def test_a_short_one_passes(start: Start) -> None:
    soak = start(24)
    output, errors = soak.communicate(timeout=PATIENCE_S)
    assert soak.returncode == 0, output + errors
    assert output.count("  ok  ") == 5
    assert "Traceback" not in errors


@pytest.mark.system
@pytest.mark.parametrize("name", ["tsd-mock", "tsd-dashboard"])
def test_it_fails_when_one_is_killed_and_ends_the_other(start: Start, name: str) -> None:
    soak = start(600)
    assert soak.stdout is not None
    pids = dict(re.findall(r"(tsd-\w+) is (\d+)", soak.stdout.readline()))
    processes = {key: psutil.Process(int(pid)) for key, pid in pids.items()}
    processes[name].kill()
    _, errors = soak.communicate(timeout=PATIENCE_S)
    assert soak.returncode == 1
    assert f"cut short: {name} ended with -9" in errors
    assert len(processes) == 2
    assert not any(process.is_running() for process in processes.values())


WELL = {"connects_s": [0.1], "last_connects_s": [0.1], "drove": [True]}
WARM_UP = [100.0 + i for i in range(100)]


def missed(sizes_mb: list[float], **otherwise: list[float]) -> list[str]:
    """Names of the failed rows for a healthy record with some changes."""
    record = Record({"it": sizes_mb}, **{**WELL, **otherwise})
    return [row.what for row in verdict(record, 1 / 3) if not row.met]


def test_warming_up_is_no_growth() -> None:
    assert missed(WARM_UP + [200.0] * 200) == []


def test_a_peak_that_is_given_back_is_no_growth() -> None:
    assert missed(WARM_UP + [200.0] * 80 + [900.0] * 20 + [200.0] * 100) == []


def test_a_leak_is_growth() -> None:
    """Three quarters of a leak lie between the starts of the first and the last quarter."""
    for leaked_mb, caught in ((SLACK_MB * 1.4, ["it, growth"]), (SLACK_MB * 1.2, [])):
        assert missed(WARM_UP + [200.0 + leaked_mb * i / 200 for i in range(200)]) == caught


def test_a_page_that_opens_slowly_at_the_end_is_a_miss() -> None:
    slow = missed([200.0] * 300, last_connects_s=[0.1, 0.1, 1.1, 1.2, 1.3])
    assert slow == ["a page sees all there is, at the end"]


def test_a_robot_that_nobody_gets_to_drive_is_a_miss() -> None:
    assert missed([200.0] * 300, drove=[True, False]) == ["drivers who got to drive"]
