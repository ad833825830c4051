"""Servos are silent only while they are asked: a computer that pauses is not their fault."""

from __future__ import annotations

import numpy as np
import pytest

from tests.hardware.wired_machines import Bench
from tests.hardware.wiring_errors import BusWheels, U2D2Machine, Wired
from tsd_twin.hardware.commissioning.walk import Commissioned
from tsd_twin.hardware.link_health import SILENT_S
from tsd_twin.hardware.servo_line import ALIVE_S
from tsd_twin.messages.codes import Code, Reason
from tsd_twin.safety import Heartbeat

pytestmark = pytest.mark.computes
PERIOD_S = 0.01
MACHINES = (BusWheels, U2D2Machine)


class Loop:
    """Control loop at a machine in virtual time, whose computer may pause."""

    def __init__(self, patch: pytest.MonkeyPatch, machine: type[Wired]) -> None:
        self.bench = Bench(patch)
        self.machine = machine(self.bench)
        self.io: Commissioned = self.machine.connect()
        self._rest = np.zeros(len(self.machine.robot.kinematics().joints))
        self._beats = 0
        self.run(0.5)

    @property
    def code(self) -> str | None:
        fault = self.io.fault(self.bench.clock.now_s)
        return fault.code if isinstance(fault, Reason) else None

    def run(self, seconds: float) -> list[str | None]:
        """Run for a time; return the fault of each period."""
        end_s, codes = self.bench.clock.now_s + seconds, []
        while self.bench.clock.now_s < end_s:
            self._beats += 1
            self.io.set_heartbeat(Heartbeat(False, self._beats))
            self.io.write(self._rest, self.bench.clock.now_s)
            for cycle in self.bench.idle:
                cycle()
            self.io.read(self.bench.clock.now_s)
            codes.append(self.code)
            self.bench.clock.advance(PERIOD_S)
        return codes


@pytest.mark.parametrize("machine", MACHINES)
@pytest.mark.parametrize("pause_s", [1.1 * ALIVE_S, 0.9 * SILENT_S])
def test_short_pause_of_the_computer_is_no_fault(
    monkeypatch: pytest.MonkeyPatch, machine: type[Wired], pause_s: float
) -> None:
    loop = Loop(monkeypatch, machine)
    assert loop.code is None
    loop.bench.clock.advance(pause_s - PERIOD_S)
    assert loop.code is None
    assert set(loop.run(0.3)) == {None}


@pytest.mark.parametrize("machine", MACHINES)
def test_long_pause_is_a_fault_of_the_line(
    monkeypatch: pytest.MonkeyPatch, machine: type[Wired]
) -> None:
    loop = Loop(monkeypatch, machine)
    loop.bench.clock.advance(1.1 * SILENT_S)
    assert loop.code in (Code.DEVICE_SILENT, Code.WHEELS_SILENT)


@pytest.mark.parametrize("machine", MACHINES)
def test_silent_servo_is_found_within_its_time(
    monkeypatch: pytest.MonkeyPatch, machine: type[Wired]
) -> None:
    loop = Loop(monkeypatch, machine)
    it = loop.machine
    servos = it.servos if isinstance(it, BusWheels) else it.chain.servos
    servos[1].dead = True
    began_s = loop.bench.clock.now_s
    while loop.code is None:
        loop.run(PERIOD_S)
    assert loop.code == Code.SERVOS_SILENT
    assert loop.bench.clock.now_s - began_s < ALIVE_S + 6.0 * PERIOD_S  # Two exchanges time out.
