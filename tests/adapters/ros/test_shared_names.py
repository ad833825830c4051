"""A ROS name used by two robots is detected in the graph."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest

from tsd_twin.adapters.ros.port import ADAPTER
from tsd_twin.adapters.ros.shared_names import CHECK_S, NameWatch, shared_name
from tsd_twin.adapters.ros.zenoh_port import QOS, Kind, RosNode, endpoints_key, node_of
from tsd_twin.adapters.ros_messages import RosMessage
from tsd_twin.adapters.ros_topics import RosNames
from tsd_twin.messages.codes import Code, because

ALONE, LEFT = RosNames("kiwi", shared=False), RosNames("left", shared=True)


@dataclass
class Graph:
    """Port that only provides the other nodes of a graph."""

    odom: list[str] = field(default_factory=list)
    cmd_vel: list[str] = field(default_factory=list)
    names: RosNames = ALONE

    def publishers(self, topic: str) -> list[str]:
        return self.odom if topic == self.names.topic("odom") else []

    def subscribers(self, topic: str) -> list[str]:
        return self.cmd_vel if topic == self.names.topic("cmd_vel") else []

    def wants(self, topic: str) -> bool:
        raise NotImplementedError(topic)

    def publish(self, message: RosMessage) -> None:
        raise NotImplementedError(message)

    def close(self) -> None:
        raise NotImplementedError


@pytest.mark.parametrize("names", [ALONE, LEFT])
@pytest.mark.parametrize(
    ("odom", "cmd_vel", "is_shown", "code", "node"),
    [
        ([], ["rviz", "rosbag2"], True, None, ""),
        (["cart"], [], True, Code.ROS_NAME_PUBLISHED, "cart"),
        (["tsd_ros"], ["tsd_ros", "tsd_ros_stamped"], True, Code.ROS_NAME_PUBLISHED, "tsd_ros"),
        ([], ["tsd_ros"], True, Code.ROS_NAME_READ, "tsd_ros"),
        ([], [], False, None, ""),
        (["cart"], ["cart"], False, None, ""),
        (["cart", "cart"], ["cart"], False, Code.ROS_NAME_PUBLISHED, "cart"),
        (["cart"], ["cart", "tsd_ros"], False, Code.ROS_NAME_READ, "tsd_ros"),
    ],
)
def test_second_robot_of_a_name_is_named(
    names: RosNames,
    odom: list[str],
    cmd_vel: list[str],
    is_shown: bool,
    code: Code | None,
    node: str,
) -> None:
    found = shared_name(Graph(odom, cmd_vel, names), names, is_shown=is_shown)
    if code is None:
        assert found is None
    else:
        topic = "odom" if code is Code.ROS_NAME_PUBLISHED else "cmd_vel"
        assert found == because(code, topic=names.topic(topic), node=node)


def test_the_fault_ends_when_the_other_robot_has_gone() -> None:
    graph = Graph(["cart"])
    watch = NameWatch(graph, ALONE, is_shown=True)
    assert watch.problem(0.0)
    graph.odom = []
    assert watch.problem(0.5 * CHECK_S), "the graph is not asked each time"
    assert not watch.problem(1.1 * CHECK_S)


def test_the_token_of_an_endpoint_has_its_node_and_is_in_the_key_of_its_topic() -> None:
    node = RosNode(7, "beef", ADAPTER.node, "/left")
    (row,) = (row for row in ADAPTER.published if row.name == "odom")
    token = node.endpoint_token(3, Kind.PUBLISHER, "/left/odom", row.type, "RIHS01_0", QOS[row.qos])
    assert node_of(token) == ("beef", "tsd_ros")
    pattern = endpoints_key(7, Kind.PUBLISHER, "/left/odom").split("/")
    parts = token.split("/")
    assert pattern[-1] == "**"
    assert all(each in ("*", part) for each, part in zip(pattern[:-1], parts, strict=False))
