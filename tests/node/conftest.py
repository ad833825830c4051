"""A robot on the bus, and somebody to drive it."""

from __future__ import annotations

from collections.abc import Generator

import pytest

from tests.support.bus_operator import BusOperator
from tests.support.robot_node import RunningNode


@pytest.fixture
def pilot(node: RunningNode) -> Generator[BusOperator]:
    """Somebody who has just opened a dashboard."""
    with BusOperator(node) as alice:
        yield alice
