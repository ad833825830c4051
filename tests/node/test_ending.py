"""Exclusive use of an id, and the state of a robot after its node ends."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from tests.support.bus_operator import BusOperator
from tests.support.robot_node import ANY_PORT, QUICK, URDF, RunningNode, running
from tests.support.withheld import PATIENCE_S
from tsd_twin import robots
from tsd_twin.bus import Bus, node_config
from tsd_twin.errors import BusError
from tsd_twin.lie import Array
from tsd_twin.messages.services import Description
from tsd_twin.node import RobotNode
from tsd_twin.simulation import SimRobot

ROBOT = robots.parse_description(QUICK, "tsd")
WHEELS = np.arange(9) % 3 == 2


class Recorder:
    """Joints that reach their setpoints at once and record them."""

    def __init__(self) -> None:
        self.written: list[Array] = []
        self.closed = 0
        self.broken = threading.Event()

    def read(self, now_s: float) -> Array:
        if self.broken.is_set():
            raise OSError("the device is gone")
        del now_s
        return np.where(WHEELS, np.nan, self.written[-1] if self.written else 0.0)

    def write(self, setpoint: Array, now_s: float) -> None:
        del now_s
        self.written.append(setpoint.copy())

    def hardware(self) -> Mapping[str, Any]:
        return {"kind": "recorder"}

    def close(self) -> None:
        self.closed += 1


@pytest.mark.parametrize("ends", ["told", "broken"])
def test_however_it_ends_the_joints_are_left_at_rest(ends: str) -> None:
    io = Recorder()
    with running(io=io) as node, BusOperator.blind(node) as pilot:
        pilot.get_ready()
        pilot.drive((1.0, 0.0, 0.0), until=lambda: pilot.odom.twist[0] > 0.9)
        assert io.written[-1].any()
        if ends == "told":
            node.stopping.set()
        else:
            io.broken.set()
    np.testing.assert_array_equal(io.written[-1], 0.0)
    assert np.abs(io.written[-2]).max() > 100.0  # It was driving until then.
    assert io.closed == 1
    assert str(node.failure) == ("None" if ends == "told" else "the device is gone")


def test_a_robot_that_nobody_simulates_has_no_truth() -> None:
    with running(io=Recorder()) as node, BusOperator.blind(node) as pilot:
        pilot.wait_for_news()
        assert "truth" not in pilot.newest
        assert pilot.status.hardware == {"kind": "recorder"}


def new_node(bus: Bus, robot_id: str) -> RobotNode:
    return RobotNode(bus, robot_id, ROBOT, SimRobot(ROBOT), Description(QUICK, URDF))


def test_a_second_robot_with_the_same_id_refuses_to_start(node: RunningNode) -> None:
    with pytest.raises(BusError, match="'tsd' is on the bus already"):
        new_node(node.bus, "tsd")
    with (
        Bus(node_config([ANY_PORT], [node.endpoint])) as other,
        pytest.raises(BusError, match="choose another"),
    ):
        new_node(other, "tsd")
    with node.client() as client, pytest.raises(BusError):
        new_node(client, "tsd")


def test_another_id_is_welcome_on_the_same_bus(node: RunningNode) -> None:
    with Bus(node_config([ANY_PORT], [node.endpoint])) as other:
        new_node(other, "tsd-2")
        assert sorted(other.living_tokens("twin/*/alive", PATIENCE_S)) == [
            "twin/tsd-2/alive",
            "twin/tsd/alive",
        ]


def test_an_id_is_free_again_when_its_robot_has_ended() -> None:
    with Bus(node_config([ANY_PORT])) as bus:
        for _ in range(2):
            stop = threading.Event()
            stop.set()
            new_node(bus, "tsd").run(stop)


@pytest.mark.parametrize("robot_id", ["", "A", "a/b", "*", "a\n", "x" * 33])
def test_an_id_that_cannot_be_a_key_is_refused(robot_id: str) -> None:
    with (
        Bus(node_config([ANY_PORT])) as bus,
        pytest.raises(BusError, match="cannot be an id"),
    ):
        new_node(bus, robot_id)
