"""Third-party ROS nodes and robot (`zenoh-ros2-sdk`), and a router like rmw_zenohd."""

from __future__ import annotations

import functools
import json
import math
import re
import struct
import threading
import time
from collections import Counter
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any

import numpy as np
import zenoh
import zenoh.ext
from rosbags.typesys import Stores, get_typestore
from zenoh_ros2_sdk.publisher import ROS2Publisher
from zenoh_ros2_sdk.qos import QosDurability, QosProfile
from zenoh_ros2_sdk.session import ZenohSession
from zenoh_ros2_sdk.subscriber import ROS2Subscriber
from zenoh_ros2_sdk.utils import compute_type_hash_from_msg

from tests.support.withheld import PATIENCE_S

STORE = get_typestore(Stores.ROS2_JAZZY)
TWIST, TWIST_STAMPED = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"
TRIGGER_HASH = "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f"
_GID = bytes(range(16))


@functools.cache
def definitions(type_name: str) -> tuple[str, dict[str, str]]:
    """Definitions of a type and its member types, as text."""
    whole = STORE.generate_msgdef(type_name, ros_version=2)[0]
    own, *others = re.split(r"={80}\nMSG: (\S+)\n", whole)
    names = [name.replace("/", "/msg/") if "/msg/" not in name else name for name in others[::2]]
    return own, dict(zip(names, others[1::2], strict=True))


def foreign_hash(type_name: str) -> str:
    """Hash of a type, computed by the third-party implementation."""
    return compute_type_hash_from_msg(type_name, *definitions(type_name))


@contextmanager
def ros_router() -> Generator[tuple[zenoh.Session, int]]:
    """Run a router like rmw_zenohd; yield its port."""
    config = zenoh.Config()
    for key, value in {
        "mode": "router",
        "listen/endpoints": ["tcp/127.0.0.1:0"],
        "scouting/multicast/enabled": False,
        "adminspace/enabled": True,
    }.items():
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config) as session:
        replies = session.get(f"@/{session.zid()}/router", timeout=5.0)
        found = [json.loads(each.ok.payload.to_string()) for each in replies if each.ok]
        yield session, int(found[0]["locators"][0].rpartition(":")[2])


def vector(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
    return STORE.types["geometry_msgs/msg/Vector3"](x, y, z)


def twist(vx_mps: float, vy_mps: float = 0.0, omega_rad_per_s: float = 0.0) -> Any:
    return STORE.types[TWIST](vector(vx_mps, vy_mps), vector(z=omega_rad_per_s))


def header(frame: str = "") -> Any:
    stamp = STORE.types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    return STORE.types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


class ForeignNode:
    """Third-party publishers and subscribers, with the latest messages."""

    def __init__(self, router: zenoh.Session, port: int, domain: int = 0) -> None:
        self.router = router
        self._domain = domain
        self._port = port
        self.newest: dict[str, Any] = {}
        self.counted: Counter[str] = Counter()
        self.said: list[str] = []
        self._parts: list[Any] = []
        self._sequence = 0

    def close(self) -> None:
        for part in self._parts:
            part.close()

    def leave(self) -> None:
        """Close the session that all nodes of a process share."""
        self.close()
        ZenohSession.get_instance("127.0.0.1", self._port).close()

    def publisher(self, topic: str, type_name: str) -> ROS2Publisher:
        made = ROS2Publisher(
            topic,
            type_name,
            self._whole(type_name),
            router_port=self._port,
            domain_id=self._domain,
            type_hash=foreign_hash(type_name),
        )
        self._parts.append(made)
        return made

    def subscribe(self, topic: str, type_name: str, *, latched: bool = False) -> None:
        durability = QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE
        self._parts.append(
            ROS2Subscriber(
                topic,
                type_name,
                functools.partial(self._take, topic),
                self._whole(type_name),
                router_port=self._port,
                domain_id=self._domain,
                type_hash=foreign_hash(type_name),
                qos=QosProfile(durability=durability),
            )
        )

    def _whole(self, type_name: str) -> str:
        return STORE.generate_msgdef(type_name, ros_version=2)[0]

    def _take(self, topic: str, message: Any) -> None:
        self.newest[topic] = message
        self.counted[topic] += 1
        if topic.endswith("/events"):
            self.said.append(message.msg)

    def until(self, condition: Callable[[], object], what: str) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end_s, f"{what}: {self.said}"
            assert "/status" not in self.newest or self.status["mode"] != "fault", self.said
            time.sleep(0.01)

    def until_all(self, *topics: str) -> None:
        self.until(lambda: all(self.counted[each] for each in topics), f"{topics}: {self.counted}")

    def tokens(self) -> list[str]:
        """Return all liveliness tokens of the graph, queried like a node."""
        found: list[str] = []
        complete = threading.Event()
        handler = zenoh.handlers.Callback(
            lambda reply: found.append(str(reply.ok.key_expr)), complete.set, indirect=False
        )
        self.router.liveliness().get(f"@ros2_lv/{self._domain}/**", handler, timeout=5.0)
        assert complete.wait(PATIENCE_S)
        return found

    def call(self, service: str) -> tuple[bool, str]:
        """Wait for a service, and call it like a client of rmw_zenoh."""
        (answer,) = self.call_all(service)
        return answer

    def call_all(self, service: str) -> list[tuple[bool, str]]:
        """Call a service of several adapters; return all responses."""
        end_s = time.monotonic() + PATIENCE_S
        while not (found := self._ask(service)):
            assert time.monotonic() < end_s, f"no {service}: {self.said}"
            time.sleep(0.1)
        return [self._answer(each) for each in found]

    def _answer(self, sample: zenoh.Sample) -> tuple[bool, str]:
        sequence, source_ns, _, echoed = struct.unpack("<qqB16s", sample.attachment.to_bytes())
        assert (sequence, echoed) == (self._sequence, _GID)
        assert abs(time.time_ns() - source_ns) < 10**9
        body = sample.payload.to_bytes()
        return bool(body[4]), body[12:-1].decode()

    def _ask(self, service: str) -> list[zenoh.Sample]:
        self._sequence += 1
        replies = self.router.get(
            f"{self._domain}/{service.strip('/')}/std_srvs::srv::dds_::Trigger_/{TRIGGER_HASH}",
            payload=b"\0\1\0\0\0",
            attachment=struct.pack("<qqB16s", self._sequence, time.time_ns(), 16, _GID),
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=PATIENCE_S,
        )
        return [reply.ok for reply in replies if reply.ok is not None]

    @property
    def x_m(self) -> float:
        return self.newest["/odom/truth"].pose.pose.position.x

    @property
    def odom(self) -> tuple[float, float, float]:
        pose = self.newest["/odom"].pose.pose
        heading = 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
        return pose.position.x, pose.position.y, heading

    @property
    def speed_mps(self) -> float:
        linear = self.newest["/odom/truth"].twist.twist.linear
        return math.hypot(linear.x, linear.y)

    @property
    def status(self) -> Any:
        return json.loads(self.newest["/status"].data)


ODOMETRY, JOINTS = "nav_msgs/msg/Odometry", "sensor_msgs/msg/JointState"
OWN_TIMEOUT_S = 0.5
PERIOD_S = 0.04
START = (3.0, -2.0, 0.5)
URDF = """<?xml version="1.0"?>
<robot name="cart">
  <material name="blue"><color rgba="0.16 0.36 0.62 1"/></material>
  <material name="black"><color rgba="0.12 0.12 0.13 1"/></material>
  <material name="orange"><color rgba="0.96 0.45 0.08 1"/></material>
  <link name="base_footprint"/>
  <link name="base_link">
    <visual>
      <origin xyz="0 0 0.1"/><geometry><box size="0.36 0.24 0.1"/></geometry>
      <material name="blue"/>
    </visual>
    <visual>
      <origin xyz="0.12 0 0.025"/><geometry><sphere radius="0.025"/></geometry>
      <material name="black"/>
    </visual>
    <visual><geometry><mesh filename="package://cart/logo.stl"/></geometry></visual>
  </link>
  <joint name="fixed" type="fixed">
    <parent link="base_footprint"/><child link="base_link"/>
  </joint>
  <link name="left">
    <visual>
      <geometry><cylinder radius="0.07" length="0.04"/></geometry><material name="black"/>
    </visual>
    <visual>
      <origin xyz="0.04 0 0.015"/><geometry><box size="0.03 0.02 0.02"/></geometry>
      <material name="orange"/>
    </visual>
  </link>
  <link name="right">
    <visual>
      <geometry><cylinder radius="0.07" length="0.04"/></geometry><material name="black"/>
    </visual>
    <visual>
      <origin xyz="0.04 0 -0.015"/><geometry><box size="0.03 0.02 0.02"/></geometry>
      <material name="orange"/>
    </visual>
  </link>
  <link name="mast">
    <visual>
      <origin xyz="0 0 0.1"/><geometry><box size="0.03 0.03 0.2"/></geometry>
    </visual>
    <visual>
      <origin xyz="0 0 0.22"/><geometry><cylinder radius="0.045" length="0.05"/></geometry>
      <material name="orange"/>
    </visual>
  </link>
  <joint name="left_wheel" type="continuous">
    <parent link="base_link"/><child link="left"/>
    <origin xyz="-0.06 0.145 0.07" rpy="-1.5707963 0 0"/><axis xyz="0 0 1"/>
  </joint>
  <joint name="right_wheel" type="continuous">
    <parent link="base_link"/><child link="right"/>
    <origin xyz="-0.06 -0.145 0.07" rpy="-1.5707963 0 0"/><axis xyz="0 0 1"/>
  </joint>
  <joint name="lift" type="prismatic">
    <parent link="base_link"/><child link="mast"/>
    <origin xyz="-0.05 0 0.15"/><axis xyz="0 0 1"/><limit lower="0" upper="0.2"/>
  </joint>
</robot>
"""


class Listener(ForeignNode):
    """Third-party node that records each `cmd_vel`."""

    def __init__(self, router: zenoh.Session, port: int) -> None:
        super().__init__(router, port)
        self.heard: list[tuple[float, float, float, float]] = []
        """Times and twists."""

    def _take(self, topic: str, message: Any) -> None:
        super()._take(topic, message)
        linear, angular = message.linear, message.angular
        self.heard.append((time.monotonic(), linear.x, linear.y, angular.z))


class ForeignRobot:
    """Third-party robot: follows `cmd_vel` with a timeout, and publishes odometry."""

    def __init__(self, router: zenoh.Session, port: int) -> None:
        self.node = Listener(router, port)
        self.pose = list(START)
        self.wheel_rad = 0.0
        self.silent = False
        """Whether odometry is paused."""
        self.heard = self.node.heard
        self.node.subscribe("/cmd_vel", TWIST)
        self._odom = self.node.publisher("/odom", ODOMETRY)
        self._joints = self.node.publisher("/joint_states", JOINTS)
        # Transient local as in rmw_zenoh, which the third-party implementation lacks.
        key = f"0/robot_description/std_msgs::msg::dds_::String_/{foreign_hash(STRING)}"
        self._description = zenoh.ext.declare_advanced_publisher(
            router, key, cache=zenoh.ext.CacheConfig(max_samples=1), publisher_detection=True
        )
        self._sequence = 0
        self.describe(URDF)
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def describe(self, text: str) -> None:
        self._sequence += 1
        message = STORE.types[STRING](data=text)
        self._description.put(
            bytes(STORE.serialize_cdr(message, STRING)),
            attachment=struct.pack("<qqB16s", self._sequence, time.time_ns(), 16, b"d" * 16),
        )

    def close(self) -> None:
        self._ending.set()
        self._thread.join()
        self.node.leave()

    @property
    def twist(self) -> tuple[float, float, float]:
        """Current twist command."""
        if not self.heard or time.monotonic() - self.heard[-1][0] > OWN_TIMEOUT_S:
            return 0.0, 0.0, 0.0
        return self.heard[-1][1:]

    def _run(self) -> None:
        while not self._ending.wait(PERIOD_S):
            vx, _, omega = self.twist
            x, y, heading = self.pose
            self.pose = [
                x + PERIOD_S * vx * math.cos(heading),
                y + PERIOD_S * vx * math.sin(heading),
                heading + PERIOD_S * omega,
            ]
            self.wheel_rad += PERIOD_S * vx / 0.07
            if not self.silent:
                self.publish()

    def publish(self) -> None:
        vx, _, omega = self.twist
        self.say_odom(*self.pose, vx, omega)
        self._joints.publish(
            header=header(),
            name=["left_wheel", "right_wheel", "elsewhere", "vx"],
            position=np.array([self.wheel_rad, self.wheel_rad, math.nan, 7.0]),
            velocity=np.empty(0),
            effort=np.empty(0),
        )

    def say_odom(
        self,
        x: float,
        y: float,
        heading: float,
        vx: float,
        omega: float,
        publisher: Any = None,
        length: float = 1.0,
    ) -> None:
        types = STORE.types
        turn = types["geometry_msgs/msg/Quaternion"](
            x=0.0, y=0.0, z=length * math.sin(0.5 * heading), w=length * math.cos(0.5 * heading)
        )
        pose = types["geometry_msgs/msg/Pose"](
            position=types["geometry_msgs/msg/Point"](x=x, y=y, z=0.0), orientation=turn
        )
        (publisher or self._odom).publish(
            header=header("odom"),
            child_frame_id="base_footprint",
            pose=types["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36)),
            twist=types["geometry_msgs/msg/TwistWithCovariance"](
                twist(vx, 0.0, omega), np.zeros(36)
            ),
        )

    def until(self, condition: Callable[[], object], what: str) -> None:
        self.node.until(condition, what)


STRING = "std_msgs/msg/String"
