"""`tsd-ros --rmw dds` as a ROS 2 user runs it: rclpy nodes over Fast DDS.

Run by `make test-ros`, in an environment with rclpy.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

import tsd_twin
from tests.support.programs import Program, starting
from tests.support.robot_node import QUICK
from tsd_twin import robots
from tsd_twin.adapters.cmd_vel import PAUSE_S
from tsd_twin.adapters.ros.port import types_of
from tsd_twin.adapters.ros_topics import PUBLISHED, READ, SERVICES, RosNames, RosQoS

pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]

ALLOWANCE_M = robots.load_robot("tsd").limits.stop_allowance_m
SPEED_MPS = 0.8
LONGEST_GAP_S = 0.1
"""Maximum period of truth messages at an rclpy node."""
PATIENCE_S = 60.0
TWIST, TWIST_STAMPED = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"
PROFILE = Path(__file__).with_name("loopback.xml")
DOMAIN = 1 + os.getpid() % 100
"""DDS domain, chosen to differ from concurrent runs on this machine."""


class Peer:
    """An rclpy node in a separate process."""

    def __init__(self, name: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.rclpy.peer", name],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self._read() == "ready"

    def ask(self, do: str, **what: Any) -> Any:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps({"do": do, "with": what}) + "\n")
        self._process.stdin.flush()
        answer = self._read()
        assert "error" not in answer, answer["error"]
        return answer["value"]

    def _read(self) -> Any:
        assert self._process.stdout is not None
        return json.loads(self._process.stdout.readline())

    def kill(self) -> None:
        self._process.kill()

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            assert stream is not None
            stream.close()

    # Frequent requests.

    def call(self, service: str) -> tuple[bool, str]:
        done, text = self.ask("call", name=service)
        return done, text

    def until(self, condition: Callable[[], object], what: str) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end_s, f"{what}: {self.ask('said')}"
            time.sleep(0.02)

    def hears(self, *sentences: str, since: int = 0) -> None:
        for each in sentences:
            self.until(lambda each=each: any(each in s for s in self.ask("said")[since:]), each)

    @property
    def status(self) -> Any:
        return json.loads(self.ask("newest", topic="/status")["data"])


@dataclass(frozen=True)
class Stage:
    """A robot, the adapter and an rclpy node in separate processes."""

    endpoint: str
    adapter: Program
    peer: Peer
    robot: tsd_twin.Robot

    @property
    def x_m(self) -> float:
        return self.robot.state.truth.pose.x_m

    @property
    def speed_mps(self) -> float:
        twist = self.robot.state.truth.twist
        return math.hypot(twist.vx_mps, twist.vy_mps)

    def until_still(self) -> None:
        self.peer.until(lambda: self.speed_mps < 1e-3, "it does not stop")

    def armed(self) -> None:
        assert self.peer.call("/arm") == (True, "ready")
        time.sleep(0.6)


@contextlib.contextmanager
def environment(log: Path) -> Generator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SYSTEM_DEFAULT")
        patch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(PROFILE))
        patch.setenv("ROS_DOMAIN_ID", str(DOMAIN))
        patch.setenv("AMENT_PREFIX_PATH", sys.prefix)
        patch.setenv("ROS_LOG_DIR", str(log))
        yield


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Generator[Stage]:
    folder = tmp_path_factory.mktemp("robot")
    toml = folder / "tsd.toml"
    toml.write_text(QUICK, encoding="utf-8")
    with environment(folder), starting() as start:
        mock = start("tsd_mock", "--listen", "tcp/127.0.0.1:0", "--robot", str(toml))
        endpoint = mock.ready().split()[-1]
        adapter = start("tsd_ros", "--rmw", "dds", "--connect", endpoint)
        adapter.ready()
        peer = Peer("user")
        try:
            for row in PUBLISHED:
                if row.qos is not RosQoS.LATCHED:
                    peer.ask("subscribe", topic=absolute(row.name), type_name=row.type)
            with tsd_twin.connect(endpoint) as robot:
                peer.until(lambda: peer.ask("newest", topic="/status"), "no status")
                yield Stage(endpoint, adapter, peer, robot)
            assert adapter.end() == 0
            assert "Traceback" not in adapter.sentence, adapter.sentence
        finally:
            peer.close()


@pytest.fixture(autouse=True)
def at_rest(stage: Stage) -> Generator[None]:
    """Start each test with the robot free and disarmed, without a `cmd_vel` publisher."""
    yield
    stage.peer.ask("let_go", withdraw=True)
    if stage.peer.status["mode"] in ("stopped", "fault"):
        stage.peer.call("/reset")
    stage.peer.until(lambda: stage.peer.call("/disarm")[0], "it is not free")


def absolute(name: str) -> str:
    return RosNames("tsd", shared=False).topic(name)


def test_nodes_see_the_table_of_topics_with_its_types_and_qos(stage: Stage) -> None:
    peer = stage.peer

    def ends(name: str, kind: str) -> set[tuple[str, ...]]:
        found = peer.ask("endpoints", topic=absolute(name))[kind]
        return {tuple(each[1:]) for each in found if each[0].startswith("/tsd_ros")}

    def qos(row_qos: RosQoS) -> tuple[str, str]:
        reliability, durability, _ = row_qos.split(", ")
        return reliability.upper().replace(" ", "_"), durability.upper().replace(" ", "_")

    def shown(name: str, kind: str, expected: set[tuple[str, ...]]) -> None:
        # The name of a node arrives after its endpoints.
        peer.until(lambda: ends(name, kind) == expected, f"{name}: {ends(name, kind)}")

    for row in PUBLISHED:
        expected = {(row.type, *qos(row.qos))}
        shown(row.name, "publishers", expected)
    for row in READ:
        expected = {(each, *qos(row.qos)) for each in types_of(row)}
        shown(row.name, "subscriptions", expected)
    services = peer.ask("services", node="tsd_ros", namespace="/")
    assert set(services) >= {f"/{name}" for name in SERVICES}


def test_nodes_receive_all_topics_and_late_joiners_the_urdf(stage: Stage) -> None:
    peer = stage.peer
    silent = {"/events", "/sensor_pose", "/odom/alternative"}
    moving = {absolute(row.name) for row in PUBLISHED if row.qos is not RosQoS.LATCHED} - silent
    newest: dict[str, Any] = {}

    def all_there() -> bool:
        for topic in moving - set(newest):
            if message := peer.ask("newest", topic=topic):
                newest[topic] = message
        return moving <= set(newest)

    peer.until(all_there, "not all topics have messages")
    assert newest["/odom"]["header"]["frame_id"] == "odom"
    assert newest["/odom"]["child_frame_id"] == "base_footprint"
    assert len(newest["/joint_states"]["name"]) == len(newest["/joint_states"]["position"]) == 9
    moved = {each["child_frame_id"] for each in newest["/tf"]["transforms"]}
    assert {"base_footprint", "module1_inner"} & moved
    # Published once, long before these nodes subscribe.
    for topic, type_name in (
        ("/robot_description", "std_msgs/msg/String"),
        ("/tf_static", "tf2_msgs/msg/TFMessage"),
    ):
        peer.ask("subscribe", topic=topic, type_name=type_name, latched=True)
        peer.until(lambda topic=topic: peer.ask("newest", topic=topic), topic)
    fixed = peer.ask("newest", topic="/tf_static")["transforms"]
    assert "base_link" in {each["child_frame_id"] for each in fixed}
    urdf = peer.ask("newest", topic="/robot_description")["data"]
    assert len(re.findall(r'filename="http://[^"]+/tsd/', urdf)) > 5


def test_a_node_that_drives_a_square_by_odometry_is_back_at_its_start(stage: Stage) -> None:
    stage.armed()
    start = stage.robot.state.truth.pose
    path_m = stage.peer.ask("square", side_m=0.6, speed_mps=0.4)
    stage.until_still()
    end = stage.robot.state.truth.pose
    missed_m = math.hypot(end.x_m - start.x_m, end.y_m - start.y_m)
    assert missed_m < 0.01 * path_m, f"{1000.0 * missed_m:.1f} mm"


@pytest.mark.parametrize("stamped", [False, True], ids=["Twist", "TwistStamped"])
def test_silence_stops_the_robot(stage: Stage, stamped: bool) -> None:
    stage.armed()
    start_m = stage.x_m
    stage.peer.ask("push", vx_mps=0.5, stamped=stamped)
    stage.peer.until(lambda: stage.speed_mps > 0.3, "it does not drive")
    stage.peer.ask("let_go")
    last_m = stage.x_m
    stage.until_still()
    assert last_m > start_m
    assert stage.x_m - last_m < ALLOWANCE_M + LONGEST_GAP_S * 0.5
    assert stage.peer.status["lease"]["holder"].startswith("ros-")


def test_a_publisher_that_is_killed_leaves_a_robot_at_rest(stage: Stage) -> None:
    stage.armed()
    other = Peer("killed")
    try:
        other.ask("push", vx_mps=SPEED_MPS)
        stage.peer.until(lambda: stage.speed_mps > 0.5, "it does not drive")
        other.kill()
        last_m = stage.x_m
        stage.until_still()
    finally:
        other.close()
    assert stage.x_m - last_m < ALLOWANCE_M + LONGEST_GAP_S * SPEED_MPS
    # The ROS graph lists it until its lease ends, so until then a new publisher is the second. The
    # adapter may notice later than this peer.
    stage.peer.until(
        lambda: not stage.peer.ask("endpoints", topic="/cmd_vel")["publishers"], "it is kept"
    )
    stage.peer.until(lambda: drives(stage), "it hinders another publisher")


def drives(stage: Stage) -> bool:
    """Return whether a publisher that pauses, then publishes for 1 s, moves the robot."""
    stage.peer.ask("let_go")
    time.sleep(2.0 * PAUSE_S)
    stage.peer.ask("push", vx_mps=0.3)
    time.sleep(1.5)
    moves = stage.speed_mps > 0.2
    stage.peer.ask("let_go")
    stage.until_still()
    return moves


def test_a_person_who_takes_over_has_control_and_ros_is_told(stage: Stage) -> None:
    peer = stage.peer
    stage.armed()
    before = len(peer.ask("said"))
    peer.ask("push", vx_mps=0.3)
    peer.until(lambda: stage.speed_mps > 0.2, "it does not drive")
    with stage.robot.control("person", take_over=True, arm=False, reason="mine"):
        peer.hears("control is lost", since=before)
        stage.until_still()
        at_m = stage.x_m
    peer.until(lambda: peer.status["lease"]["holder"] is None, "not released")
    time.sleep(1.0)
    assert abs(stage.x_m - at_m) < 0.01, "a held stick moves nothing"
    peer.ask("let_go")
    stage.armed()
    peer.ask("push", vx_mps=0.3)
    peer.until(lambda: stage.x_m - at_m > 0.02, "the service arm takes control again")


def test_services_arm_stop_reset_disarm_and_their_refusals(stage: Stage) -> None:
    peer = stage.peer
    with stage.robot.control("person", arm=False):
        done, text = peer.call("/arm")
        assert not done
        assert "person" in text
        assert peer.call("/stop")[0], "each may stop"
        peer.until(lambda: peer.status["mode"] == "stopped", "not stopped")
    assert not peer.call("/arm")[0]
    assert peer.call("/reset") == (True, "disarmed")
    assert peer.call("/arm") == (True, "ready")
    assert peer.call("/disarm")[0]
    peer.until(lambda: peer.status["lease"]["holder"] is None, "not released")


def test_of_two_publishers_that_cannot_be_told_apart_none_moves_the_robot(stage: Stage) -> None:
    peer, other = stage.peer, Peer("second")
    try:
        stage.armed()
        before = len(peer.ask("said"))
        peer.ask("push", vx_mps=0.3)
        peer.until(lambda: stage.speed_mps > 0.2, "it does not drive")
        other.ask("push", vx_mps=-0.8)
        peer.hears("several publishers", since=before)
        stage.until_still()
        at_m = stage.x_m
        time.sleep(0.5)
        assert abs(stage.x_m - at_m) < 0.01
        other.ask("let_go", withdraw=True)
        time.sleep(0.5)
        assert abs(stage.x_m - at_m) < 0.01, "a stick that is held has to be let go first"
        peer.ask("let_go")
        time.sleep(0.6)
        peer.ask("push", vx_mps=0.3)
        peer.until(lambda: stage.x_m - at_m > 0.02, "it does not drive again")
    finally:
        other.close()


def test_a_second_robot_brings_namespaces_and_takes_them_away(stage: Stage) -> None:
    peer = stage.peer

    def nodes_of(topic: str) -> set[str]:
        return {each[0] for each in peer.ask("endpoints", topic=topic)["publishers"]}

    with starting() as start:
        flags = ("--listen", "tcp/127.0.0.1:0", "--connect", stage.endpoint)
        start("tsd_mock", *flags, "--id", "right-2", "--robot", "kiwi").ready()
        peer.until(lambda: nodes_of("/right_2/odom") == {"/right_2/tsd_ros"}, "no second robot")
        peer.until(lambda: nodes_of("/tsd/odom") == {"/tsd/tsd_ros"}, "no namespace")
        assert nodes_of("/odom") == set()
        peer.ask("subscribe", topic="/right_2/odom", type_name="nav_msgs/msg/Odometry")
        peer.until(lambda: peer.ask("newest", topic="/right_2/odom"), "no odometry")
        header = peer.ask("newest", topic="/right_2/odom")["header"]
        assert header["frame_id"] == "right_2/odom"
        assert peer.call("/tsd/arm") == (True, "ready")
        time.sleep(0.6)
        at_m = stage.x_m
        peer.ask("push", vx_mps=0.3, topic="/tsd/cmd_vel")
        peer.until(lambda: stage.x_m - at_m > 0.02, "it does not drive")
        assert peer.ask("newest", topic="/right_2/odom")["pose"]["pose"]["position"]["x"] == 0.0
        peer.ask("let_go", withdraw=True)
    peer.until(lambda: nodes_of("/odom") == {"/tsd_ros"}, "the namespace is kept")
    assert nodes_of("/tsd/odom") == set()
