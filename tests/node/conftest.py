"""A robot on the bus, and somebody to drive it."""

from __future__ import annotations

from collections.abc import Generator

import pytest

from tests.node.pilot import Pilot
from tests.running import RunningNode


@pytest.fixture
def pilot(node: RunningNode) -> Generator[Pilot]:
    """Somebody who has just opened a dashboard."""
    with Pilot(node) as alice:
        yield alice
