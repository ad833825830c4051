"""What tests of several parts share."""

from __future__ import annotations

from collections.abc import Generator

import pytest
from hypothesis import settings

from tests.running import RunningNode, running

settings.register_profile("unhurried", deadline=None)  # A busy machine is no failure.
settings.load_profile("unhurried")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run what is quick before what starts processes: a mistake shows sooner."""
    items.sort(key=lambda item: item.get_closest_marker("system") is not None)


@pytest.fixture
def node() -> Generator[RunningNode]:
    """A robot node with a simulated robot; `node.endpoint` says where it listens."""
    with running() as it:
        yield it
