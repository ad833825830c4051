"""A robot with ROS topics only, by nodes that are not ours (`zenoh-ros2-sdk`), for tests."""

from __future__ import annotations

import math
import struct
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import zenoh
import zenoh.ext

from tests.support.ros_nodes import STORE, TWIST, ForeignNode, foreign_hash, header, twist

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
    """Node of others that notes each `cmd_vel`."""

    def __init__(self, router: zenoh.Session, port: int) -> None:
        super().__init__(router, port)
        self.heard: list[tuple[float, float, float, float]] = []
        """Times, and twists."""

    def _take(self, topic: str, message: Any) -> None:
        super()._take(topic, message)
        linear, angular = message.linear, message.angular
        self.heard.append((time.monotonic(), linear.x, linear.y, angular.z))


class ForeignRobot:
    """Robot of others: follows `cmd_vel`, with a timeout of its own, and publishes odometry."""

    def __init__(self, router: zenoh.Session, port: int) -> None:
        self.node = Listener(router, port)
        self.pose = list(START)
        self.wheel_rad = 0.0
        self.silent = False
        """Whether it publishes no odometry."""
        self.heard = self.node.heard
        self.node.subscribe("/cmd_vel", TWIST)
        self._odom = self.node.publisher("/odom", ODOMETRY)
        self._joints = self.node.publisher("/joint_states", JOINTS)
        # As rmw_zenoh publishes what is transient local; the other implementation does not.
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
        """What it follows now."""
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
