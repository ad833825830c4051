"""Fault matrix of robots on Dynamixel wheels in virtual time: time until wheels are off.

`python -m tests.support.wheel_matrix` prints the rows of docs/wheels.md.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from tests.support.pty_devices import ServoChain
from tests.support.robot_variants import WHEEL_ROBOTS
from tests.support.x_series import XBus, XServo
from tsd_twin import robots
from tsd_twin.hardware.dynamixel.packets import Decoder, Framing, StatusPacket, protocol2
from tsd_twin.hardware.joints import JointCommand, ServoCalibration
from tsd_twin.hardware.serial_transport import HardwareError
from tsd_twin.hardware.wheel_bus import WheelBus
from tsd_twin.messages.codes import Code, Reason
from tsd_twin.robots import OmniDescription, description_of_kind
from tsd_twin.safety import Heartbeat

PERIOD_S = 0.01
_BYTE_S, _TURN_S = 1e-5, 0.0005
_RECONNECT_S = 0.25
_WATCHED_S = 2.0


R = TypeVar("R")


@dataclass(frozen=True)
class Fault(Generic[R]):
    """Fault of a driving robot with a machine of type `R`."""

    what: str
    inject: Callable[[R], object]
    mend: Callable[[R], object]
    before: str
    """Steps before anything moves again."""
    codes: frozenset[str]
    mega_s: float
    """Time until the wheels are off after the same fault on a robot with the Mega."""


class VirtualLine:
    """Serial line in virtual time, used like a `SerialTransport`."""

    name = "line"

    def __init__(self, bus: XBus | ServoChain, now_s: float) -> None:
        self.bus, self.now_s = bus, now_s
        self.held_until_s = now_s
        """Injected fault: nothing arrives before this time."""
        self.broken = self.late = 0
        self.plugged = True
        self.on_time: Callable[[], None] = lambda: None

    def pass_time(self, seconds: float) -> None:
        """Advance the time in steps of 2 ms."""
        end_s = self.now_s + seconds
        while self.now_s < end_s - 1e-9:
            self.now_s = min(end_s, self.now_s + 0.002)
            self.bus.live(self.now_s)
            self.on_time()

    def request(
        self, request: bytes, answers: int, patience_s: float, framing: Framing = protocol2
    ) -> list[StatusPacket]:
        """Exchange bytes, and let their transmission time pass."""
        if not self.plugged:
            raise HardwareError(f"{self.name} is gone")
        if self.held_until_s > self.now_s + patience_s:
            self.pass_time(patience_s)
            return []
        self.pass_time(self.held_until_s - self.now_s)
        self.pass_time(_BYTE_S * len(request))
        out = self.bus.answer(request, self.now_s)
        decoder = Decoder(framing)
        found = [framing.as_status(packet) for packet in decoder.feed(out, self.now_s)]
        statuses = [status for status in found if status is not None]
        self.broken += decoder.sum_errors + bool(decoder.skipped)
        complete = len(statuses) >= answers
        self.pass_time(_BYTE_S * len(out) + _TURN_S if complete else patience_s)
        return statuses


class WheelRig:
    """Robot, bridge and a node that keeps commanding, in virtual time."""

    def __init__(self, name: str) -> None:
        given = WHEEL_ROBOTS[name]
        self.robot = description_of_kind(
            robots.parse_description(given.text, name), OmniDescription
        )
        self.drive = self.robot.kinematics()
        self.servos = [XServo(i + 1, given.model, volts=given.volts) for i in range(given.wheels)]
        self.line = VirtualLine(XBus(self.servos), 100.0)
        self.bus = WheelBus(self.robot, ServoCalibration(), clock=lambda: self.line.now_s)
        self.bus.connect(self.line)  # type: ignore[arg-type]
        self.connected = True
        self.bridge_runs = self.node_runs = self.operator_speaks = True
        self.armed = False
        self.codes: list[str] = []
        self.way_m = 0.0
        self._speed_mps = 0.9 * self.robot.limits.speed_mps
        self.off_s = self._harmed_s = 0.0
        self._beat, self._retry_s, self._lived_s = 0, 0.0, 100.0
        self.line.on_time = self._watch

    @property
    def driven(self) -> bool:
        return any(servo.driven for servo in self.servos)

    def _watch(self) -> None:
        now_s = self.line.now_s
        speeds = np.array([servo.speed_rad_per_s for servo in self.servos])
        if self._harmed_s:
            self.way_m += float(self.drive.forward(speeds).twist[0]) * (now_s - self._lived_s)
            if not self.driven and not self.off_s:
                self.off_s = now_s - self._harmed_s
            if self.driven:
                self.off_s = 0.0
        self._lived_s = now_s

    def tick(self) -> None:
        """Run one node period."""
        next_s = self.line.now_s + PERIOD_S
        if self.node_runs:
            self._beat += self.operator_speaks
            speed_mps = self._speed_mps if self.armed else 0.0
            setpoint = self.drive.inverse([speed_mps, 0.0, 0.0])
            beat = Heartbeat(self.armed, self._beat)
            self.bus.command = JointCommand(setpoint, beat, self.line.now_s)
        if self.bridge_runs:
            self._cycle()
        self.line.pass_time(max(0.0, next_s - self.line.now_s))

    def _cycle(self) -> None:
        try:
            if not self.connected:
                if self.line.now_s < self._retry_s:
                    return
                self.bus.connect(self.line)  # type: ignore[arg-type]
                self.connected = True
            self.bus.cycle(self.line)  # type: ignore[arg-type]
        except HardwareError as error:
            self.bus.health.add_disconnect(str(error))
            self.bus.disconnected()
            self.connected, self._retry_s = False, self.line.now_s + _RECONNECT_S
        reason: Reason | None = self.bus.lost or self.bus.trouble
        if reason is not None and (not self.codes or self.codes[-1] != reason.code):
            self.codes.append(reason.code)

    def run(self, seconds: float) -> None:
        end_s = self.line.now_s + seconds
        while self.line.now_s < end_s:
            self.tick()

    def get_driving(self) -> bool:
        """Disarm, arm and drive; return whether the wheels turn."""
        self.armed = False
        self.run(0.5)
        self.armed = True
        self.run(0.5)
        return self.driven

    def harm(self, fault: Fault[WheelRig]) -> None:
        """Inject a fault while driving and measure the result."""
        assert self.get_driving()
        self.codes.clear()
        self._harmed_s, self.way_m, self.off_s = self.line.now_s, 0.0, 0.0
        fault.inject(self)
        self.run(_WATCHED_S)


Act = Callable[[WheelRig], object]


def _all(it: WheelRig, act: Callable[[XServo], object]) -> None:
    for servo in it.servos:
        act(servo)


def _unplug(it: WheelRig, *, cuts_power: bool = False) -> None:
    it.line.plugged = False
    if cuts_power:
        _all(it, XServo.restart)


def _plug(it: WheelRig) -> None:
    it.line.plugged = True


def _set(it: object, **values: object) -> None:
    for name, value in values.items():
        setattr(it, name, value)


def _first(name: str, value: object) -> Act:
    return lambda it: setattr(it.servos[0], name, value)


def _overheat(it: WheelRig) -> None:
    it.servos[0].temperature_c = it.robot.servo_limit_c + 2.0


def _cool(it: WheelRig) -> None:
    it.servos[0].temperature_c = 35.0
    it.servos[0].restart()


def _warm(it: WheelRig) -> None:
    it.servos[0].temperature_c = it.robot.servo_limit_c - 5.0


AGAIN = "reset, arm"
FAULTS = (
    Fault("answers of a servo missing", _first("mute", True), _first("mute", False),
          f"mend it, {AGAIN}", frozenset({Code.SERVOS_SILENT}), 0.06),
    Fault("data wire of one servo off", _first("dead", True), _first("dead", False),
          f"mend it, {AGAIN}", frozenset({Code.SERVOS_SILENT}), 0.50),
    Fault("servo loses its torque", lambda it: it.servos[0].write(64, b"\0"), lambda _: None,
          AGAIN, frozenset({Code.SERVO_LIMP}), 0.08),
    Fault("servo restarts", lambda it: it.servos[0].restart(), lambda _: None, AGAIN,
          frozenset({Code.SERVO_LIMP, Code.SERVOS_RESTARTED}), 0.08),
    Fault("servo within 5 °C of its limit", _warm, _cool, f"let it cool, {AGAIN}",
          frozenset({Code.SERVO_TOO_HOT}), 0.08),
    Fault("servo shuts down: overheated", _overheat, _cool,
          f"switch the servos off and on, {AGAIN}",
          frozenset({Code.SERVO_ERROR, Code.SERVO_TOO_HOT, Code.SERVO_LIMP}), 0.08),
    Fault("data wire of the bus off", lambda it: _set(it.line.bus, silent=True),
          lambda it: _set(it.line.bus, silent=False), f"mend it, {AGAIN}",
          frozenset({Code.ALL_SERVOS_SILENT, Code.DEVICE_SILENT}), 0.50),
    Fault("supply or fuse of the servos", lambda it: _all(it, lambda s: s.set_power(False)),
          lambda it: _all(it, lambda s: s.set_power(True)), f"replace it, {AGAIN}",
          frozenset({Code.ALL_SERVOS_SILENT, Code.DEVICE_SILENT}), 0.02),
    Fault("USB plug pulled", _unplug, _plug, f"plug in, {AGAIN}",
          frozenset({Code.DEVICE_DISCONNECTED}), 0.50),
    Fault("OpenRB-150 reset", lambda it: _unplug(it, cuts_power=True), _plug, AGAIN,
          frozenset({Code.DEVICE_DISCONNECTED}), 0.50),
    Fault("bridge killed, or PC hangs", lambda it: _set(it, bridge_runs=False),
          lambda it: _set(it, bridge_runs=True), f"start it, {AGAIN}",
          frozenset({Code.NODE_HANGS, Code.DEVICE_SILENT, Code.WATCHDOG_EXPIRED,
                     Code.ALL_SERVOS_SILENT}), 0.50),
    Fault("robot node hangs", lambda it: _set(it, node_runs=False),
          lambda it: _set(it, node_runs=True), AGAIN, frozenset({Code.NODE_HANGS}), 0.50),
    Fault("no word of an operator", lambda it: _set(it, operator_speaks=False),
          lambda it: _set(it, operator_speaks=True), AGAIN, frozenset({Code.HEARTBEAT_LOST}), 0.52),
    Fault("a wheel jams", _first("jammed", True), _first("jammed", False), f"free it, {AGAIN}",
          frozenset({Code.WHEEL_STUCK}), 0.32),
    Fault("battery below `stop_v`", lambda it: _all(it, lambda s: setattr(s, "volts", 9.1)),
          lambda it: _all(it, lambda s: setattr(s, "volts", 12.0)), f"charge it, {AGAIN}",
          frozenset({Code.BATTERY_EMPTY}), 1.02),
    Fault("STOP", lambda it: _set(it, armed=False), lambda _: None, AGAIN, frozenset(), 0.02),
)  # fmt: skip


def row(name: str, fault: Fault[WheelRig]) -> str:
    """Return the row of a fault."""
    rig = WheelRig(name)
    rig.harm(fault)
    return f"| {fault.what} | {rig.off_s:.2f} | {rig.way_m:.2f} | {fault.before} |"


if __name__ == "__main__":
    for each in FAULTS:
        sys.stdout.write(row("kiwi", each) + "\n")
