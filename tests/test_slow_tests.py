"""`make quick` skips the tests listed as slow, and the list has no stale names."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.slow_tests import LIMIT_S, TESTS, listed, name_of, slow
from tests.support.withheld import AS_OTHERS, PATIENCE_S


@pytest.mark.parametrize("file", sorted({name.split("::")[0] for name in listed()}))
def test_every_listed_test_is_there(file: str) -> None:
    text = (TESTS / file).read_text("utf-8")
    names = [name.split("::")[-1] for name in listed() if name.startswith(f"{file}::")]
    # Hypothesis names the test of a state machine after its class.
    missing = [name for name in names if f"def {name}(" not in text and name != "runTest"]
    assert not missing


def test_the_cases_of_a_test_are_added_up() -> None:
    half = 0.6 * LIMIT_S
    report = (
        f"{half:.2f}s call     tests/a/test_b.py::test_long[1]\n"
        f"{half:.2f}s setup    tests/a/test_b.py::test_long[2]\n"
        f"{half:.2f}s call     tests/a/test_b.py::test_short[x y]\n"
    )
    assert slow(report) == ["a/test_b.py::test_long"]
    assert name_of("tests/a/test_b.py::test_long[1]") == "a/test_b.py::test_long"


@pytest.mark.system
def test_they_are_deselected_by_their_mark() -> None:
    file = Path("tests") / min(listed()).split("::")[0]
    flags = ["-q", "--collect-only", "-p", "no:cacheprovider", "-m", "slow"]
    done = subprocess.run(
        [*AS_OTHERS, sys.executable, "-m", "pytest", *flags, str(file)],
        cwd=TESTS.parent, capture_output=True, text=True, timeout=PATIENCE_S,
    )  # fmt: skip
    found = {name_of(line) for line in done.stdout.splitlines() if "::" in line}
    assert found == {name for name in listed() if name.startswith(f"{name_of(str(file))}::")}
