"""A robot on the bus and an operator."""

from __future__ import annotations

from collections.abc import Generator

import pytest

from tests.support.bus_operator import BusOperator
from tests.support.robot_node import RunningNode
from tests.support.virtual_time import VirtualClock


@pytest.fixture
def pilot(node: RunningNode) -> Generator[BusOperator]:
    """An operator who has just opened a dashboard."""
    with BusOperator(node) as alice:
        yield alice


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> VirtualClock:
    return VirtualClock(monkeypatch)
