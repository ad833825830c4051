"""Fault matrix of a singularity drive with servos on a U2D2 and VESC on CAN, in virtual time.

`python -m tests.hardware.can_matrix` prints the rows of docs/wheels.md.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable

import numpy as np
import pytest

from tests.hardware.wired_machines import Bench
from tests.hardware.wiring_errors import TSD, U2D2Machine
from tests.support.pty_devices import COOL_C, HOT_C
from tests.support.wheel_matrix import PERIOD_S, Fault
from tsd_twin.kinematics import JointKind
from tsd_twin.messages.codes import Code, Reason
from tsd_twin.safety import Heartbeat

_WATCHED_S = 2.0
_ARM_S = 2.5
AGAIN = "reset, arm"


class CanRig:
    """Machine and bridge, and a node that commands motion until a fault disarms it."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.bench = Bench(patch)
        self.machine = U2D2Machine(self.bench)
        self.io = self.machine.connect()
        self.bridge_runs = self.node_runs = self.operator_speaks = True
        self.armed = False
        self.codes: list[str] = []
        self.off_s = self._harmed_s = 0.0
        self._beat = 0
        wheel = np.array([j.kind is JointKind.VELOCITY for j in TSD.kinematics().joints])
        self._ahead = wheel * TSD.wheel_speed_range.least_rad_per_s
        self.bench.clock.machines.append(self._watch)

    @property
    def driven(self) -> bool:
        return self.machine.driven

    def _watch(self, now_s: float) -> None:
        if self.driven:
            self.off_s = math.inf
        elif math.isinf(self.off_s):
            self.off_s = now_s - self._harmed_s

    def tick(self) -> None:
        """Let a period of the node pass."""
        clock = self.bench.clock
        next_s = clock.now_s + PERIOD_S
        if self.bridge_runs and self.node_runs:
            self._beat += self.operator_speaks
            self.io.set_heartbeat(Heartbeat(self.armed, self._beat))
            self.io.write(self._ahead * self.armed, clock.now_s)  # Both lines exchange.
            self.io.read(clock.now_s)
            fault = self.io.fault(clock.now_s)
            if isinstance(fault, Reason) and self.armed:
                self.codes.append(fault.code)
                self.armed = False
        elif self.bridge_runs:
            for cycle in self.bench.idle:
                cycle()
        clock.advance(max(1e-6, next_s - clock.now_s))

    def run(self, seconds: float) -> None:
        end_s = self.bench.clock.now_s + seconds
        while self.bench.clock.now_s < end_s:
            self.tick()

    def get_driving(self) -> bool:
        """Disarm, arm and drive; return whether the wheels turn."""
        self.armed = False
        self.run(0.5)
        self.armed = True
        self.run(_ARM_S)
        return self.driven

    def harm(self, fault: Fault[CanRig]) -> None:
        """Inject a fault while driving, and watch what happens."""
        assert self.get_driving(), self.codes
        self.codes.clear()
        self._harmed_s = self.bench.clock.now_s
        fault.inject(self)
        self.run(_WATCHED_S)


Act = Callable[[CanRig], object]


def _set(it: object, **values: object) -> None:
    for name, value in values.items():
        setattr(it, name, value)


def _motors(*numbers: int, **values: object) -> Act:
    return lambda it: it.machine.set_motors(*numbers, **values)


def _servo(**values: object) -> Act:
    return lambda it: _set(it.machine.chain.servos[2], **values)


def _servos(**values: object) -> Act:
    return lambda it: [_set(servo, **values) for servo in it.machine.chain.servos]


FAULTS = (
    Fault("controller of a wheel silent", _motors(2, mute=True), _motors(2, mute=False),
          f"mend it, {AGAIN}", frozenset({Code.WHEELS_SILENT}), 0.50),
    Fault("CAN wires off", _motors(1, 2, 3, mute=True, deaf=True),
          _motors(1, 2, 3, mute=False, deaf=False), f"mend them, {AGAIN}",
          frozenset({Code.WHEELS_SILENT}), 0.50),
    Fault("controller hot", _motors(2, temperature_c=95.0), _motors(2, temperature_c=30.0),
          f"let it cool, {AGAIN}", frozenset({Code.WHEEL_FAULT}), 0.08),
    Fault("servo dead", _servo(dead=True), _servo(dead=False), f"mend it, {AGAIN}",
          frozenset({Code.SERVOS_SILENT}), 0.06),
    Fault("servo loses its torque", lambda it: it.machine.chain.servos[2].switch_off(),
          lambda _: None, AGAIN, frozenset({Code.SERVO_LIMP}), 0.08),
    Fault("servo hot", _servo(temperature_c=HOT_C), _servo(temperature_c=COOL_C),
          f"let it cool, {AGAIN}", frozenset({Code.SERVO_TOO_HOT}), 0.08),
    Fault("servo shuts down", lambda it: it.machine.chain.servos[2].shut_down(),
          lambda it: it.machine.chain.servos[2].recover(), f"switch it off and on, {AGAIN}",
          frozenset({Code.SERVO_ERROR, Code.SERVO_LIMP}), 0.08),
    Fault("data wire of the servos off", _servos(dead=True), _servos(dead=False),
          f"mend it, {AGAIN}", frozenset({Code.ALL_SERVOS_SILENT, Code.DEVICE_SILENT}), 0.50),
    Fault("bridge killed, or PC hangs", lambda it: _set(it, bridge_runs=False),
          lambda it: _set(it, bridge_runs=True), f"start it, {AGAIN}", frozenset(), 0.50),
    Fault("robot node hangs", lambda it: _set(it, node_runs=False),
          lambda it: _set(it, node_runs=True), AGAIN, frozenset(), 0.50),
    Fault("no word of an operator", lambda it: _set(it, operator_speaks=False),
          lambda it: _set(it, operator_speaks=True), AGAIN, frozenset(), 0.52),
    Fault("battery below `stop_v`", _motors(1, 2, 3, volts=9.0), _motors(1, 2, 3, volts=24.0),
          f"charge it, {AGAIN}", frozenset({Code.BATTERY_EMPTY}), 1.02),
    Fault("STOP", lambda it: _set(it, armed=False), lambda _: None, AGAIN, frozenset(), 0.02),
)  # fmt: skip


def row(patch: pytest.MonkeyPatch, fault: Fault[CanRig]) -> str:
    """Return the row of a fault."""
    rig = CanRig(patch)
    rig.harm(fault)
    return f"| {fault.what} | {rig.off_s:.2f} | {fault.before} |"


def rows() -> list[str]:
    """Return all rows."""
    made: list[str] = []
    for fault in FAULTS:
        with pytest.MonkeyPatch.context() as patch:
            made.append(row(patch, fault))
    return made


if __name__ == "__main__":
    sys.stdout.write("\n".join(rows()) + "\n")
