"""Tests of texts, listed in `tests/text_tests.txt`.

`pytest --nonsense` replaces the sentence of every code by nonsense, also in programs that tests
start. Then the listed tests fail and all others pass: no program reads sentences.
"""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

import pytest

from tests.slow_tests import TESTS, name_of
from tsd_twin.messages import sentences

FILE = TESTS / "text_tests.txt"


@cache
def listed() -> frozenset[str]:
    """Return the tests of texts, as `folder/file::test`."""
    return frozenset(FILE.read_text("ascii").split())


class NonsenseRun:
    """Plugin of a run with nonsense for sentences.

    Listed tests are expected to fail, each in at least one of its cases.
    """

    def __init__(self) -> None:
        self._failed: set[str] = set()
        self._passed: set[str] = set()
        sentences.replacement = lambda reason: f"Qx{len(reason.code)}zk"
        folder = str(Path(__file__).parent / "nonsense")
        others = os.environ.get("PYTHONPATH", "")
        os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (folder, others)))

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Expect the listed tests to fail."""
        for item in items:
            if name_of(item.nodeid) in listed():
                item.add_marker(pytest.mark.xfail(reason="tests a text"))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Count the listed tests that failed and those that passed."""
        if hasattr(report, "wasxfail") and (report.when == "call" or report.skipped):
            (self._failed if report.skipped else self._passed).add(name_of(report.nodeid))

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Name the listed tests that read no sentence."""
        for name in sorted(self._passed - self._failed):
            terminalreporter.write_line(f"{FILE.name} lists {name}, which reads no sentence")

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Fail if a listed test reads no sentence."""
        if self._passed - self._failed:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED
