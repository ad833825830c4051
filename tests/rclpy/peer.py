"""An rclpy node as a separate program: one JSON request and reply per line.

Like a user's program, it imports nothing from the package under test.
"""

from __future__ import annotations

import importlib
import json
import math
import sys
import threading
import time
from collections.abc import Mapping
from typing import Any

import rclpy
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

from tests.support.square_drive import SquareDrive

PATIENCE_S = 60.0
PERIOD_S = 0.05
_CART_S, _CART_TIMEOUT_S = 0.04, 0.5


def load(type_name: str) -> Any:
    package, kind, name = type_name.split("/")
    return getattr(importlib.import_module(f"{package}.{kind}"), name)


def plain(value: Any) -> Any:
    """Convert a message to JSON types."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):
        return list(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    return [plain(each) for each in value] if isinstance(value, (list, tuple)) else value


class Cart:
    """External robot that moves in a plane."""

    def __init__(self, node: Node, urdf: str) -> None:
        self.pose = [3.0, -2.0, 0.5]
        self.heard = 0
        self.silent = False
        self._last, self._last_s, self._wheel_rad = (0.0, 0.0), -math.inf, 0.0
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._description = node.create_publisher(String, "/robot_description", latched)
        self._description.publish(String(data=urdf))
        self._odom = node.create_publisher(Odometry, "/odom", 10)
        self._joints = node.create_publisher(JointState, "/joint_states", 10)
        node.create_subscription(Twist, "/cmd_vel", self._take, 1)
        node.create_timer(_CART_S, self._step)

    @property
    def twist(self) -> tuple[float, float]:
        """Current forward speed and turn rate."""
        return self._last if time.monotonic() - self._last_s < _CART_TIMEOUT_S else (0.0, 0.0)

    def _take(self, message: Twist) -> None:
        self.heard += 1
        self._last, self._last_s = (message.linear.x, message.angular.z), time.monotonic()

    def _step(self) -> None:
        (vx, omega), (x, y, heading) = self.twist, self.pose
        self.pose = [
            x + _CART_S * vx * math.cos(heading),
            y + _CART_S * vx * math.sin(heading),
            heading + _CART_S * omega,
        ]
        self._wheel_rad += _CART_S * vx / 0.07
        if self.silent:
            return
        odom = Odometry()
        odom.header.frame_id = "odom"
        odom.pose.pose.position.x, odom.pose.pose.position.y = self.pose[:2]
        odom.pose.pose.orientation.z = math.sin(0.5 * self.pose[2])
        odom.pose.pose.orientation.w = math.cos(0.5 * self.pose[2])
        odom.twist.twist.linear.x, odom.twist.twist.angular.z = vx, omega
        self._odom.publish(odom)
        self._joints.publish(JointState(name=["wheel"], position=[self._wheel_rad]))


class Peer:
    """Subscribers, publishers and clients of the node."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._newest: dict[str, Any] = {}
        self._said: list[str] = []
        self._publishers: dict[tuple[str, str], Any] = {}
        self._ending = threading.Event()
        self._pusher: threading.Thread | None = None

    def subscribe(self, topic: str, type_name: str, latched: bool = False) -> None:
        durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
        reliability = ReliabilityPolicy.RELIABLE if latched else ReliabilityPolicy.BEST_EFFORT
        qos = QoSProfile(depth=10, durability=durability, reliability=reliability)

        def take(message: Any) -> None:
            self._newest[topic] = message
            if topic == "/events":
                self._said.append(message.msg)

        self._node.create_subscription(load(type_name), topic, take, qos)

    def newest(self, topic: str) -> Any:
        return plain(self._newest.get(topic))

    def said(self) -> list[str]:
        return self._said

    def endpoints(self, topic: str) -> dict[str, list[list[str]]]:
        """Return node, type, reliability and durability of all endpoints of a topic."""
        node = self._node
        return {
            kind: [
                [
                    f"{each.node_namespace.rstrip('/')}/{each.node_name}",
                    each.topic_type,
                    each.qos_profile.reliability.name,
                    each.qos_profile.durability.name,
                ]
                for each in found
            ]
            for kind, found in (
                ("publishers", node.get_publishers_info_by_topic(topic)),
                ("subscriptions", node.get_subscriptions_info_by_topic(topic)),
            )
        }

    def services(self, node: str, namespace: str) -> list[str]:
        return [name for name, _ in self._node.get_service_names_and_types_by_node(node, namespace)]

    def call(self, name: str) -> tuple[bool, str]:
        client = self._node.create_client(Trigger, name)
        if not client.wait_for_service(PATIENCE_S):
            return False, "no such service"
        done = threading.Event()
        future = client.call_async(Trigger.Request())
        future.add_done_callback(lambda _: done.set())
        if not done.wait(PATIENCE_S):
            return False, "no answer"
        response = future.result()
        self._node.destroy_client(client)
        return response.success, response.message

    def push(self, vx_mps: float, topic: str = "/cmd_vel", stamped: bool = False) -> None:
        """Publish until `let_go`."""
        self.let_go()
        self._ending.clear()

        def run() -> None:
            while not self._ending.wait(PERIOD_S):
                self._publish(topic, (vx_mps, 0.0, 0.0), stamped)

        self._pusher = threading.Thread(target=run, daemon=True)
        self._pusher.start()

    def let_go(self, withdraw: bool = False) -> None:
        """Stop publishing; `withdraw` also destroys the publishers."""
        self._ending.set()
        if self._pusher is not None:
            self._pusher.join()
        if withdraw:
            for each in self._publishers.values():
                self._node.destroy_publisher(each)
            self._publishers.clear()

    def square(self, side_m: float, speed_mps: float) -> float:
        """Drive a square by odometry alone, and return the path length."""
        drive, end_s = SquareDrive(side_m, speed_mps), time.monotonic() + PATIENCE_S
        while (twist := drive.twist(*self._pose())) is not None:
            if time.monotonic() > end_s:
                raise TimeoutError(f"the square does not end; now at {self._pose()}")
            self._publish("/cmd_vel", twist, False)
            time.sleep(PERIOD_S)
        self._publish("/cmd_vel", (0.0, 0.0, 0.0), False)
        return drive.path_m

    def cart(self, urdf: str) -> None:
        """Simulate a robot with two wheels that follows `cmd_vel`, with a command timeout."""
        self._cart = Cart(self._node, urdf)

    def cart_at(self) -> dict[str, Any]:
        """Return pose and twist of the cart, and the number of received `cmd_vel`."""
        cart = self._cart
        return {"pose": cart.pose, "twist": cart.twist, "heard": cart.heard}

    def cart_silent(self, silent: bool) -> None:
        """Pause or resume the odometry."""
        self._cart.silent = silent

    def _pose(self) -> tuple[float, float, float]:
        pose = self._newest["/odom"].pose.pose
        heading = 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
        return pose.position.x, pose.position.y, heading

    def _publish(self, topic: str, twist: tuple[float, float, float], stamped: bool) -> None:
        message: Any = Twist()
        message.linear.x, message.linear.y, message.angular.z = map(float, twist)
        if stamped:
            message = TwistStamped(twist=message)
            message.header.frame_id = "base_link"
        kind = type(message)
        key = (topic, kind.__name__)
        if key not in self._publishers:
            self._publishers[key] = self._node.create_publisher(kind, topic, 10)
        self._publishers[key].publish(message)


def say(answer: Any) -> None:
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()


def main() -> None:
    rclpy.init(args=[])
    node = rclpy.create_node(sys.argv[1])
    peer = Peer(node)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    threading.Thread(target=executor.spin, daemon=True).start()
    say("ready")
    for line in sys.stdin:
        request: Mapping[str, Any] = json.loads(line)
        try:
            answer = {"value": getattr(peer, request["do"])(**request["with"])}
        except Exception as error:
            answer = {"error": f"{type(error).__name__}: {error}"}
        say(answer)
    rclpy.shutdown()


if __name__ == "__main__":
    main()
