"""Robots with motor controllers on CAN, between processes over `udp_multicast`."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from tests.app.conftest import PATIENCE_S, Program
from tests.support.bridge_machine import QUICK, wait_until
from tests.support.page_client import Page
from tsd_twin import robots

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(240)]

Start = Callable[..., Program]
GROUPS = {"kiwi": "239.74.163.31", "tsd": "239.74.163.32"}


@dataclass
class Rig:
    """Motors, bridge, dashboard and a page."""

    motors: Program
    bridge: Program
    page: Page
    stops: list[str] = field(default_factory=list[str])
    """Reasons of stops while it was to drive."""

    def show(self) -> dict[str, Any]:
        count = len(self.motors.output)
        self.tell("show")
        wait_until(lambda: len(self.motors.output) > count, "an answer of the motors")
        return json.loads(self.motors.output[count])

    def tell(self, command: str) -> None:
        assert self.motors.process.stdin is not None
        self.motors.process.stdin.write(command + "\n")
        self.motors.process.stdin.flush()

    @property
    def driven(self) -> bool:
        return any(self.show()["driven"])

    def drive(self) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < end_s:
            self.page.let_go()
            try:
                self.page.make_ready()
                self.page.drive(0.2, 0.0, 0.0)
            except AssertionError:
                self.stops.append(str(self.page.state["status"].get("stop")))
                continue
            if self.driven:
                return
        raise AssertionError((self.page.mode, self.stops))

    def stands(self, seconds: float = 0.7) -> bool:
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            if self.driven:
                return False
        return True


@contextmanager
def rig_of(start: Start, folder: Path, name: str) -> Iterator[Rig]:
    kind = "moteus" if name == "kiwi" else "vesc"
    text = robots.read_description("kiwi") if name == "kiwi" else QUICK
    (folder / "robot.toml").write_text(text)
    (folder / "mine.toml").write_text(f'[motor_controllers]\nkind = "{kind}"\nids = [1, 2, 3]\n')
    motors = start("tests.support.can_motors", "--channel", GROUPS[name], "--kind", kind)
    motors.ready()
    servos: list[str] = []
    if name == "tsd":
        servos = ["--servos", str(folder / "servos")]
        start("tests.support.servo_chain", servos[1]).ready()
    page = None
    try:
        bridge = start(
            "tsd_bridge",
            *("--can", f"udp_multicast:{GROUPS[name]}", "--listen", "tcp/127.0.0.1:0"),
            *("--robot", str(folder / "robot.toml"), "--calibration", str(folder / "mine.toml")),
            *servos,
        )
        endpoint = bridge.ready().split()[-1]
        dashboard = start("tsd_dashboard", "--port", "0", "--connect", endpoint)
        port = int(dashboard.ready().split("http://")[1].split(":")[1].split("/")[0].split()[0])
        page = Page(port, "0123456789abcdef")
        page.until(lambda: page.state)
        yield Rig(motors, bridge, page)
    finally:
        if page is not None:
            page.close()


@pytest.mark.parametrize("name", GROUPS)
def test_it_is_driven_stopped_and_stands_after_each_fault_until_armed_again(
    start: Start, tmp_path: Path, name: str
) -> None:
    with rig_of(start, tmp_path, name) as rig:
        rig.drive()
        rig.page.send(t="stop")
        wait_until(lambda: not rig.driven, "stopped")
        assert rig.stands()
        rig.drive()
        rig.tell("mute 2")
        rig.page.until(lambda: rig.page.mode == "fault")
        wait_until(lambda: not rig.driven, "a silent controller stops all")
        rig.tell("mend")
        assert rig.stands(), "mended, the stick is held, and nothing turns"
        rig.drive()
        rig.bridge.process.send_signal(signal.SIGSTOP)
        wait_until(lambda: not rig.driven, "the dead-man of the controllers")
        rig.bridge.process.send_signal(signal.SIGCONT)
        assert rig.stands(), "the bridge goes on, and no speed comes back"
        rig.drive()
        rig.bridge.process.kill()
        wait_until(lambda: not rig.driven, "the dead-man of the controllers")
