"""Kiwi and mecanum on Dynamixel wheels: page, dashboard, bus, bridge, pty and servos.

The shut-off delay of wheels is compared in virtual time in tests/hardware/test_wheel_matrix.py.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from tests.app.bridge_machine import wait_until
from tests.app.wheel_rig import Rig, opened
from tests.support.programs import Program
from tests.support.robot_variants import WHEEL_ROBOTS
from tsd_twin import robots
from tsd_twin.messages.codes import Code

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(240)]

Start = Callable[..., Program]


def flags_of(folder: Path) -> list[str]:
    return ["--servos", str(folder / "port"), "--robot", str(folder / "robot.toml")]


def bridge_of(start: Start, folder: Path) -> Program:
    return start("tsd_bridge", "--listen", "tcp/127.0.0.1:0", *flags_of(folder))


@contextmanager
def rig_of(start: Start, folder: Path, name: str) -> Generator[Rig]:
    """Start everything for a robot."""
    robot = WHEEL_ROBOTS[name]
    (folder / "robot.toml").write_text(robot.text)
    ids = ",".join(str(i + 1) for i in range(robot.wheels))
    box = start(
        "tests.app.x_series_box",
        *("--link", str(folder / "port"), "--ids", ids),
        *("--model", str(robot.model), "--volts", str(robot.volts)),
    )
    box.ready()
    with opened(start, name, box, flags_of(folder), speed_mps=0.1) as rig:
        yield rig


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
    rig.drive()

    def turns_as_wanted() -> bool:
        return np.allclose(rig.show()["speeds"], wanted, atol=0.1 * np.abs(wanted).max())

    wait_until(turns_as_wanted, "the set speeds")
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
    rig.drive()
    rig.tell(told)
    wait_until(lambda: not rig.driven, "off")
    rig.page.until(lambda: rig.code)
    assert rig.code in codes
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
    box = start("tests.app.x_series_box", "--link", str(tmp_path / "port"), "--ids", "1,2,9")
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
