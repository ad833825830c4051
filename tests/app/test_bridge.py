"""`tsd-bridge` as a user meets it, with the compiled firmware behind a real pty."""

from __future__ import annotations

import contextlib
import re
import signal
import socket
import threading
import time
from collections.abc import Callable, Generator
from pathlib import Path

import pytest
import serial

from tests.app.bridge_machine import AHEAD, Machine, wait_for_mode, wait_until
from tests.support.programs import Program
from tests.support.pty_devices import Peer, ServoChain

pytestmark = [pytest.mark.system, pytest.mark.busy]

Start = Callable[..., Program]
ANY_PORT = ("--listen", "tcp/127.0.0.1:0")
PIECES = 1000
OLD_S = 4.5
"""Duration of garbage on the line; long enough for a busy machine to notice."""


@pytest.fixture(scope="module")
def shared(start_shared: Start, tmp_path_factory: pytest.TempPathFactory) -> Generator[Machine]:
    """One machine for all tests; each may leave it in any state."""
    made = Machine(start_shared, tmp_path_factory.mktemp("machine"))
    yield made
    made.close()


@pytest.fixture
def machine(shared: Machine) -> Generator[Machine]:
    """The shared machine, reset after each test."""
    yield shared
    for command in ("kill off", "manual off", "alive 3"):
        shared.box.tell(command)


def test_the_pose_on_the_bus_comes_from_servos_that_the_firmware_moves(machine: Machine) -> None:
    pilot = machine.pilot

    def drives_half_a_metre() -> None:
        x_m, there_m = pilot.odom.xy_heading[0], machine.box.show()["pose"][0]
        status = machine.hardware
        assert (status["kind"], status["board"]) == ("mega", "armed")
        assert min(status["pulse_us"]) > 1100.0
        machine.hold_until(
            lambda: pilot.odom.xy_heading[0] > x_m + 0.5 or machine.mode != "driving"
        )
        assert machine.mode == "driving"
        wait_for_mode(machine, "ready")
        wait_until(lambda: machine.box.show()["goals"] == [2048] * 6, "upright")
        seen = machine.box.show()
        assert machine.mode == "ready", machine.reason
        assert min(seen["pulses_us"]) > 1100.0, "its wheels spin on"
        moved_m = pilot.odom.xy_heading[0] - x_m
        assert abs(seen["pose"][0] - there_m - moved_m) < 0.1 * moved_m

    machine.drive()
    drives_half_a_metre()


def test_in_ready_it_stays_armed_without_any_command(machine: Machine) -> None:
    """Waits longer than the board's timeout; core messages keep the board fed under a lease."""

    def waits() -> None:
        wait_for_mode(machine, "ready")
        start_s = machine.box.show()["time_s"]
        while machine.box.show()["time_s"] < start_s + 1.2:
            assert machine.mode == "ready", machine.reason
            time.sleep(0.05)
        assert min(machine.box.show()["pulses_us"]) > 1100.0

    machine.drive()
    waits()


def test_an_operator_who_falls_silent_is_a_controlled_stop_and_no_trip(machine: Machine) -> None:
    def falls_silent() -> None:
        wait_for_mode(machine, "ready")
        # Whichever limit is exceeded first.
        reasons = ("no command for ", "the last command was based on ", "the robot's computer ")
        assert machine.reason.startswith(reasons)
        assert machine.hardware["board"] == "armed"

    machine.drive()
    falls_silent()


def keep_throwing_garbage(machine: Machine) -> None:
    """Send garbage until the robot notices."""
    for _ in range(PIECES):
        if machine.mode == "fault":
            return
        machine.box.tell("garbage 300")
        machine.pilot.drive(AHEAD, seconds=0.02)


def unplug(machine: Machine) -> None:
    """Once the board is older than one that has just lost its power."""
    machine.hold_until(lambda: machine.box.show()["time_s"] > OLD_S)
    machine.box.tell("unplug 1")


@pytest.mark.parametrize(
    ("harm", "sentence", "warning"),
    [
        pytest.param(
            unplug,
            "not connected|not answered",
            "is gone",
            id="pty pulled",
        ),
        pytest.param(
            lambda machine: machine.box.tell("freeze 1"),
            "has not answered for 100 ms",
            "has not answered for 100 ms",
            id="board frozen",
        ),
        pytest.param(
            keep_throwing_garbage,
            r"garbage on the serial line: \d+ broken packets in 0\.\d\d s",
            r"garbage on the serial line: \d+ broken packets in 0\.\d\d s",
            id="garbage",
        ),
    ],
)
def test_a_line_that_fails_stops_it_in_one_sentence_and_nothing_moves_until_it_is_armed_again(
    machine: Machine, harm: Callable[[Machine], None], sentence: str, warning: str
) -> None:
    seen = 0

    def told() -> list[str]:
        lines = [line for line in machine.bridge.errors[seen:] if "again" not in line]
        return [line for line in lines if "is back" not in line]

    def fails() -> None:
        nonlocal seen
        events, seen = len(machine.pilot.events), len(machine.bridge.errors)
        harm(machine)
        machine.hold_until(lambda: machine.mode == "fault")
        assert re.search(sentence, machine.reason), machine.reason
        wait_until(lambda: machine.box.at_rest, "stop: the board is at rest")
        faults = [text for text in machine.pilot.texts[events:] if "to fault" in text]
        assert len(faults) == 1, "one message on the page"
        assert machine.reason in faults[0]
        wait_until(told, "a message where the bridge was started")
        assert len(told()) == 1

    machine.drive()
    fails()
    machine.hold_until(lambda: machine.answers)
    assert machine.stays_at_rest(), "nothing moves, though the line is well and the stick is held"
    assert machine.mode == "fault"
    first, *more = told()
    assert re.search(warning, first)
    # On a busy machine, the simulated board may fall silent again.
    assert all("has not answered for 100 ms" in line for line in more)
    machine.drive()


def test_a_firmware_that_hangs_is_restarted_and_stays_disarmed(machine: Machine) -> None:
    machine.drive()
    resets = machine.box.show()["resets"]
    machine.box.tell("hang")
    machine.hold_until(lambda: machine.mode == "fault")
    wait_until(lambda: machine.box.show()["resets"] > resets, "the watchdog has bitten")
    wait_until(lambda: machine.box.at_rest, "at rest")
    assert machine.stays_at_rest()
    wait_until(lambda: "hung" in machine.hardware["last_trip"], "it says why")
    wait_until(lambda: "hung" in machine.hardware["past_trips"]["1"], "it is kept")
    machine.drive()


def test_a_piece_of_garbage_now_and_then_is_counted_and_stops_nobody(machine: Machine) -> None:
    def survives() -> None:
        broken = machine.hardware["link"]["broken"]
        for count in (1, 2):
            machine.box.tell("garbage 300")
            machine.hold_until(
                lambda c=count: (
                    machine.hardware["link"]["broken"] >= broken + c or machine.mode != "driving"
                )
            )
            assert machine.mode == "driving", machine.reason
        assert machine.box.drives

    machine.drive()
    survives()


def test_a_dead_servo_is_named(machine: Machine) -> None:
    machine.drive()
    machine.box.tell("dead 3")
    machine.hold_until(lambda: machine.mode == "fault")
    wait_until(lambda: machine.hardware["servos"]["alive"][2] is False, "seen in the status")
    wait_until(lambda: machine.box.shut_off, "shut off")
    machine.refuses_to_arm("servo 3 (module2_alpha): no answer")
    machine.box.tell("alive 3")
    machine.drive()


def test_the_radio_control_takes_the_robot_and_the_core_refuses_to_drive(machine: Machine) -> None:
    box = machine.box

    def takes_over() -> None:
        box.tell("manual on")
        machine.hold_until(lambda: machine.mode == "fault")
        if "radio control" not in machine.reason:
            box.tell("manual off")
            raise AssertionError(machine.reason)

    box.tell("sticks 0 0 0 0")
    machine.drive()
    takes_over()
    wait_until(lambda: box.at_rest, "at rest")

    # Move the servo deliberately, with torque off and the robot at rest. Retry if a busy machine
    # delayed a servo reply just then, because any servo could have caused that.
    def is_given() -> bool:
        box.tell("manual off")
        wait_until(lambda: machine.hardware["rc_us"][5] < 1500, "seen off")
        box.tell("manual on")
        wait_until(lambda: machine.hardware["rc_us"][5] > 1500, "seen on")
        time.sleep(0.2)
        return machine.hardware["board"] == "radio control"

    wait_until(is_given, "it has the robot")
    machine.refuses_to_arm("the radio control has the robot")
    box.tell("manual off")
    machine.drive()


def test_the_kill_switch_stops_it_and_arming_is_refused(machine: Machine) -> None:
    box = machine.box

    def kills() -> None:
        box.tell("kill on")
        machine.hold_until(lambda: machine.mode == "fault")
        if "kill switch" not in machine.reason:
            box.tell("kill off")
            raise AssertionError(machine.reason)

    machine.drive()
    kills()
    wait_until(lambda: box.at_rest, "at rest")
    machine.refuses_to_arm("the kill switch of the radio control is on")
    box.tell("kill off")
    machine.drive()


def test_a_second_bridge_at_one_port_is_refused_and_the_first_goes_on(machine: Machine) -> None:
    machine.drive()
    second = machine.start_bridge()
    machine.hold_until(lambda: second.process.poll() is not None)
    assert second.wait() == 1
    assert "is in use by another program" in second.sentence
    assert len(second.errors) == 1
    assert machine.bridge.process.poll() is None
    machine.drive()  # A busy machine may have stopped the robot while a program started.


def test_a_bridge_that_is_killed_leaves_a_board_that_stops_by_itself(machine: Machine) -> None:
    machine.drive()
    machine.bridge.process.kill()
    wait_until(lambda: machine.box.at_rest, "at rest")
    machine.restart_bridge()
    assert machine.mode == "disarmed"
    assert machine.stays_at_rest()
    machine.drive()


def test_a_bridge_that_is_told_to_end_disarms_the_board_first(machine: Machine) -> None:
    machine.drive()
    assert machine.bridge.end(signal.SIGTERM) == 0
    seen = machine.box.show()
    assert seen["mode"] == 0
    wait_until(lambda: machine.box.at_rest, "at rest")


def test_servos_at_the_pc_and_speed_controllers_at_the_board(
    machine: Machine, tmp_path: Path
) -> None:
    chain = ServoChain()
    adapter = Peer(tmp_path / "adapter", chain.answer)
    try:
        machine.restart_bridge(None, "--servos", adapter.port)
        machine.get_ready()
        machine.hold_until(
            lambda: machine.mode != "driving" or any(g != 2048 for g in chain.goals())
        )
        seen = machine.box.show()
        assert min(seen["pulses_us"]) > 1100.0
        assert seen["goals"] == [2048] * 6, "those at the board are left alone"
        assert machine.bridge.end() == 0
        assert chain.goals() == [2048] * 6
    finally:
        adapter.unplug()


class Relay:
    """A serial port behind TCP, as ser2net serves one; one client after another."""

    def __init__(self, port: str) -> None:
        self._port = serial.Serial(port, 1_000_000, timeout=0.01, exclusive=True)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"socket://127.0.0.1:{self._listener.getsockname()[1]}"
        self._connection: socket.socket | None = None
        self._ended = threading.Event()
        self._threads = [
            threading.Thread(target=self._accept),
            threading.Thread(target=self._from_board),
        ]
        for thread in self._threads:
            thread.start()

    def _accept(self) -> None:
        while not self._ended.is_set():
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._connection = connection
            try:
                while data := connection.recv(4096):
                    self._port.write(data)
            except OSError:
                continue

    def _from_board(self) -> None:
        while not self._ended.is_set():
            data = self._port.read(max(1, self._port.in_waiting))
            if data and self._connection is not None:
                try:
                    self._connection.sendall(data)
                except OSError:
                    continue

    def cut(self) -> None:
        """Break the connection."""
        if self._connection is not None:
            with contextlib.suppress(OSError):  # The other end may have closed first.
                self._connection.shutdown(socket.SHUT_RDWR)
            self._connection.close()

    def close(self) -> None:
        self._ended.set()
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self.cut()
        for thread in self._threads:
            thread.join()
        self._port.close()


def test_a_board_behind_a_socket_is_driven_and_a_cut_is_an_unplugging(machine: Machine) -> None:
    machine.bridge.end()
    relay = Relay(machine.box.port)
    try:
        machine.restart_bridge(relay.url)
        machine.drive()
        relay.cut()
        machine.hold_until(lambda: machine.mode == "fault")
        machine.hold_until(lambda: machine.hardware["connected"])
        assert machine.stays_at_rest()
        machine.drive()
        machine.bridge.end()
    finally:
        relay.close()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "--port is missing: 'tsd-bridge --list' shows what ports there are"),
        (["--port", "/dev/ttyNONE"], "/dev/ttyNONE is not there: plug it in"),
    ],
)
def test_a_mistake_ends_in_one_clear_sentence(
    start: Start, arguments: list[str], words: str
) -> None:
    bridge = start("tsd_bridge", *ANY_PORT, *arguments)
    assert bridge.wait() == 1
    assert words in bridge.sentence
    assert len(bridge.errors) == 1


def test_help_and_list_end_at_once(start: Start) -> None:
    help_ = start("tsd_bridge", "--help")
    listing = start("tsd_bridge", "--list")
    assert help_.wait() == 0
    assert listing.wait() == 0
    assert "examples:" in "\n".join(help_.output)
    assert listing.output
