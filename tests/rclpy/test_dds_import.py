"""`tsd-ros --rmw dds --import`: an rclpy robot over Fast DDS, on our bus.

Run by `make test-ros`, in an environment with rclpy.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any

import pytest

import tsd_twin
from tests.rclpy.test_dds import Peer, environment
from tests.support.programs import Program, starting
from tsd_twin.errors import TwinError

pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]

URDF = """<robot name="cart">
  <link name="base_link"><visual><geometry><box size="0.4 0.3 0.1"/></geometry></visual></link>
  <link name="disc"><visual><geometry><cylinder radius="0.07" length="0.04"/></geometry></visual>
  </link>
  <joint name="wheel" type="continuous">
    <parent link="base_link"/><child link="disc"/><axis xyz="0 1 0"/>
  </joint>
</robot>"""
SPEED_MPS = 0.3
OWN_TIMEOUT_S = 0.5


@dataclass(frozen=True)
class Stage:
    """An rclpy robot and `tsd-ros --import`, in separate processes."""

    cart: Peer
    adapter: Program
    endpoint: str

    @property
    def forward_mps(self) -> float:
        return self.cart.ask("cart_at")["twist"][0]

    def drive_until(self, base: Any, condition: Callable[[], object], what: str) -> None:
        def driving() -> object:
            with contextlib.suppress(TwinError):
                base.set_velocity(vx_mps=SPEED_MPS)
            return condition()

        self.cart.until(driving, what)

    @property
    def heard(self) -> int:
        return self.cart.ask("cart_at")["heard"]


@pytest.fixture
def stage(tmp_path_factory: pytest.TempPathFactory) -> Generator[Stage]:
    with environment(tmp_path_factory.mktemp("log")), starting() as start:
        cart = Peer("cart")
        try:
            cart.ask("cart", urdf=URDF)
            flags = ("--rmw", "dds", "--import", "cart", "--import-wait", "20")
            adapter = start("tsd_ros", *flags, "--listen", "tcp/127.0.0.1:0")
            endpoint = adapter.ready().split()[-1]
            yield Stage(cart, adapter, endpoint)
            assert "Traceback" not in adapter.sentence, adapter.sentence
        finally:
            cart.close()


def until_ready(stage: Stage, robot: Any) -> None:
    stage.cart.until(lambda: robot.state.status.hardware["odom_age_s"] is not None, "no odometry")
    stage.cart.until(lambda: robot.state.mode == "disarmed", "not ready to arm")


def test_it_is_shown_driven_and_stopped(stage: Stage) -> None:
    cart = stage.cart
    with tsd_twin.connect(stage.endpoint) as robot:
        until_ready(stage, robot)
        drive = robot.description.drive
        assert [joint.name for joint in drive.joints] == ["wheel"]
        start_m = robot.state.odom.pose.x_m
        assert start_m == pytest.approx(3.0, abs=0.001)
        with robot.control("alice") as base:
            base.drive(vx_mps=SPEED_MPS, duration_s=1.0)
            assert robot.state.odom.pose.x_m - start_m > 0.1
            place = list(robot.state.joints.names).index("wheel")
            cart.until(lambda: robot.state.joints.position_rad[place] > 1.0, "no joint moves")
        cart.until(lambda: stage.forward_mps == 0.0, "it does not stop")
        time.sleep(1.0)
        before = stage.heard
        time.sleep(0.5)
        assert stage.heard == before, "others may publish now"
        with robot.control("bob") as base:
            stage.drive_until(base, lambda: stage.forward_mps > 0.0, "it does not drive")
            robot.stop("test")
            cart.until(lambda: stage.forward_mps == 0.0, "STOP does not stop it")
            cart.until(lambda: robot.state.mode == "stopped", "it does not latch")


def test_old_odometry_is_a_fault_and_a_killed_adapter_sends_no_more(stage: Stage) -> None:
    with tsd_twin.connect(stage.endpoint) as robot:
        until_ready(stage, robot)
        with pytest.raises(TwinError, match="nor stopped"):  # It cannot be released at the end.
            drive_until_killed(stage, robot)


def drive_until_killed(stage: Stage, robot: Any) -> None:
    cart = stage.cart
    with robot.control("alice") as base:
        stage.drive_until(base, lambda: stage.forward_mps > 0.0, "it does not drive")
        cart.ask("cart_silent", silent=True)
        stage.drive_until(base, lambda: robot.state.mode == "fault", "no fault")
        assert "no odometry newer" in robot.state.status.stop_reason
        cart.until(lambda: stage.forward_mps == 0.0, "it does not stop")
        cart.ask("cart_silent", silent=False)
        base.reset()
        cart.until(lambda: robot.state.status.refusals.arm is None, "it does not count again")
        base.arm()
        stage.drive_until(base, lambda: stage.forward_mps > 0.0, "it does not drive again")
        stage.adapter.process.kill()
        killed_s = time.monotonic()
        cart.until(lambda: stage.forward_mps == 0.0, "its own timeout does not stop it")
        assert time.monotonic() - killed_s < OWN_TIMEOUT_S + 1.0
