"""What tests of several parts share."""

from __future__ import annotations

from collections.abc import Generator

import pytest
from hypothesis import settings

from tests.support.robot_node import RunningNode, running
from tests.support.slow_tests import TESTS, listed, name_of

settings.register_profile("unhurried", deadline=None)  # A busy machine is no failure.
settings.load_profile("unhurried")

TIMED = {"app", "bus", "dashboard", "hardware", "link_emulation", "node", "system"}
"""Folders of tests in which threads, sockets or robots take real time; what is marked `computes`
there is an exception."""


@pytest.hookimpl(tryfirst=True)  # Before tests are chosen by their marks.
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run what is quick before what starts processes: a mistake shows sooner."""
    slow = listed()
    for item in items:
        folders = item.path.relative_to(TESTS).parts[:-1]
        timed = not TIMED.isdisjoint(folders) and not item.get_closest_marker("computes")
        if timed or item.get_closest_marker("system"):
            item.add_marker("timed")
            if "app" in folders and not item.get_closest_marker("busy"):
                item.add_marker("programs")
        elif name_of(item.nodeid) in slow:
            item.add_marker("slow")
    items.sort(key=_order)


def _order(item: pytest.Item) -> bool:
    """Sort key: quick tests first."""
    return item.get_closest_marker("system") is not None


@pytest.fixture
def node() -> Generator[RunningNode]:
    """A robot node with a simulated robot; `node.endpoint` says where it listens."""
    with running() as it:
        yield it
