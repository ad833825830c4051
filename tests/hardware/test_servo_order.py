"""A servo that does not answer is named alone, also where the servos behind it wait for it, and a
short pause of the line silences none.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.hardware.test_mega import ROBOT
from tests.hardware.test_wheel_bus import KIWI
from tests.support.pty_devices import ServoChain
from tests.support.wheel_matrix import PERIOD_S, VirtualLine
from tests.support.x_series import XBus, XServo
from tsd_twin.hardware import u2d2
from tsd_twin.hardware.joints import JointCommand, JointConverter, ServoCalibration
from tsd_twin.hardware.serial_transport import SerialTransport
from tsd_twin.hardware.servo_line import MEASURED, ServoLine
from tsd_twin.hardware.u2d2 import ServoBus
from tsd_twin.hardware.wheel_bus import WheelBus
from tsd_twin.messages.codes import Code
from tsd_twin.safety import Heartbeat
from tsd_twin.simulation import Motors

pytestmark = pytest.mark.computes
START_S = 100.0
CYCLES = 60
PAUSE_S = 0.035
HELD_UP_S = 0.004
"""Time until the I/O thread begins a cycle that is due."""


class HeldUpLine(VirtualLine):
    """Line of an I/O thread that begins each cycle somewhat late."""

    def __init__(self, bus: ServoChain | XBus) -> None:
        super().__init__(bus, START_S)
        self._next_s = START_S

    def wait(self) -> None:
        """Let the time pass until the node has asked for a cycle, maybe within the last."""
        self.pass_time(max(0.0, self._next_s - self.now_s) + HELD_UP_S)
        self._next_s = START_S + PERIOD_S * (1 + (self.now_s - START_S) // PERIOD_S)

    @property
    def transport(self) -> SerialTransport:
        return cast("Any", self)


@given(st.permutations(range(1, 7)), st.sets(st.integers(1, 6)), st.booleans())
def test_each_living_servo_answers_after_as_many_cycles_as_servos_are_dead(
    ids: list[int], dead: set[int], waits: bool
) -> None:
    bus = XBus([XServo(device, dead=device in dead) for device in ids])
    bus.waits = waits
    line, transport = ServoLine(ids, [str(i) for i in ids], {}, ""), HeldUpLine(bus).transport
    living = set(ids) - dead
    for _ in range(len(dead)):
        line.read_all(transport, b"", MEASURED, lambda _: None)
    for _ in range(10):
        answered, _ = line.read_all(transport, b"", MEASURED, lambda _: None)
        assert set(answered) == living


class Gimbals:
    """Six servos on a line of the computer, in virtual time."""

    def __init__(self, patch: pytest.MonkeyPatch, *, waits: bool = False) -> None:
        self.chain = ServoChain()
        self.chain.waits = waits
        self.line = HeldUpLine(self.chain)
        patch.setattr(u2d2, "time", SimpleNamespace(monotonic=lambda: self.line.now_s))
        self.joints = JointConverter(ROBOT, Motors.of(ROBOT))
        self._bus = ServoBus(self.joints, ServoCalibration())
        self._bus.connect(self.line.transport)

    def silent(self, pause_s: float = 0.0) -> int:
        """Do a cycle, in a pause of the line; return the servos that were silent for too long."""
        self.line.wait()
        if pause_s:
            self.line.held_until_s = self.line.now_s + pause_s
        before = self._bus.report
        self._bus.cycle(self.line.transport)
        return self.joints.servos & ~before.alive(self.line.now_s) if before else 0


@pytest.mark.parametrize("waits", [False, True])
@pytest.mark.parametrize("dead", range(6))
def test_a_dead_servo_of_a_gimbal_silences_no_other(
    monkeypatch: pytest.MonkeyPatch, dead: int, waits: bool
) -> None:
    gimbals = Gimbals(monkeypatch, waits=waits)
    silent: set[int] = set()
    for i in range(CYCLES):
        gimbals.chain.servos[dead].dead = i > 9
        silent.add(gimbals.silent())
    assert silent == {0, 1 << dead}


@pytest.mark.parametrize("cycle", range(10, 18))
def test_a_short_pause_of_the_line_silences_no_servo(
    monkeypatch: pytest.MonkeyPatch, cycle: int
) -> None:
    """In whichever cycle, as some have a second request."""
    gimbals = Gimbals(monkeypatch)
    for i in range(CYCLES):
        assert not gimbals.silent(PAUSE_S if i == cycle else 0.0)


@pytest.mark.parametrize("waits", [False, True])
@pytest.mark.parametrize("dead", range(3))
def test_a_dead_servo_of_a_wheel_silences_no_other(dead: int, waits: bool) -> None:
    bus = XBus([XServo(device) for device in (1, 2, 3)])
    bus.waits = waits
    line = HeldUpLine(bus)
    wheels = WheelBus(KIWI, ServoCalibration(), clock=lambda: line.now_s)
    wheels.connect(line.transport)
    codes: set[str] = set()
    for i in range(CYCLES):
        bus.servos[dead].dead = i > 9
        armed = i > 1
        wheels.command = JointCommand(np.zeros(3), Heartbeat(armed, i), line.now_s)
        line.wait()
        wheels.cycle(line.transport)
        codes |= {wheels.trouble.code} if wheels.trouble is not None and armed else set()
    assert codes == {Code.SERVOS_SILENT}
    assert wheels.trouble is not None
    assert wheels.trouble.params["servos"] == wheels.names.named(1 << dead)
