"""What tests of several parts share."""

from __future__ import annotations

import gc
import os
from collections.abc import Generator
from pathlib import Path

import pytest
from hypothesis import settings
from pytest_timeout import Settings, timeout_sigalrm

from tests.support.marks import WRITTEN, all_marks, may_choose, possible_marks
from tests.support.robot_node import RunningNode, running
from tests.support.slow_tests import is_long, listed, name_of, shared
from tests.support.text_tests import NonsenseRun
from tests.support.time_limits import TimeLimit
from tests.support.withheld import WithheldTime, budget
from tsd_twin.messages import codes

settings.register_profile("unhurried", deadline=None)  # A busy machine is no failure.
settings.load_profile("unhurried")

codes.checks = True  # A reason with a wrong parameter fails the test that makes it.


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option that shows which tests read sentences."""
    parser.addoption(
        "--nonsense", action="store_true", help="replace the sentence of every code by nonsense"
    )


def pytest_configure(config: pytest.Config) -> None:
    """With `--nonsense`, only tests of texts may fail: no program reads sentences."""
    if config.getoption("nonsense"):
        config.pluginmanager.register(NonsenseRun())


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Skip files none of whose tests the marks choose: to import all takes ten seconds."""
    expression = config.getoption("markexpr")
    if not expression or not collection_path.match("test_*.py"):
        return None
    return None if may_choose(expression, collection_path) else True


@pytest.hookimpl(tryfirst=True)  # Before tests are chosen by their marks.
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run what is quick before what starts processes: a mistake shows sooner."""
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
    """Take what is loaded now out of each search for garbage: that took 6 % of a run."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    """Let each failure of a test in real time say what the machine withheld from its processes."""
    if item.get_closest_marker("timed") is None:
        return (yield)
    with WithheldTime(os.getpid()):
        return (yield)


@pytest.hookimpl(optionalhook=True)
def pytest_timeout_set_timer(item: pytest.Item, settings: Settings) -> bool:
    """Count no time towards the limit of a test that the machine withheld from it."""
    limit = TimeLimit(
        settings.timeout,
        lambda: timeout_sigalrm(item, settings),
        waits=item.get_closest_marker("timed") is not None,
    )
    item.cancel_timeout = limit.cancel  # type: ignore[attr-defined]
    return True


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print for how long the machine withheld a processor from the processes under test."""
    for line in budget.lines():
        terminalreporter.write_line(line)
    if budget.excess:
        terminalreporter.write_line(f"FAILED: {budget.excess}", red=True)


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail a run in which the machine withheld too much time to judge."""
    if budget.excess:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def _order(item: pytest.Item) -> bool:
    """Sort key: quick tests first."""
    return item.get_closest_marker("system") is not None


@pytest.fixture
def node() -> Generator[RunningNode]:
    """A robot node with a simulated robot; `node.endpoint` says where it listens."""
    with running() as it:
        yield it
