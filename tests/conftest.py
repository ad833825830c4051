"""What tests of several parts share."""

from __future__ import annotations

from collections.abc import Generator

import pytest

from tests.running import RunningNode, running


@pytest.fixture
def node() -> Generator[RunningNode]:
    """A robot node with a simulated robot; `node.endpoint` says where it listens."""
    with running() as it:
        yield it
