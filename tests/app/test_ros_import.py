"""`tsd-ros --import` as a user runs it, with a third-party robot of `zenoh-ros2-sdk`."""

from __future__ import annotations

import contextlib
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
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, expect

import tsd_twin
from tests.support.browser import PATIENCE_MS, press_linked
from tests.support.programs import Program
from tests.support.ros_nodes import JOINTS, ODOMETRY, START, ForeignRobot, foreign_hash, ros_router
from tests.support.withheld import WithheldTime
from tsd_twin.adapters.ros.external_robot import ZEROS
from tsd_twin.client import RobotClient
from tsd_twin.errors import TwinError
from tsd_twin.robots.external import NOT_PROMISED

pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]

ODOM_TIMEOUT_S = 2.0
"""The external robot is a thread of this process, which a busy machine delays."""


@dataclass(frozen=True)
class Stage:
    """External robot in this process, and `tsd-ros --import` in a separate one."""

    cart: ForeignRobot
    port: int
    adapter: Program
    endpoint: str


def importing(port: int, *flags: str) -> tuple[Program, str]:
    """Start `tsd-ros --import`; return it and its bus endpoint."""
    program = Program(
        [
            "tsd_ros", "--import", "cart", "--ros-connect", f"tcp/127.0.0.1:{port}",
            "--domain", "0", "--listen", "tcp/127.0.0.1:0",
            "--import-timeout", str(ODOM_TIMEOUT_S), *flags,
        ]
    )  # fmt: skip
    return program, program.ready().split()[-1]


@pytest.fixture(scope="module")
def stage() -> Generator[Stage]:
    with ros_router() as (router, port):
        cart = ForeignRobot(router, port)
        program = None
        try:
            program, endpoint = importing(port)
            yield Stage(cart, port, program, endpoint)
            assert program.end() == 0
            assert "Traceback" not in program.sentence, program.sentence
            assert len(program.errors) < 60, "a message of others fills the log"
        finally:
            if program is not None:
                program.clean_up()
            cart.close()


@pytest.fixture
def robot(stage: Stage) -> Generator[RobotClient]:
    with tsd_twin.connect(stage.endpoint) as connected:
        if connected.state.mode in ("stopped", "fault"):
            with connected.control("cleaner", take_over=True, arm=False) as base:
                base.reset()
        yield connected


@contextlib.contextmanager
def pushing(base: Any, vx: float, vy: float = 0.0) -> Generator[None]:
    """Command a velocity on a thread until the context ends, even if the robot refuses."""
    ending = threading.Event()

    def push() -> None:
        while not ending.wait(0.05):
            with contextlib.suppress(TwinError):
                base.set_velocity(vx_mps=vx, vy_mps=vy)

    thread = threading.Thread(target=push)
    thread.start()
    try:
        yield
    finally:
        ending.set()
        thread.join()


@contextlib.contextmanager
def driven(stage: Stage, base: Any, vx: float = 0.3) -> Generator[None]:
    """Drive the external robot until the context ends."""
    with pushing(base, vx):
        stage.cart.until(lambda: stage.cart.twist[0] > 0.9 * vx, "it does not drive")
        yield


def until_quiet(stage: Stage) -> None:
    """Wait until `cmd_vel` has sent its final zeros and is silent."""
    heard = stage.cart.heard
    stage.cart.until(
        lambda: (
            heard and heard[-1][1:] == (0.0, 0.0, 0.0) and time.monotonic() - heard[-1][0] > 0.4
        ),
        f"cmd_vel does not end: {heard[-3:]}",
    )


def test_it_is_shown_as_its_topics_say(stage: Stage, robot: RobotClient) -> None:
    description = robot.description
    assert isinstance(description, tsd_twin.robots.ExternalDescription)
    names = [joint.name for joint in description.drive.joints]
    assert names == ["left_wheel", "right_wheel", "lift"]
    assert any("meshes" in text.lower() for text in description.not_promised)
    assert robot.state.odom.pose == pytest.approx(START, abs=1e-6)
    assert robot.state.status.hardware["kind"] == "ros"
    joints = robot.state.joints
    place = list(joints.names).index("left_wheel")
    assert joints.position_rad[place] == pytest.approx(stage.cart.wheel_rad, abs=1e-6)
    assert joints.velocity_rad_per_s[0] == 0.0, "a joint called vx is not the speed"


def test_it_is_driven_under_our_limits_and_cmd_vel_ends_with_zeros_and_silence(
    stage: Stage, robot: RobotClient
) -> None:
    cart = stage.cart
    with robot.control("alice") as base:
        began = len(cart.heard)
        with WithheldTime(os.getpid()) as withheld:
            with pushing(base, 5.0, 2.0):
                cart.until(lambda: cart.twist[0] > 0.2, "it does not drive")
                cart.until(lambda: robot.state.odom.pose.x_m > START[0] + 0.05, "no odometry")
            base.rest()
            until_quiet(stage)
        heard = cart.heard[began:]
        assert max(math.hypot(vx, vy) for _, vx, vy, _ in heard) <= 0.5 + 1e-9
        assert all(vy == 0.0 for _, _, vy, _ in heard), "it cannot drive sideways"
        steps = np.diff([vx for _, vx, _, _ in heard])
        # After a delayed period it may brake harder in one step, but never accelerates harder.
        assert steps.max() < 0.5 * 0.08, "faster than its acceleration"
        zeros = [vx for _, vx, _, _ in heard[-ZEROS:]]
        assert zeros == [0.0] * len(zeros)
        # Use the mean, because a busy machine delivers several at once.
        periods = len(heard) - 1
        period_s = (heard[-1][0] - heard[0][0]) / periods
        assert 0.014 <= period_s <= 0.026 + withheld.total_s / periods
        assert robot.state.odom.pose == pytest.approx(cart.pose, abs=0.03)
        assert robot.state.mode == "ready"
        with pytest.raises(TwinError, match="cannot drive sideways"):
            base.go_to(x_m=0.0, y_m=0.0)


def test_stop_latches_and_sends_zeros_also_when_it_is_not_armed(
    stage: Stage, robot: RobotClient
) -> None:
    cart = stage.cart
    with robot.control("alice") as base:
        with driven(stage, base):
            robot.stop("cat")
            cart.until(lambda: cart.heard[-1][1:] == (0.0, 0.0, 0.0), "STOP does not stop it")
        assert robot.state.mode == "stopped"
        until_quiet(stage)
        base.reset()
        began = len(cart.heard)
        robot.stop("another node drives it")
        cart.until(lambda: len(cart.heard) > began + ZEROS // 2, "no zeros")
        assert {each[1:] for each in cart.heard[began:]} == {(0.0, 0.0, 0.0)}
        base.reset()


def test_an_operator_that_is_killed_leaves_it_at_rest(stage: Stage) -> None:
    cart = stage.cart
    text = f"""
import tsd_twin
with tsd_twin.connect({stage.endpoint!r}) as robot, robot.control("bob") as base:
    base.drive(vx_mps=0.3, duration_s=60.0)
"""
    with subprocess.Popen([sys.executable, "-c", text]) as operator:
        cart.until(lambda: cart.twist[0] > 0.25 or operator.poll() is not None, "no drive")
        assert operator.poll() is None, "it has ended before it drove"
        operator.kill()
        killed_s = time.monotonic()
        with WithheldTime(os.getpid()) as withheld:
            cart.until(lambda: cart.heard[-1][1:] == (0.0, 0.0, 0.0), "it goes on")
            stood_s = time.monotonic() - killed_s
    # Until the last command expires, plus braking.
    assert stood_s < 0.25 + 0.3 / 0.5 + 0.1 + withheld.total_s


def test_old_odometry_refuses_and_stops(stage: Stage, robot: RobotClient) -> None:
    cart = stage.cart
    with robot.control("alice", take_over=True) as base:
        try:
            with driven(stage, base):
                cart.silent = True
                cart.until(lambda: robot.state.mode == "fault", "it drives without odometry")
            until_quiet(stage)
            assert f"no odometry newer than {ODOM_TIMEOUT_S:g} s" in robot.state.status.stop_reason
            base.reset()
            with pytest.raises(TwinError, match="no odometry"):
                base.arm()
        finally:
            cart.silent = False
        cart.until(lambda: robot.state.status.refusals.arm is None, "odometry does not count again")
        base.arm()
        with driven(stage, base):
            pass
        base.rest()


def test_a_process_that_was_held_sends_nothing_old(stage: Stage, robot: RobotClient) -> None:
    cart = stage.cart
    with robot.control("alice") as base:
        with driven(stage, base):
            stage.adapter.process.send_signal(signal.SIGSTOP)
            try:
                time.sleep(0.1)
                began = len(cart.heard)
                cart.until(lambda: cart.twist == (0.0, 0.0, 0.0), "its own timeout stops it")
                assert len(cart.heard) == began
            finally:
                stage.adapter.process.send_signal(signal.SIGCONT)
        cart.until(lambda: len(cart.heard) > began, "no zeros")
        until_quiet(stage)
        assert {each[1:] for each in cart.heard[began:]} == {(0.0, 0.0, 0.0)}
    # Commands queued during the pause are dropped.
    assert robot.state.mode != "driving"


def say_nan(cart: ForeignRobot) -> None:
    cart.say_odom(math.nan, 0.0, 0.0, 0.0, 0.0)
    cart.say_odom(0.0, 0.0, 0.0, math.nan, 0.0)


def say_far(cart: ForeignRobot) -> None:
    cart.say_odom(1e300, 0.0, 0.0, 0.0, 0.0)
    cart.say_odom(0.0, 0.0, 0.0, 1e300, 0.0)


def say_no_turn(cart: ForeignRobot) -> None:
    cart.say_odom(0.0, 0.0, 0.0, 0.0, 0.0, length=5.0)


def publish_twice(cart: ForeignRobot) -> None:
    other = cart.node.publisher("/odom", ODOMETRY)
    for _ in range(10):
        cart.say_odom(90.0, 90.0, 0.0, 0.0, 0.0, other)
    time.sleep(0.5)
    other.close()


def say_garbage(cart: ForeignRobot) -> None:
    for topic, type_name in (("odom", ODOMETRY), ("joint_states", JOINTS)):
        dds = type_name.replace("/", "::").replace("msg::", "msg::dds_::") + "_"
        key = f"0/{topic}/{dds}/{foreign_hash(type_name)}"
        for payload in (b"", b"\0\1\0\0", os.urandom(900), bytes(2_000_000)):
            cart.node.router.put(key, payload)
            gid = struct.pack("<qqB16s", 1, 1, 16, os.urandom(16))
            cart.node.router.put(key, payload, attachment=gid)


def describe_again(cart: ForeignRobot) -> None:
    cart.describe("x" * 3_000_000)
    cart.describe("<robot/>")


@pytest.mark.parametrize(
    "attack", [say_nan, say_far, say_no_turn, publish_twice, say_garbage, describe_again]
)
def test_hostile_messages_change_nothing(
    stage: Stage, robot: RobotClient, attack: Callable[[ForeignRobot], None]
) -> None:
    cart, before = stage.cart, robot.state.status.hardware["ignored"]
    attack(cart)
    cart.until(lambda: robot.state.status.hardware["ignored"] > before, "it is not ignored")
    for _ in range(5):
        assert robot.state.odom.pose == pytest.approx(cart.pose, abs=1e-6)
        time.sleep(0.04)
    assert robot.state.mode == "disarmed"


def test_when_the_program_is_killed_cmd_vel_ends_and_its_own_timeout_stops_it(
    stage: Stage,
) -> None:
    cart = stage.cart
    program, endpoint = importing(stage.port, "--import-drive", "omni", "--import-speed", "0.4")
    try:
        with tsd_twin.connect(endpoint) as robot:
            base = robot.control("alice")
            base.acquire()
            with pushing(base, 0.0, 0.3):
                cart.until(lambda: cart.heard[-1][2] > 0.25, "it drives sideways, as is said")
                program.process.kill()
            program.wait()
            time.sleep(0.1)
            count = len(cart.heard)
            cart.until(lambda: cart.twist == (0.0, 0.0, 0.0), "its own timeout stops it")
            assert len(cart.heard) == count
            with contextlib.suppress(TwinError):
                base.release()
    finally:
        program.clean_up()


def test_a_robot_by_ros_is_not_shown_to_ros_again(stage: Stage) -> None:
    """Otherwise its own `cmd_vel` would drive it."""
    program = Program(
        [
            "tsd_ros", "--connect", stage.endpoint, "--domain", "0",
            "--ros-connect", f"tcp/127.0.0.1:{stage.port}",
        ]
    )  # fmt: skip
    try:
        program.ready()
        time.sleep(1.5)  # Longer than robot discovery takes.
        tokens = stage.cart.node.tokens()
        assert sum("/tsd_import" in token for token in tokens) > 3
        assert not [token for token in tokens if "/tsd_ros" in token]
    finally:
        program.clean_up()


@pytest.mark.parametrize(
    ("flags", "sentence"),
    [
        (["--import", "No Name"], "No Name"),
        (["--import", "cart", "--view-only"], "--view-only does not go with --import"),
        (["--import", "cart", "--import-speed", "900"], "limits.speed_mps is 900"),
    ],
)
def test_mistakes_are_told_in_a_sentence(flags: list[str], sentence: str) -> None:
    program = Program(["tsd_ros", *flags])
    try:
        assert program.wait() == 1
        assert sentence in program.sentence
        assert re.fullmatch(r"tsd-ros: .*", program.sentence)
    finally:
        program.clean_up()


@pytest.mark.busy
def test_the_page_says_what_is_not_promised(browser: Browser, stage: Stage) -> None:
    dashboard = Program(["tsd_dashboard", "--connect", stage.endpoint, "--port", "0"])
    try:
        address = re.findall(r"http://\S+", dashboard.ready())[0]
        page = browser.new_page(viewport={"width": 960, "height": 640})
        page.goto(address)
        page.get_by_role("tab", name="Modules").click(timeout=PATIENCE_MS)
        said = page.get_by_role("tabpanel").get_by_role("listitem")
        expect(said.first).to_be_visible(timeout=PATIENCE_MS)
        sentences = said.all_inner_texts()
        assert sentences[: len(NOT_PROMISED)] == list(NOT_PROMISED)
        assert any("meshes" in text for text in sentences)
        what = page.get_by_text("which does not promise where it stops")
        press_linked(page, "Take control", what)
        page.get_by_role("tab", name="Health").click(timeout=PATIENCE_MS)
        panel = page.get_by_role("tabpanel")
        panel.locator("summary", has_text="Control").last.click(timeout=PATIENCE_MS)
        row = panel.get_by_role("listitem").filter(has_text="Stops within, if the link fails")
        expect(row).to_contain_text("not promised", timeout=PATIENCE_MS)
        page.close()
    finally:
        dashboard.clean_up()
    assert "Traceback" not in dashboard.sentence, dashboard.sentence
