"""Robots with motor controllers on CAN, between processes over `udp_multicast`."""

from __future__ import annotations

import signal
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.app.bridge_machine import QUICK, wait_until
from tests.app.wheel_rig import Rig, opened
from tests.support.programs import Program
from tsd_twin import robots
from tsd_twin.messages.codes import Code

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(240)]

Start = Callable[..., Program]
ROBOTS = ("kiwi", "tsd")
GROUP = "239.74.163.31"
"""Shared by all tests, because python-can receives from every group on its port."""
FAULTS = {
    "kiwi": [("mute 2", {Code.WHEELS_SILENT}), ("fault 2 38", {Code.WHEEL_FAULT})],
    "tsd": [
        ("mute 2", {Code.WHEELS_SILENT}),
        ("temperature_c 2 95", {Code.WHEEL_FAULT}),
        ("servos dead 3", {Code.SERVOS_SILENT}),
        ("servos hot 3", {Code.SERVO_TOO_HOT}),
        ("servos limp 3", {Code.SERVO_LIMP}),
        ("servos unplug", {Code.DEVICE_DISCONNECTED, Code.DEVICE_SILENT, Code.ALL_SERVOS_SILENT}),
    ],
}


def flags_of(start: Start, folder: Path, name: str, ids: str) -> tuple[Program, list[str]]:
    """Start the motors of a robot; return them and the flags for its bridge."""
    kind = "moteus" if name == "kiwi" else "vesc"
    (folder / "robot.toml").write_text(robots.read_description("kiwi") if name == "kiwi" else QUICK)
    (folder / "mine.toml").write_text(f'[motor_controllers]\nkind = "{kind}"\nids = [1, 2, 3]\n')
    motors = start("tests.support.can_motors", "--channel", GROUP, "--kind", kind, "--ids", ids)
    motors.ready()
    files = ["--robot", str(folder / "robot.toml"), "--calibration", str(folder / "mine.toml")]
    return motors, ["--can", f"udp_multicast:{GROUP}", *files]


@contextmanager
def rig_of(start: Start, folder: Path, name: str) -> Generator[Rig]:
    motors, flags = flags_of(start, folder, name, "1,2,3")
    servos = None
    if name == "tsd":
        flags += ["--servos", str(folder / "servos")]
        servos = start("tests.support.pty_devices", flags[-1])
        servos.ready()
    with opened(start, name, motors, flags, servos=servos) as rig:
        yield rig


@pytest.mark.parametrize("name", ROBOTS)
def test_a_controller_with_another_id_is_refused_and_a_killed_bridge_stops_the_motors(
    start: Start, tmp_path: Path, name: str
) -> None:
    motors, flags = flags_of(start, tmp_path, name, "1,2,9")
    if name == "tsd":
        flags += ["--servos", str(tmp_path / "servos")]
        start("tests.support.pty_devices", flags[-1]).ready()
    bridge = start("tsd_bridge", "--listen", "tcp/127.0.0.1:0", *flags)
    assert bridge.wait() == 1
    assert "motor controller of" in bridge.sentence
    assert "it does not answer" in bridge.sentence
    motors.end()
    with rig_of(start, tmp_path, name) as rig:
        rig.drive()
        rig.bridge.process.kill()
        wait_until(lambda: not rig.driven, "the dead-man of the controllers")


@pytest.fixture(scope="module", params=ROBOTS)
def shared(
    request: pytest.FixtureRequest, start_shared: Start, tmp_path_factory: pytest.TempPathFactory
) -> Generator[Rig]:
    folder = tmp_path_factory.mktemp(request.param)
    with rig_of(start_shared, folder, request.param) as rig:
        yield rig


def test_stop_of_the_page_stops_the_wheels_until_reset_and_arming(shared: Rig) -> None:
    shared.drive()
    shared.page.send(t="stop")
    wait_until(lambda: not shared.driven, "stopped")
    assert shared.stands()


def test_each_fault_is_named_and_nothing_turns_until_armed_again(shared: Rig) -> None:
    for harm, codes in FAULTS[shared.name]:
        shared.drive()
        shared.tell(harm)
        wait_until(lambda: not shared.driven, f"{harm}: off")
        shared.page.until(lambda: shared.code)
        assert shared.code in codes, harm
        shared.mend()
        assert shared.stands(), f"{harm}: mended, the stick is held, and nothing turns"


def test_a_bridge_that_hangs_leaves_motors_that_stop(shared: Rig) -> None:
    shared.drive()
    shared.bridge.process.send_signal(signal.SIGSTOP)
    wait_until(lambda: not shared.driven, "the dead-man of the controllers")
    shared.bridge.process.send_signal(signal.SIGCONT)
    assert shared.stands(), "the bridge goes on, and no speed comes back"
