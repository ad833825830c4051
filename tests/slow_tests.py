"""Tests that only compute, and long: `make quick` leaves them out.

`python -m tests.slow_tests` runs all tests that only compute, which takes minutes, and
writes the list from their durations.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections import Counter
from functools import cache
from pathlib import Path

TESTS = Path(__file__).parent
FILE = TESTS / "slow_tests.txt"
LONG_FILE = TESTS / "long_tests.txt"
"""Tests or test cases for `make test-long`: more cases of the same laws, and tests that take more
than about five seconds of processor time."""
SHARED_FOLDERS = ("firmware", "lab", "research")
"""Their slow tests run with the quick ones, so that both runs of what computes take as long."""
LIMIT_S = 0.5
"""Beyond this a test is slow, all its cases together."""
_DURATION = re.compile(r"^([\d.]+)s (?:setup|call|teardown) +tests/([^\[\s]+)", re.MULTILINE)


@cache
def listed() -> frozenset[str]:
    """Return the slow tests, as `folder/file::test`."""
    return frozenset(FILE.read_text("ascii").split())


@cache
def shared() -> frozenset[str]:
    """Return the slow tests that run with the quick ones."""
    return frozenset(name for name in listed() if name.startswith(SHARED_FOLDERS))


@cache
def long_listed() -> frozenset[str]:
    """Return the long tests, as `folder/file::test` or `folder/file::test[case]`."""
    return frozenset(LONG_FILE.read_text("utf-8").splitlines())


def is_long(node_id: str) -> bool:
    """Return whether a test, or one of its cases, is for `make test-long`."""
    case = node_id.removeprefix("tests/")
    return case in long_listed() or name_of(node_id) in long_listed()


def name_of(node_id: str) -> str:
    """Return the name under which a test is listed, whatever its case."""
    return node_id.split("[")[0].removeprefix("tests/")


def slow(report: str) -> list[str]:
    """Return the slow tests of the output of `pytest --durations=0`."""
    took_s: Counter[str] = Counter()
    for seconds, name in _DURATION.findall(report):
        took_s[name] += float(seconds)
    return sorted(name for name, seconds in took_s.items() if seconds > LIMIT_S)


def main() -> None:
    """Measure, and write the list."""
    command = [sys.executable, "-m", "pytest", "-m", "not timed", "--durations=0"]
    done = subprocess.run([*command, "--durations-min=0.005"], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(done.stdout + done.stderr)
    FILE.write_text("".join(f"{name}\n" for name in slow(done.stdout)), "ascii")


if __name__ == "__main__":
    main()
