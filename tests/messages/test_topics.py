"""The table of topics: keys, and ids allowed in them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.errors import BusError
from tsd_twin.messages import topics
from tsd_twin.messages.topics import Service

ids = st.text("abcdefghijklmnopqrstuvwxyz0123456789_-", min_size=1, max_size=32)


def test_keys_are_those_that_other_programs_rely_on() -> None:
    assert {topic.key("r1"): topic.type for topic in topics.TOPICS} == {
        "twin/r1/cmd/*/twist": "geometry_msgs/msg/TwistStamped",
        "twin/r1/sensor/pose": "geometry_msgs/msg/PoseStamped",
        "twin/r1/stop": "json",
        "twin/r1/state/joints": "sensor_msgs/msg/JointState",
        "twin/r1/state/setpoint": "sensor_msgs/msg/JointState",
        "twin/r1/state/odom": "nav_msgs/msg/Odometry",
        "twin/r1/state/odom_alternative": "nav_msgs/msg/Odometry",
        "twin/r1/state/truth": "nav_msgs/msg/Odometry",
        "twin/r1/state/status": "json",
        "twin/r1/state/summary": "msgpack",
        "twin/r1/event/*": "json",
        "twin/r1/log/inputs": "msgpack",
    }
    assert {service.key("r1") for service in Service} == {
        "twin/r1/srv/lease",
        "twin/r1/srv/arm",
        "twin/r1/srv/disarm",
        "twin/r1/srv/reset",
        "twin/r1/srv/set_pose",
        "twin/r1/srv/speed",
        "twin/r1/stop",
        "twin/r1/desc",
    }
    assert topics.twist_key("r1", "alice") == "twin/r1/cmd/alice/twist"
    assert topics.event_key("r1", "mode") == "twin/r1/event/mode"
    assert topics.alive_key("r1") == "twin/r1/alive"
    assert topics.alive_key("*") == "twin/*/alive"
    assert topics.instance_key("r1", "0af") == "twin/r1/instance/0af"
    assert topics.instance_key("*", "*") == "twin/*/instance/*"


@given(robot=ids, operator=ids)
def test_the_robot_is_found_in_any_key(robot: str, operator: str) -> None:
    keys = [topic.key(robot) for topic in topics.TOPICS]
    keys += [service.key(robot) for service in Service]
    keys += [topics.twist_key(robot, operator), topics.alive_key(robot)]
    assert {topics.robot_of(key) for key in keys} == {robot}


@pytest.mark.parametrize(
    "name", ["", "a" * 33, "A", "a b", "a/b", "a*", "**", "$*", "é", "a\n", "\n", "a\0", "@a", "a#"]
)
def test_what_cannot_be_an_id_never_becomes_part_of_a_key(name: str) -> None:
    makers = (
        topics.checked,
        topics.alive_key,
        topics.ODOM.key,
        Service.ARM.key,
        lambda n: topics.twist_key("r1", n),
        lambda n: topics.twist_key(n, "alice"),
        lambda n: topics.event_key("r1", n),
    )
    for make in makers:
        with pytest.raises(BusError):
            make(name)


@pytest.mark.parametrize("key", ["", "twin", "twin/r1", "other/r1/alive", "/twin/r1/alive"])
def test_other_keys_have_no_robot(key: str) -> None:
    with pytest.raises(BusError, match="not below twin"):
        topics.robot_of(key)


@pytest.mark.parametrize("robot", ["*", "**", "R1", "", "r1\n"])
def test_a_key_of_no_robot_in_particular_has_none_either(robot: str) -> None:
    with pytest.raises(BusError, match="cannot be an id"):
        topics.robot_of(f"twin/{robot}/alive")
