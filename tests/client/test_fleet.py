"""Several robots on a bus: find, select and stop them; replays are not robots."""

from __future__ import annotations

import asyncio
from collections.abc import Generator
from pathlib import Path

import pytest

import tsd_twin
from tests.support.bus_operator import BusOperator
from tests.support.recorded_drives import replaying, stopped_drive
from tests.support.robot_node import RunningNode, running
from tests.support.withheld import PATIENCE_S
from tsd_twin.bus import Bus, client_config
from tsd_twin.messages import topics

pytestmark = pytest.mark.timed
NOWHERE = "tcp/127.0.0.1:1"


@pytest.fixture
def replay(node: RunningNode, tmp_path: Path) -> Generator[None]:
    """A replay on the bus of the robot `tsd`."""
    recorded = stopped_drive(tmp_path / "drive.mcap")
    with Bus(client_config([node.endpoint])) as bus:
        assert bus.wait_for_peer(PATIENCE_S)
        with replaying(bus, recorded, "yesterday"):
            yield


@pytest.mark.usefixtures("replay")
def test_a_replay_is_neither_found_nor_connected_nor_stopped(
    node: RunningNode,
) -> None:
    assert tsd_twin.find(node.endpoint) == ["tsd"]
    with tsd_twin.connect(node.endpoint) as robot:
        assert robot.id == "tsd"
    assert tsd_twin.stop_all(node.endpoint, reason="a test") == ["tsd"]
    with tsd_twin.connect(node.endpoint, robot="yesterday") as robot:  # It can be read by name.
        assert robot.state.status.is_recording


def test_a_replay_alone_is_no_robot(tmp_path: Path) -> None:
    recorded = stopped_drive(tmp_path / "drive.mcap")
    with running("other") as node, replaying(node.bus, recorded, "yesterday"):
        node.stopping.set()
        while tsd_twin.find(node.endpoint):
            pass
        with pytest.raises(tsd_twin.NoRobotFound, match="yesterday is a recording"):
            tsd_twin.connect(node.endpoint)
        with pytest.raises(tsd_twin.NoRobotFound, match="no robot to stop"):
            tsd_twin.stop_all(node.endpoint)


def test_stop_all_stops_each_robot_also_two_with_one_id() -> None:
    with running("tsd") as first, running("tsd") as second, running("left") as third:
        endpoints = [node.endpoint for node in (first, second, third)]
        with BusOperator(first) as alice, BusOperator(second) as bob:
            alice.get_ready()
            bob.get_ready()
            assert asyncio.run(tsd_twin.find_async(endpoints)) == ["left", "tsd"]
            assert asyncio.run(tsd_twin.stop_all_async(endpoints)) == ["left", "tsd"]
            for pilot in (alice, bob):
                pilot.wait_for("stopped")


def test_robots_and_endpoints_that_do_not_confirm_are_named(node: RunningNode) -> None:
    node.bus.declare_token(topics.instance_key("tsd", "f" * 16))  # A silent robot with the same id.
    with pytest.raises(tsd_twin.StopNotConfirmed, match=f"stop of {NOWHERE}, tsd:") as caught:
        tsd_twin.stop_all([NOWHERE, node.endpoint])
    assert caught.value.robots == (NOWHERE, "tsd")
    with BusOperator(node) as alice:
        alice.wait_until(lambda: alice.status.mode in ("stopped", "fault"))
