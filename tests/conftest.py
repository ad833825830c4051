"""Fixtures and hooks shared by all tests."""

from __future__ import annotations

import gc
import os
from collections.abc import Generator
from pathlib import Path

import pytest
from hypothesis import settings
from pytest_timeout import Settings, timeout_sigalrm

from tests.marks import WRITTEN, all_marks, may_choose, possible_marks
from tests.slow_tests import is_long, listed, name_of, shared
from tests.support.robot_node import QUICK, RunningNode, running
from tests.support.withheld import WithheldTime, budget
from tests.text_tests import NonsenseRun
from tests.time_limits import TimeLimit
from tsd_twin.messages import codes

settings.register_profile("unhurried", deadline=None)  # A slow run is not a failure.
settings.load_profile("unhurried")

codes.checks = True  # A reason with a wrong parameter fails the test that makes it.


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add `--nonsense`, which shows the tests that depend on texts."""
    parser.addoption(
        "--nonsense", action="store_true", help="replace the sentence of every code by nonsense"
    )


def pytest_configure(config: pytest.Config) -> None:
    """With `--nonsense`, only tests of texts may fail, because no program parses sentences."""
    if config.getoption("nonsense"):
        config.pluginmanager.register(NonsenseRun())


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Skip files without selected tests, because importing all takes 10 s."""
    expression = config.getoption("markexpr")
    if not expression or not collection_path.match("test_*.py"):
        return None
    return None if may_choose(expression, collection_path) else True


@pytest.hookimpl(tryfirst=True)  # Before pytest selects tests by marks.
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run quick tests before those that start processes, so that errors show early."""
    slow = listed()
    for item in items:
        written = frozenset(mark for mark in WRITTEN if item.get_closest_marker(mark))
        marks = all_marks(item.path, written)
        if marks not in possible_marks(item.path):
            raise pytest.UsageError(f"{item.nodeid} has marks that its file does not write")
        for mark in sorted(marks - written):
            item.add_marker(mark)
        if "timed" not in marks and name_of(item.nodeid) in slow:
            item.add_marker("slow")
            if name_of(item.nodeid) in shared():
                item.add_marker("shared")
        if is_long(item.nodeid):
            item.add_marker("long")
    items.sort(key=_order)


def pytest_collection_finish() -> None:
    """Exclude loaded objects from garbage collection, which took 6 % of a run."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    """Add the CPU time withheld from its processes to each failure of a real-time test."""
    if item.get_closest_marker("timed") is None:
        return (yield)
    with WithheldTime(os.getpid()):
        return (yield)


@pytest.hookimpl(optionalhook=True)
def pytest_timeout_set_timer(item: pytest.Item, settings: Settings) -> bool:
    """Exclude withheld CPU time from the time limit of a test."""
    limit = TimeLimit(
        settings.timeout,
        lambda: timeout_sigalrm(item, settings),
        waits=item.get_closest_marker("timed") is not None,
    )
    item.cancel_timeout = limit.cancel  # type: ignore[attr-defined]
    return True


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print the CPU time withheld from the processes under test."""
    for line in budget.lines():
        terminalreporter.write_line(line)
    if budget.excess:
        terminalreporter.write_line(f"FAILED: {budget.excess}", red=True)


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail a run if too much CPU time was withheld to judge the results."""
    if budget.excess:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def _order(item: pytest.Item) -> bool:
    """Sort key: quick tests first."""
    return item.get_closest_marker("system") is not None


@pytest.fixture
def node() -> Generator[RunningNode]:
    """A robot node with a simulated robot, listening at `node.endpoint`.

    It accepts commands up to 1 s old, so that a busy machine does not stop it.
    """
    with running() as it:
        yield it


@pytest.fixture
def quick_node() -> Generator[RunningNode]:
    """One with the shipped command timeout."""
    with running(toml=QUICK) as it:
        yield it
