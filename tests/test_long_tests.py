"""`make test-long` runs the tests that `make test` skips, and the list has no stale names."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.slow_tests import TESTS, is_long, long_listed, name_of
from tests.support.withheld import AS_OTHERS, PATIENCE_S


@pytest.mark.system
def test_every_line_of_the_list_names_a_test() -> None:
    files = sorted({str(TESTS / name.split("::")[0]) for name in long_listed()})
    flags = ["-q", "--collect-only", "-p", "no:cacheprovider", "-m", "long"]
    done = subprocess.run(
        [*AS_OTHERS, sys.executable, "-m", "pytest", *flags, *files],
        cwd=TESTS.parent, capture_output=True, text=True, timeout=PATIENCE_S,
    )  # fmt: skip
    found = {line.removeprefix("tests/") for line in done.stdout.splitlines() if "::" in line}
    assert found
    assert all(is_long(name) for name in found)
    assert long_listed() <= found | {name_of(name) for name in found}


def test_a_case_can_be_long_when_others_of_its_test_are_not() -> None:
    case = next(name for name in long_listed() if name.endswith("]"))
    assert is_long(f"tests/{case}")
    assert not is_long(f"tests/{name_of(case)}[another]")
