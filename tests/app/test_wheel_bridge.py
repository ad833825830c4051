"""Kiwi and mecanum on Dynamixel wheels: page, dashboard, bus, bridge, pty and servos, in processes.

How soon wheels are off is compared in virtual time, in tests/hardware/test_wheel_matrix.py; here a
busy machine may hold up any of the programs.
"""

from __future__ import annotations

import json
import re
import signal
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.app.conftest import PATIENCE_S, Program
from tests.support.bridge_machine import wait_until
from tests.support.page_client import Page
from tests.support.wheel_robots import WHEEL_ROBOTS
from tsd_twin import robots
from tsd_twin.messages.codes import Code

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(240)]

Start = Callable[..., Program]
_TRIES = 6


@dataclass
class Rig:
    """A robot with all its processes, and a page that drives it."""

    start: Start
    folder: Path
    name: str
    box: Program
    bridge: Program
    dashboard: Program
    page: Page

    def show(self) -> dict[str, Any]:
        count = len(self.box.output)
        self.tell("show")
        wait_until(lambda: len(self.box.output) > count, "an answer of the box")
        return json.loads(self.box.output[count])

    def tell(self, command: str) -> None:
        assert self.box.process.stdin is not None
        self.box.process.stdin.write(command + "\n")
        self.box.process.stdin.flush()

    @property
    def status(self) -> dict[str, Any]:
        return self.page.state["status"]

    @property
    def code(self) -> str:
        return (self.status.get("stop") or {}).get("code", "")

    @property
    def driven(self) -> bool:
        return any(self.show()["driven"])

    def drive(self) -> None:
        """Mend all, get ready and hold the stick, as often as a busy machine makes necessary."""
        end_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < end_s:
            self.page.let_go()
            try:
                self.page.make_ready()
                self.page.drive(0.1, 0.0, 0.0)
            except AssertionError:
                continue
            if self.driven:
                return
        raise AssertionError((self.page.mode, self.status.get("stop"), self.show()))

    def stands(self, seconds: float = 0.7) -> bool:
        """Return whether no wheel is driven for a while, with the stick held."""
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            if self.driven:
                return False
        return True


def bridge_of(start: Start, folder: Path, *more: str) -> Program:
    return start(
        "tsd_bridge",
        *("--servos", str(folder / "port"), "--robot", str(folder / "robot.toml")),
        *("--listen", "tcp/127.0.0.1:0"),
        *more,
    )


@contextmanager
def rig_of(start: Start, folder: Path, name: str) -> Iterator[Rig]:
    """Start everything for a robot."""
    robot = WHEEL_ROBOTS[name]
    (folder / "robot.toml").write_text(robot.text)
    ids = ",".join(str(i + 1) for i in range(robot.wheels))
    box = start(
        "tests.support.x_series_box",
        *("--link", str(folder / "port"), "--ids", ids),
        *("--model", str(robot.model), "--volts", str(robot.volts)),
    )
    box.ready()
    bridge = bridge_of(start, folder)
    endpoint = bridge.ready().split()[-1]
    dashboard = start("tsd_dashboard", "--port", "0", "--connect", endpoint)
    port = int(re.findall(r"http://[^:/]+:(\d+)", dashboard.ready())[0])
    page = Page(port, "0123456789abcdef")
    page.until(lambda: page.state)
    try:
        yield Rig(start, folder, name, box, bridge, dashboard, page)
    finally:
        page.close()


@pytest.fixture(scope="module", params=["kiwi", "mecanum"])
def shared(
    request: pytest.FixtureRequest, start_shared: Start, tmp_path_factory: pytest.TempPathFactory
) -> Generator[Rig]:
    with rig_of(start_shared, tmp_path_factory.mktemp(request.param), request.param) as rig:
        yield rig


@pytest.fixture
def rig(shared: Rig) -> Generator[Rig]:
    yield shared
    shared.tell("mend")


def test_the_stick_of_a_page_turns_the_wheels_as_the_kinematics_has_it(rig: Rig) -> None:
    robot = robots.parse_description(WHEEL_ROBOTS[rig.name].text, rig.name)
    wanted = robot.kinematics().inverse([0.1, 0.0, 0.0])
    for _ in range(_TRIES):
        rig.drive()
        end_s = time.monotonic() + 3.0
        while time.monotonic() < end_s:
            seen = rig.show()
            if np.allclose(seen["speeds"], wanted, atol=0.1 * np.abs(wanted).max()):
                break
        else:
            continue
        break
    assert np.allclose(seen["speeds"], wanted, atol=0.1 * np.abs(wanted).max()), seen
    assert rig.status["hardware"]["kind"] == "dynamixel_wheels"
    rig.page.let_go()
    wait_until(lambda: not rig.driven, "let go of, it stands")
    assert not rig.show()["reserved"]


def test_stop_of_the_page_stops_the_wheels_until_reset_and_arming(rig: Rig) -> None:
    rig.drive()
    rig.tell("mark")
    rig.page.send(t="stop")
    wait_until(lambda: not rig.driven, "stopped")
    rig.page.until(lambda: rig.page.mode == "stopped")
    assert rig.stands()
    rig.drive()


@pytest.mark.parametrize(
    ("harm", "codes"),
    [
        ("unplug 1", {Code.DEVICE_DISCONNECTED, Code.DEVICE_SILENT}),
        ("reset_adapter 1", {Code.DEVICE_DISCONNECTED, Code.DEVICE_SILENT, Code.SERVO_LIMP}),
        ("hot 2 LIMIT", {Code.SERVO_TOO_HOT}),
        ("hot 2 SHUTDOWN", {Code.SERVO_ERROR, Code.SERVO_LIMP, Code.SERVO_TOO_HOT}),
        ("limp 2", {Code.SERVO_LIMP}),
        ("restart 1", {Code.SERVO_LIMP, Code.SERVOS_RESTARTED}),
        ("dead 3", {Code.SERVOS_SILENT}),
        ("power_off", {Code.ALL_SERVOS_SILENT, Code.DEVICE_SILENT}),
        ("jam 1", {Code.WHEEL_STUCK}),
    ],
)
def test_a_fault_is_named_on_the_page_and_nothing_turns_until_armed_again(
    rig: Rig, harm: str, codes: set[Code]
) -> None:
    limit_c = WHEEL_ROBOTS[rig.name].limit_c
    told = harm.replace("LIMIT", str(limit_c - 4)).replace("SHUTDOWN", str(limit_c + 2))
    for left in reversed(range(_TRIES)):
        rig.drive()
        rig.tell(told)
        rig.page.until(lambda: rig.page.mode in ("fault", "disarmed", "ready", "stopping"))
        wait_until(lambda: not rig.driven, "off")
        code = rig.code
        if code in codes:
            break
        rig.tell("mend")
        assert left, f"this machine is too busy: {rig.status.get('stop')}"
    rig.tell("mend")
    assert rig.stands(), "mended, the stick is held, and nothing turns"
    rig.drive()


def test_a_bridge_that_hangs_or_is_killed_leaves_servos_that_stop_by_themselves(rig: Rig) -> None:
    rig.drive()
    rig.tell("mark")
    rig.bridge.process.send_signal(signal.SIGSTOP)
    wait_until(lambda: not rig.driven, "the bus watchdog")
    assert all(rig.show()["expired"])
    rig.bridge.process.send_signal(signal.SIGCONT)
    assert rig.stands(), "it goes on, and no old speed comes back"
    rig.drive()


def test_a_robot_with_an_id_that_does_not_answer_is_refused_in_a_sentence(
    start: Start, tmp_path: Path
) -> None:
    robot = WHEEL_ROBOTS["kiwi"]
    (tmp_path / "robot.toml").write_text(robot.text)
    box = start("tests.support.x_series_box", "--link", str(tmp_path / "port"), "--ids", "1,2,9")
    box.ready()
    bridge = bridge_of(start, tmp_path)
    assert bridge.wait() == 1
    assert "servo 3 (wheel3) does not answer" in bridge.sentence
    assert "id 3 and this rate?" in bridge.sentence


def test_a_bridge_that_is_killed_stops_the_wheels_and_the_next_starts_at_rest(
    start: Start, tmp_path: Path
) -> None:
    with rig_of(start, tmp_path, "kiwi") as rig:
        rig.drive()
        rig.tell("mark")
        rig.bridge.process.kill()
        wait_until(lambda: not rig.driven, "the bus watchdog")
        again = bridge_of(start, tmp_path)
        again.ready()
        assert rig.stands(), "a new bridge clears the watchdogs, and nothing turns"
        assert not any(rig.show()["expired"])
