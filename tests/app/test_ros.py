"""`tsd-ros` as a user runs it, with third-party ROS nodes (`zenoh-ros2-sdk`)."""

from __future__ import annotations

import contextlib
import http.client
import math
import os
import re
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh

import tsd_twin
from tests.app.conftest import stays_put
from tests.support.link_sockets import Relay
from tests.support.programs import Program
from tests.support.robot_node import QUICK
from tests.support.ros_nodes import (
    STORE,
    TRIGGER_HASH,
    TWIST,
    TWIST_STAMPED,
    ForeignNode,
    foreign_hash,
    header,
    ros_router,
    twist,
    vector,
)
from tests.support.square_drive import SquareDrive
from tests.support.withheld import PATIENCE_S, WithheldTime
from tsd_twin import robots
from tsd_twin.adapters.cmd_vel import HELD_UP_S
from tsd_twin.adapters.ros_topics import LATCHED_TOPICS, PUBLISHED, READ, SERVICES

pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]

ALLOWANCE_M = robots.load_robot("tsd").limits.stop_allowance_m
SPEED_MPS = 0.8
FOREIGN_TOKENS = 300
PUSH_S = 5.0
FLOOD = 5000
"""Pipelined service calls, sent without waiting for replies."""
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"


@dataclass(frozen=True)
class Stage:
    """Robot and adapter in separate processes, and a ROS node in this one."""

    endpoint: str
    relay: Relay
    """Relay between robot and adapter."""
    port: int
    robot: Program
    adapter: Program
    node: ForeignNode
    cmd_vel: Any

    def withheld(self) -> WithheldTime:
        """Measure the CPU time withheld from the robot, the adapter and this process."""
        return WithheldTime(self.robot.process.pid, self.adapter.process.pid, os.getpid())

    def push(self, vx_mps: float, duration_s: float, period_s: float = 0.05) -> None:
        end_s = time.monotonic() + duration_s
        while time.monotonic() < end_s:
            self.cmd_vel.publish(linear=vector(vx_mps), angular=vector())
            time.sleep(period_s)

    @contextlib.contextmanager
    def pushing(self, vx_mps: float) -> Generator[list[float]]:
        """Push on a thread until the context ends, and record the times."""
        ending, pushed_s = threading.Event(), list[float]()

        def push() -> None:
            while not ending.wait(0.05):
                self.cmd_vel.publish(linear=vector(vx_mps), angular=vector())
                pushed_s.append(time.monotonic())

        thread = threading.Thread(target=push)
        thread.start()
        try:
            yield pushed_s
        finally:
            ending.set()
            thread.join()

    @contextlib.contextmanager
    def driving(self, vx_mps: float, drives: Callable[[], object]) -> Generator[None]:
        """Push until the robot drives, then until the context ends."""
        with self.pushing(vx_mps):
            end_s = time.monotonic() + PUSH_S
            while not drives():
                assert time.monotonic() < end_s, f"it does not drive: {self.node.said}"
                time.sleep(0.01)
            yield

    def arm(self) -> None:
        """Arm by service call once the adapter has found the robot."""
        self.node.until(
            lambda: self.node.call("/arm")[0] or self.node.status["mode"] == "ready",
            "it is not armed",
        )

    def until_still(self) -> None:
        self.node.until(lambda: self.node.speed_mps < 1e-3, "it does not stop")

    def pause(self) -> None:
        time.sleep(0.6)


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Generator[Stage]:
    toml = tmp_path_factory.mktemp("robot") / "tsd.toml"
    toml.write_text(QUICK, encoding="utf-8")
    with contextlib.ExitStack() as opened, ros_router() as (router, port):
        crowd = [
            router.liveliness().declare_token(
                f"@ros2_lv/0/beef/0/{i}/MP/%/%/crowd/%t{i}/a::msg::dds_::B_/RIHS01_0/::,10:,:,:,,"
            )
            for i in range(FOREIGN_TOKENS)
        ]
        programs = [Program(["tsd_mock", "--listen", "tcp/127.0.0.1:0", "--robot", str(toml)])]
        node = ForeignNode(router, port)
        try:
            endpoint = programs[0].ready().split()[-1]
            relay = opened.enter_context(Relay(endpoint))
            flags = ["--connect", relay.endpoint, "--ros-connect", f"tcp/127.0.0.1:{port}"]
            programs.append(Program(["tsd_ros", *flags, "--domain", "0"]))
            programs[1].ready()
            for row in PUBLISHED:
                name = row.name if row.name[0] == "/" else f"/{row.name}"
                if row not in LATCHED_TOPICS:
                    node.subscribe(name, row.type)
            node.until_all("/odom/truth", "/status")
            cmd_vel = node.publisher("/cmd_vel", TWIST)
            yield Stage(endpoint, relay, port, *programs, node, cmd_vel)
            assert programs[1].end() == 0
            assert "Traceback" not in programs[1].sentence, programs[1].sentence
            cleaned = sum("cleaner has control" in line for line in programs[1].errors)
            assert len(programs[1].errors) < 60 + 10 * cleaned, (
                "a node fills the log with its mistakes"
            )
        finally:
            node.leave()
            for program in programs:
                program.clean_up()
            del crowd


@pytest.fixture(autouse=True)
def at_rest(request: pytest.FixtureRequest) -> Generator[None]:
    """Start each test with the robot free and disarmed."""
    yield
    if "stage" in request.fixturenames:
        stage: Stage = request.getfixturevalue("stage")
        clean(stage)
        stage.node.until(lambda: stage.node.call("/disarm")[0], "it is not free")


def clean(stage: Stage) -> None:
    with (
        tsd_twin.connect(stage.endpoint) as robot,
        robot.control("cleaner", take_over=True, arm=False) as base,
    ):
        if robot.state.mode in ("stopped", "fault"):
            base.reset()


def test_nodes_see_all_topics_among_many_and_late_joiners_get_urdf_and_meshes(
    stage: Stage,
) -> None:
    node = stage.node
    tokens = node.tokens()
    assert len(tokens) >= FOREIGN_TOKENS
    mine = [token.split("/") for token in tokens if "/tsd_ros" in token]
    ends = {(parts[5], parts[9].replace("%", "/")) for parts in mine if len(parts) > 9}
    absolute = {
        row: row.name if row.name[0] == "/" else f"/{row.name}" for row in (*PUBLISHED, *READ)
    }
    assert ends == {
        *(("MP", absolute[row]) for row in PUBLISHED),
        *(("MS", absolute[row]) for row in READ),
        *(("SS", f"/{name}") for name in SERVICES),
    }
    node.until_all("/tf", "/odom", "/joint_states", "/joint_setpoints", "/diagnostics")
    node.until_all("/battery_state")
    moved = {each.child_frame_id for each in node.newest["/tf"].transforms}
    assert moved & {"base_footprint", "module1_inner"}
    assert node.newest["/odom"].header.frame_id == "odom"
    assert node.newest["/odom"].child_frame_id == "base_footprint"
    assert len(node.newest["/joint_states"].name) == 9
    # Published once, long before these nodes subscribe.
    node.subscribe("/robot_description", "std_msgs/msg/String", latched=True)
    node.subscribe("/tf_static", "tf2_msgs/msg/TFMessage", latched=True)
    node.until_all("/robot_description", "/tf_static")
    fixed = {each.child_frame_id for each in node.newest["/tf_static"].transforms}
    assert "base_link" in fixed
    uris = re.findall(r'filename="(http://[^"]+)"', node.newest["/robot_description"].data)
    assert len(uris) > 5
    address, path = re.fullmatch(r"http://([^/]+)(/tsd/.+)", uris[0]).groups()

    def fetched(path: str) -> tuple[int, bytes]:
        line = http.client.HTTPConnection(address, timeout=PATIENCE_S)
        line.request("GET", path)
        answer = line.getresponse()
        with contextlib.closing(line):
            return answer.status, answer.read()

    code, mesh = fetched(path)
    assert code == 200
    assert len(mesh) == 84 + 50 * struct.unpack_from("<I", mesh, 80)[0], "an STL file"
    for wrong in ("/tsd/../../etc/passwd", "/other/x.stl", "/"):
        assert fetched(wrong) == (404, b"")


@pytest.mark.parametrize("type_name", [TWIST, TWIST_STAMPED])
def test_a_node_arms_drives_and_silence_stops_the_robot(stage: Stage, type_name: str) -> None:
    """Within the distance that is promised for a link that fails."""
    node = stage.node
    publisher = node.publisher("/cmd_vel", type_name)

    assert node.call("/arm") == (True, "ready")
    node.until(lambda: str(node.status["lease"]["holder"]).startswith("ros-"), "not held")
    before, start_m = node.status["stops"], node.x_m
    stage.pause()
    with stage.withheld() as withheld:  # The latest pose may also be late.
        end_s = time.monotonic() + 1.2
        while time.monotonic() < end_s:
            if type_name == TWIST:
                publisher.publish(linear=vector(SPEED_MPS), angular=vector())
            else:
                publisher.publish(header=header("base_link"), twist=twist(SPEED_MPS))
            time.sleep(0.05)
        last_m = node.x_m
        stage.until_still()
    travel_m = node.x_m - last_m
    assert travel_m < ALLOWANCE_M + (0.04 + withheld.total_s) * SPEED_MPS
    node.until(lambda: node.status["mode"] == "ready", "it is not ready")
    assert last_m - start_m > 0.3
    assert node.status["stops"] == before, "the adapter sends no zeros"


def test_a_publisher_that_is_killed_leaves_a_robot_at_rest(stage: Stage) -> None:
    node = stage.node
    stage.arm()
    stage.pause()
    text = f"""
import time
from tests.support.ros_nodes import ForeignNode, TWIST, vector
cmd_vel = ForeignNode(None, {stage.port}).publisher("/cmd_vel", TWIST)
print("ready", flush=True)
while True:
    cmd_vel.publish(linear=vector({SPEED_MPS}), angular=vector())
    time.sleep(0.05)
"""
    with subprocess.Popen([sys.executable, "-c", text], stdout=subprocess.PIPE) as publisher:
        assert publisher.stdout is not None
        try:
            assert publisher.stdout.readline() == b"ready\n"
            withheld = stage.withheld()  # The latest pose may also be late.
            node.until(lambda: node.speed_mps > 0.5, "it does not drive")
        finally:
            publisher.kill()
        last_m = node.x_m
        stage.until_still()
    assert node.x_m - last_m < ALLOWANCE_M + (0.04 + withheld.total_s) * SPEED_MPS


def test_a_node_that_drives_a_square_by_odometry_is_back_at_its_start(stage: Stage) -> None:
    node = stage.node
    stage.arm()
    stage.pause()
    drive, start = SquareDrive(0.4, 0.5), node.newest["/odom/truth"].pose.pose.position
    end_s = time.monotonic() + PATIENCE_S
    with stage.withheld() as withheld:
        while (twist_now := drive.twist(*node.odom)) is not None:
            assert time.monotonic() < end_s, f"the square does not end: {node.odom}"
            assert node.status["mode"] != "fault", node.status["stop_reason"]
            vx, vy, omega = twist_now
            stage.cmd_vel.publish(linear=vector(vx, vy), angular=vector(z=omega))
            time.sleep(0.05)
        stage.cmd_vel.publish(linear=vector(), angular=vector())
        stage.until_still()
    end = node.newest["/odom/truth"].pose.pose.position
    # Joints move unmeasured while the machine withholds the processor from the loop.
    allowed_m = 0.01 * drive.path_m + 0.5 * withheld.total_s
    assert math.hypot(end.x - start.x, end.y - start.y) < allowed_m


def test_a_person_who_takes_over_has_control_and_twists_do_not_take_it_back(stage: Stage) -> None:
    node = stage.node
    stage.arm()
    stage.pause()
    before = len(node.said)
    with (
        stage.driving(0.3, lambda: node.status["mode"] == "driving"),
        tsd_twin.connect(stage.endpoint) as robot,
    ):
        with robot.control("person", take_over=True, arm=False, reason="mine"):
            node.until(
                lambda: any("control is lost" in each for each in node.said[before:]),
                "not told",
            )
            stage.until_still()
            at_m = node.x_m
            time.sleep(0.5)
        node.until(lambda: node.status["lease"]["holder"] is None, "not released")
        time.sleep(1.0)
        assert abs(node.x_m - at_m) < 0.01, "a held stick moves nothing"
    assert "control is lost" in stage.adapter.sentence, "the terminal has it, too"
    stage.pause()
    stage.push(0.3, 0.8)
    assert node.status["lease"]["holder"] is None, "nor does a new push"
    stage.arm()
    stage.pause()
    with stage.driving(0.3, lambda: node.x_m - at_m > 0.02):
        pass  # The service arm takes control again.


def test_services_stop_reset_disarm_and_their_refusals(stage: Stage) -> None:
    node = stage.node
    with tsd_twin.connect(stage.endpoint) as robot:
        with robot.control("person", arm=False):
            done, text = node.call("/arm")
            assert not done
            assert "person" in text
            assert node.call("/stop")[0], "each may stop"
            node.until(lambda: node.status["mode"] == "stopped", "not stopped")
        assert not node.call("/arm")[0]
        assert node.call("/reset") == (True, "disarmed")
        assert node.call("/arm") == (True, "ready")
        assert node.call("/disarm")[0]
        node.until(lambda: node.status["lease"]["holder"] is None, "not released")


def test_the_adapter_that_hangs_drives_on_with_no_command_of_before(stage: Stage) -> None:
    """Stopped for three seconds while twists pile up; the stick is held on."""
    stage.arm()
    stage.pause()
    with stage.pushing(SPEED_MPS) as pushed_s, tsd_twin.connect(stage.endpoint) as robot:
        time.sleep(1.0)
        stage.adapter.process.send_signal(signal.SIGSTOP)
        try:
            robot.sleep(0.1)
            with stage.withheld() as withheld:
                last_m = robot.state.truth.pose.x_m
                robot.sleep(2.5)
            still_m = robot.state.truth.pose.x_m
            assert still_m - last_m < ALLOWANCE_M + withheld.total_s * SPEED_MPS
        finally:
            stage.adapter.process.send_signal(signal.SIGCONT)
        on_s = time.monotonic()
        with stage.withheld() as withheld:
            robot.sleep(1.5)
        moved_m = abs(robot.state.truth.pose.x_m - still_m)
        stays_put(moved_m, pushed_s, on_s, withheld.total_s)


def test_a_controller_that_streams_is_an_error_after_a_stall_and_moves_again_by_resume(
    stage: Stage,
) -> None:
    node = stage.node

    def level() -> int:
        found = [e for e in node.newest["/diagnostics"].status if e.name.endswith("cmd_vel")]
        return int(found[0].level)

    stage.arm()
    stage.pause()
    with stage.driving(0.3, lambda: node.status["mode"] == "driving"):
        stage.adapter.process.send_signal(signal.SIGSTOP)
        time.sleep(2.0 * HELD_UP_S)
        stage.adapter.process.send_signal(signal.SIGCONT)
        node.until(lambda: level() == 2, "no error")
        node.until(lambda: node.status["mode"] == "ready", "it is not at rest")
        at_m = node.x_m
        node.until(lambda: node.call("/resume")[0], "it cannot resume")
        node.until(lambda: node.x_m - at_m > 0.02, "it does not move again")
        node.until(lambda: level() == 0, "it is still an error")


def test_a_flood_of_stop_is_answered_and_fills_no_memory(stage: Stage) -> None:
    node, pid = stage.node, stage.adapter.process.pid
    stage.arm()
    before_mb, answers = resident_mb(pid), list[bool]()
    key = f"0/stop/std_srvs::srv::dds_::Trigger_/{TRIGGER_HASH}"
    for count in range(1, FLOOD + 1):
        handler = zenoh.handlers.Callback(
            lambda reply: answers.append(reply.ok is not None), indirect=False
        )
        attachment = struct.pack("<qqB16s", count, time.time_ns(), 16, bytes(16))
        node.router.get(
            key, handler, payload=b"\0\1\0\0\0", attachment=attachment, timeout=PATIENCE_S
        )
    node.until(lambda: node.status["mode"] == "stopped", "it is not stopped")
    node.until(lambda: len(answers) == FLOOD, "not all are answered")
    assert all(answers)
    assert node.call("/stop")[0]
    assert resident_mb(pid) < before_mb + 0.005 * FLOOD


def resident_mb(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text("ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def test_after_a_stop_by_itself_the_next_push_counts(stage: Stage) -> None:
    """How an earlier, released motion ended does not block the next."""
    stage.arm()
    stage.pause()
    node = stage.node
    with tsd_twin.connect(stage.endpoint) as robot:
        before = robot.state.status.stops
        try:
            with stage.driving(0.4, lambda: node.speed_mps > 0.2):
                stage.adapter.process.send_signal(signal.SIGSTOP)
            node.until(lambda: robot.state.status.stops > before, "it does not stop")
        finally:
            stage.adapter.process.send_signal(signal.SIGCONT)
    stage.until_still()
    stage.pause()
    start_m = node.x_m
    with stage.driving(0.4, lambda: node.x_m - start_m > 0.05):
        pass


def test_a_robot_that_comes_back_into_reach_is_not_moved_by_a_stick_that_is_held_on(
    stage: Stage,
) -> None:
    """The adapter loses its connection to the robot, which another client may keep ready."""
    node = stage.node
    stage.arm()
    stage.pause()
    with (
        stage.driving(0.3, lambda: node.speed_mps > 0.2),
        tsd_twin.connect(stage.endpoint) as robot,
    ):
        with stage.relay.cut():
            end_s = time.monotonic() + PATIENCE_S
            while robot.state.status.lease.holder is not None:
                assert time.monotonic() < end_s, "the lease does not end"
                robot.sleep(0.02)
            stage.node.newest.pop("/odom/truth")
        at_m = robot.state.truth.pose.x_m
        node.until_all("/odom/truth")  # It is shown again.
        robot.sleep(2.0)
        assert abs(robot.state.truth.pose.x_m - at_m) < 0.01
    stage.arm()
    stage.pause()
    with stage.driving(0.3, lambda: node.x_m - at_m > 0.02):
        pass  # The service arm takes control again.


def test_a_second_publisher_moves_nothing_while_the_first_one_drives(stage: Stage) -> None:
    node = stage.node
    other = node.publisher("/cmd_vel", TWIST)
    stage.arm()
    stage.pause()
    with stage.driving(0.3, lambda: node.speed_mps > 0.2):
        for _ in range(20):
            other.publish(linear=vector(-0.8), angular=vector())
            time.sleep(0.05)
            # The robot may slow down when twists arrive late, but never reverses.
            assert node.newest["/odom/truth"].twist.twist.linear.x > -0.02
    assert any("second publisher" in each for each in node.said)


def test_hostile_messages_move_nothing_and_end_nothing(stage: Stage) -> None:
    node, router = stage.node, stage.node.router
    stage.arm()
    stage.pause()
    start_m = node.x_m
    line = router.declare_publisher(
        f"0/cmd_vel/geometry_msgs::msg::dds_::Twist_/{foreign_hash(TWIST)}"
    )
    poses = [
        router.declare_publisher(
            f"0/{name}/geometry_msgs::msg::dds_::PoseWithCovarianceStamped_/{foreign_hash(POSE)}"
        )
        for name in ("initialpose", "measured_pose")
    ]
    good = bytes(STORE.serialize_cdr(twist(0.5), TWIST))
    sequences = iter(range(10**6))

    def attach(source_ns: int | None = None) -> bytes:
        now_ns = time.time_ns() if source_ns is None else source_ns
        return struct.pack("<qqB16s", next(sequences), now_ns, 16, b"h" * 16)

    noise = np.random.default_rng(1)
    for vx in (math.nan, math.inf, 1e300):
        line.put(bytes(STORE.serialize_cdr(twist(vx), TWIST)), attachment=attach())
    for attachment in (None, b"", b"x" * 33, noise.bytes(33), attach()[:-1]):
        line.put(good, attachment=attachment)
    once = attach()
    for payload in (b"", good[:20], bytes(2**20), noise.bytes(60), b"\0\1\0\0" + b"\xff" * 48):
        line.put(payload, attachment=attach())
        for each in poses:
            each.put(payload, attachment=attach())
    for _ in range(20):
        line.put(good, attachment=once)  # A repeat is accepted at most once.
    line.delete()
    for source_ns in (0, -(2**63), 2**63 - 1):
        line.put(good, attachment=attach(source_ns))
    arm = "0/arm/std_srvs::srv::dds_::Trigger_/"
    for key in (f"{arm}*", f"{arm}{TRIGGER_HASH}"):
        for attachment in (None, b"x"):
            replies = router.get(key, payload=b"\xff" * 9, attachment=attachment, timeout=2.0)
            assert not [reply for reply in replies if reply.ok]
    time.sleep(0.5)
    assert abs(node.x_m - start_m) < 1e-3
    assert node.status["mode"] == "ready"
    assert any("not finite" in each for each in node.said)
    assert any("no attachment" in each for each in node.said)
    stage.pause()
    stage.push(0.3, 1.5)
    assert node.x_m - start_m > 0.02, "a good one still drives"


def test_initialpose_sets_the_estimate_and_a_measured_pose_reaches_the_robot(stage: Stage) -> None:
    node = stage.node
    initial, measured = (
        node.publisher(f"/{name}", POSE) for name in ("initialpose", "measured_pose")
    )
    types = STORE.types

    def at(x_m: float) -> Any:
        point = types["geometry_msgs/msg/Point"](x=x_m, y=0.5, z=0.0)
        turn = types["geometry_msgs/msg/Quaternion"](
            x=0.0, y=0.0, z=math.sqrt(0.5), w=math.sqrt(0.5)
        )
        pose = types["geometry_msgs/msg/Pose"](position=point, orientation=turn)
        return types["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=np.zeros(36))

    def shown() -> Any:
        return node.newest["/odom"].pose.pose

    with tsd_twin.connect(stage.endpoint) as robot:
        initial.publish(header=header("map"), pose=at(3.0))
        node.until(lambda: any("frame 'map'" in each for each in node.said), "not told")
        initial.publish(header=header("odom"), pose=at(2.0))
        node.until(lambda: abs(shown().position.x - 2.0) < 1e-6, "the estimate is not set")
        assert shown().position.y == pytest.approx(0.5)
        assert shown().orientation.z == pytest.approx(math.sqrt(0.5))
        node.until(lambda: robot.state.lease.holder is None, "the lease is kept")
        measured.publish(header=header("odom"), pose=at(2.01))
        node.until_all("/sensor_pose")
        assert node.newest["/sensor_pose"].pose.position.x == 2.01
        assert node.newest["/sensor_pose"].header.stamp.sec == pytest.approx(time.time(), abs=30.0)
        with robot.control("person", arm=False):
            initial.publish(header=header("odom"), pose=at(5.0))
            node.until(
                lambda: any("initialpose is refused" in each for each in node.said), "not told"
            )
        assert shown().position.x == pytest.approx(2.0, abs=0.1)


def test_two_robots_have_namespaces_in_a_domain_of_their_own(
    start: Callable[..., Program], tmp_path: Path, stage: Stage
) -> None:
    toml = tmp_path / "tsd.toml"
    toml.write_text(QUICK, encoding="utf-8")
    first = start("tsd_mock", "--listen", "tcp/127.0.0.1:0", "--id", "left", "--robot", str(toml))
    endpoint = first.ready().split()[-1]
    flags = ("--listen", "tcp/127.0.0.1:0", "--connect", endpoint, "--id", "right-2")
    start("tsd_mock", *flags, "--robot", "kiwi").ready()
    ros = ("--connect", endpoint, "--ros-connect", f"tcp/127.0.0.1:{stage.port}", "--domain", "7")
    adapter = start("tsd_ros", *ros)
    adapter.ready()
    with contextlib.closing(ForeignNode(stage.node.router, stage.port, domain=7)) as node:
        node.until(
            lambda: (
                {"%left/tsd_ros", "%right_2/tsd_ros"}
                <= {"/".join(token.split("/")[7:9]) for token in node.tokens()}
            ),
            "not both are in the graph",
        )
        node.subscribe("/left/odom", "nav_msgs/msg/Odometry")
        node.subscribe("/right_2/odom", "nav_msgs/msg/Odometry")
        node.until_all("/left/odom", "/right_2/odom")
        cmd_vel = node.publisher("/left/cmd_vel", TWIST_STAMPED)

        assert node.call("/left/arm") == (True, "ready")
        time.sleep(0.6)
        for _ in range(20):
            cmd_vel.publish(header=header("left/base_link"), twist=twist(0.5))
            time.sleep(0.05)
        assert node.newest["/left/odom"].pose.pose.position.x > 0.05
        assert node.newest["/left/odom"].header.frame_id == "left/odom"
        assert node.newest["/right_2/odom"].pose.pose.position.x == 0.0
    assert adapter.end() == 0
    assert "Traceback" not in adapter.sentence


def test_two_robots_of_one_name_are_neither_armed_nor_driven(
    start: Callable[..., Program], stage: Stage
) -> None:
    """Two buses, so two adapters, which both use the default robot names."""
    ros = ("--ros-connect", f"tcp/127.0.0.1:{stage.port}", "--domain", "9")
    endpoints = [
        start("tsd_mock", "--listen", "tcp/127.0.0.1:0", "--robot", "kiwi").ready().split()[-1]
        for _ in range(2)
    ]
    start("tsd_ros", "--connect", endpoints[0], *ros).ready()
    with contextlib.closing(ForeignNode(stage.node.router, stage.port, domain=9)) as node:
        node.until(lambda: node.call("/arm")[0], "a robot that is alone is armed")
        node.call("/disarm")
        other = start("tsd_ros", "--connect", endpoints[1], *ros)
        other.ready()

        def are_refused() -> bool:
            answers = node.call_all("/arm")
            return all(
                not done and "two robots have the ROS name" in text for done, text in answers
            )

        node.until(are_refused, "one of them is armed")
        for endpoint in endpoints:
            with tsd_twin.connect(endpoint) as robot:
                # A robot armed before discovery of its duplicate is disarmed.
                node.until(
                    lambda r=robot: (
                        r.state.mode == "disarmed" and r.state.status.lease.holder is None
                    ),
                    "it stays armed",
                )
        other.process.kill()
        node.until(lambda: node.call_all("/arm")[0][0], "it is not armed when the other has gone")


def test_without_a_router_it_ends_with_one_sentence() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tsd_ros", "--ros-connect", "tcp/127.0.0.1:1"],
        capture_output=True, text=True, timeout=PATIENCE_S,
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "rmw_zenohd" in done.stderr


def test_without_rclpy_it_says_how_to_have_it() -> None:
    bare = {name: text for name, text in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [sys.executable, "-m", "tsd_ros", "--rmw", "dds"],
        capture_output=True, text=True, timeout=PATIENCE_S, env=bare,
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "source /opt/ros/<distro>/setup.bash" in done.stderr


def test_a_viewer_publishes_and_reads_nothing(start: Callable[..., Program]) -> None:
    robot = start("tsd_mock", "--listen", "tcp/127.0.0.1:0")
    with ros_router() as (router, port):
        flags = ("--connect", robot.ready().split()[-1], "--ros-connect", f"tcp/127.0.0.1:{port}")
        start("tsd_ros", *flags, "--domain", "0", "--view-only").ready()
        node = ForeignNode(router, port)
        node.until(lambda: any("/MP/" in token for token in node.tokens()), "no publisher")
        assert not [token for token in node.tokens() if "/MS/" in token or "/SS/" in token]
