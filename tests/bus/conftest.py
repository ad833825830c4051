"""Sessions on one machine."""

from __future__ import annotations

from collections.abc import Callable, Generator

import pytest

from tests.support.robot_node import ANY_PORT
from tests.support.withheld import PATIENCE_S
from tsd_twin.bus import Bus, client_config, node_config


@pytest.fixture
def robot() -> Generator[Bus]:
    """A listening session."""
    with Bus(node_config([ANY_PORT])) as bus:
        yield bus


@pytest.fixture
def connect(robot: Bus) -> Generator[Callable[[], Bus]]:
    """Return a function that opens sessions connected to it."""
    opened: list[Bus] = []

    def open_one() -> Bus:
        opened.append(Bus(client_config(robot.endpoints())))
        assert opened[-1].wait_for_peer(PATIENCE_S)
        return opened[-1]

    yield open_one
    for bus in opened:
        bus.close()
