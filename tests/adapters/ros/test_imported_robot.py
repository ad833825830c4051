"""An external ROS robot in virtual time: age of its odometry, and its `cmd_vel`."""

from __future__ import annotations

import numpy as np
import pytest

from tsd_twin import robots
from tsd_twin.adapters.ros.arrivals import Origin
from tsd_twin.adapters.ros.external_robot import (
    HELD_S,
    SEND_EVERY_S,
    ZEROS,
    ExternalLimits,
    ExternalRobot,
    describe,
)
from tsd_twin.adapters.ros.port import UNKNOWN_PUBLISHER
from tsd_twin.adapters.ros_messages import RosMessage
from tsd_twin.adapters.ros_topics import ODOMETRY, RosNames
from tsd_twin.control import LoggedController
from tsd_twin.control.logged_controller import load_state
from tsd_twin.lie import Array
from tsd_twin.messages.cdr import Odometry, encode_odometry
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.ros_types import decode_cdr
from tsd_twin.robots import ExternalDescription
from tsd_twin.safety import Heartbeat

TIMEOUT_S = 0.5
PERIOD_S = 0.01


class Outbox:
    """Port that stores its messages."""

    def __init__(self) -> None:
        self.sent: list[float] = []
        self.readers: list[str] = []

    def wants(self, topic: str) -> bool:
        return bool(topic)

    def publish(self, message: RosMessage) -> None:
        self.sent.append(decode_cdr(message.payload, message.topic.type).linear.x)

    def publishers(self, topic: str) -> list[str]:
        return ["cart"] if topic == "/odom" else []

    def subscribers(self, topic: str) -> list[str]:
        return [*self.readers, "cart"] if topic == "/cmd_vel" else []

    def close(self) -> None:
        self.sent.append(0.0)


class Cart:
    """External robot with a manually advanced clock."""

    def __init__(self, port: Outbox) -> None:
        self.now_s = 100.0
        self.robot = ExternalRobot(
            lambda _: port,
            RosNames("", shared=False),
            TIMEOUT_S,
            description_s=0.0,
            clock=lambda: self.now_s,
        )
        text = describe("cart", self.robot.urdf, ExternalLimits())
        robot = robots.parse_description(text, "cart")
        assert isinstance(robot, ExternalDescription)
        self.robot.configure(robot)

    def say(self, number: int, late_s: float = 0.0, publisher: bytes = b"a") -> None:
        """Deliver odometry that was sent some time ago, by a clock with the same rate."""
        square = np.zeros((3, 3))
        x = np.array([float(number), 0.0, 0.0])
        payload = encode_odometry(Odometry(x, np.zeros(3), square, square))
        sent_ns = round((5000.0 + self.now_s - late_s) * 1e9)
        self.robot.on_message(ODOMETRY, ODOMETRY.type, payload, Origin(publisher, number, sent_ns))

    def x_m(self) -> float | None:
        measured: Array | None = self.robot.read(self.now_s)
        return None if measured is None else float(measured[2])

    def fault(self) -> Reason | None:
        return self.robot.fault(self.now_s)


def test_odometry_counts_from_when_it_was_sent_and_once() -> None:
    cart = Cart(Outbox())
    assert cart.x_m() is None
    assert cart.fault() == because(Code.NO_ODOMETRY, topic="/odom")
    cart.say(1)
    cart.now_s += TIMEOUT_S
    assert cart.x_m() == 1.0
    assert cart.fault() is None
    # A duplicate, then a message delayed by a stalled link.
    cart.now_s += 0.1
    cart.say(1)
    cart.say(2, late_s=TIMEOUT_S + 0.2)
    assert cart.x_m() is None
    assert cart.fault() == because(Code.ODOMETRY_OLD, topic="/odom", s=0.5)
    cart.say(3)
    assert cart.x_m() == 3.0
    cart.now_s += TIMEOUT_S + 0.1
    assert cart.x_m() is None


def test_one_publisher_of_odometry_counts_until_it_is_silent() -> None:
    cart = Cart(Outbox())
    cart.say(1)
    cart.say(90, publisher=b"b")
    cart.say(91, publisher=UNKNOWN_PUBLISHER)
    assert cart.x_m() == 1.0
    cart.now_s += TIMEOUT_S + 0.1
    assert cart.x_m() is None
    cart.say(92, publisher=b"b")
    assert cart.x_m() == 92.0, "the next one may be another's"


def test_it_is_a_fault_while_another_robot_reads_its_cmd_vel() -> None:
    port = Outbox()
    cart = Cart(port)
    cart.say(1)
    assert cart.x_m() == 1.0
    assert cart.fault() is None
    port.readers = ["tsd_ros"]
    cart.now_s += 0.3
    shared = cart.fault()
    assert shared is not None
    assert shared.code == Code.ROS_NAME_READ
    port.readers = []
    cart.now_s += 0.1
    assert cart.fault() is not None
    cart.now_s += 0.3
    cart.say(2)
    assert cart.x_m() == 2.0
    assert cart.fault() is None


def test_twists_come_in_their_period_then_zeros_then_nothing() -> None:
    port = Outbox()
    robot = Cart(port).robot
    now_s = 0.0
    robot.set_heartbeat(Heartbeat(True, 0))
    for speed in [0.0] * 50 + [0.2] * 100 + [0.0] * 200:
        now_s += PERIOD_S
        robot.write(np.array([speed, 0.0]), now_s)
    driven = round(100 * PERIOD_S / SEND_EVERY_S)
    assert port.sent == [0.2] * driven + [0.0] * ZEROS
    robot.set_heartbeat(Heartbeat(False, 0))
    for _ in range(200):
        now_s += PERIOD_S
        robot.write(np.zeros(2), now_s)
    assert port.sent[driven:] == [0.0] * (2 * ZEROS), "also when it is disarmed"
    robot.close()
    assert len(port.sent) == driven + 2 * ZEROS + 1, "nothing for a robot that stood"


def test_after_a_pause_of_the_loop_the_rest_of_a_motion_is_zeros() -> None:
    port = Outbox()
    robot = Cart(port).robot
    robot.write(np.zeros(2), -PERIOD_S)
    robot.write(np.array([0.3, 0.0]), 0.0)
    before = len(port.sent)
    assert port.sent == [0.3]
    now_s = HELD_S + 0.1
    for speed in (0.2, 0.15, 0.1, 0.05, 0.05, 0.0):
        robot.write(np.array([speed, 0.0]), now_s)
        now_s += 2 * PERIOD_S
    assert set(port.sent[before:]) == {0.0}
    robot.write(np.array([0.1, 0.0]), now_s)
    assert port.sent[-1] == 0.1, "the next motion counts"
    robot.close()
    assert port.sent[-2:] == [0.0, 0.0]


def test_a_controller_of_such_a_robot_is_recorded_and_goes_on_from_its_state() -> None:
    robot = robots.parse_description(describe("cart", "", ExternalLimits()), "cart")
    controller = LoggedController(robot, lambda: bytes(16), build="x")
    controller.begin_log()
    measured = np.array([0.1, 0.0, 1.0, 2.0, 0.3])
    controller.step(0.01, measured, ())
    controller.take_log(snapshot=True)
    snapshot = controller.take_log().snapshot
    assert snapshot is not None
    again = load_state(snapshot.state, lambda: bytes(16))
    assert again.odometry(0).xy_heading == pytest.approx([1.0, 2.0, 0.3])
    measured[2] = 1.5
    for each in (controller, again):
        each.step(0.02, measured, ())
    assert again.odometry(0).xy_heading == pytest.approx(controller.odometry(0).xy_heading)
