"""Fault matrix of the robot in a box: distance from 1 m/s, time until the wheels are off, and steps
before the robot can move again.

`python -m tests.firmware.fault_matrix` prints the rows of docs/bridge.md.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from firmware.simulator.power import AS_DRAWN, Wiring
from firmware.simulator.simulation import FirmwareSimulation
from tests.firmware.wheel_rules import PULSES, SENSORS
from tests.support.firmware_host import CRUISE, CYCLE_S, NO_GOALS, Bench, FirmwareHost
from tsd_twin.hardware.dynamixel.control_table import BoardMode
from tsd_twin.robots import SingularityDescription, description_of_kind, load_robot

Act = Callable[[FirmwareSimulation], None]
USB_ONLY = Wiring(supply="usb")
COIL_AT_BATTERY = Wiring(coil="battery")
AUTO_RESET = Wiring(auto_reset=True, boot_loader_s=1.0)
WIRINGS = {
    AS_DRAWN: "as drawn",
    USB_ONLY: "**board fed by USB**",
    COIL_AT_BATTERY: "**coil at the battery**",
    AUTO_RESET: "**auto-reset, boot loader**",
}
_STEP_RAD = 2.0 * math.pi / 4096
_WATCHED_S = 4.0
_UPRIGHT_DEG = 0.15


@dataclass(frozen=True)
class Fault:
    """One fault while the robot drives at 1 m/s."""

    what: str
    inject: Act
    mend: Act
    before: str
    """Steps before anything moves again."""
    wiring: Wiring = AS_DRAWN
    pc: bool = True
    """Whether the PC continues to send."""
    sensors: bool = False
    """Whether the wheels have speed sensors."""
    lets_go: bool = False
    """Whether it sends the gimbals upright from the fault on."""


def _nothing(simulation: FirmwareSimulation) -> None:
    del simulation


def _dead(simulation: FirmwareSimulation, *, dead: bool) -> None:
    simulation.servos[0].dead = dead


def _jammed(simulation: FirmwareSimulation, *, jammed: bool) -> None:
    for servo in simulation.servos:
        servo.jammed = jammed


def _unplug(simulation: FirmwareSimulation, sensor: int | None) -> None:
    simulation.sensor_wheels[:] = [None if i == sensor else i for i in range(3)]


def _switches(simulation: FirmwareSimulation, *, kill: bool) -> None:
    simulation.set_switches(kill=kill)


FAULTS = (
    Fault("stop circuit opened", lambda it: it.set_contactor(closed=False),
          lambda it: it.set_contactor(closed=True), "close it, 2 s, reset, arm"),
    Fault("USB plug pulled, or PC off", lambda it: it.set_usb(plugged=False),
          lambda it: it.set_usb(plugged=True), "plug in, reset, arm", pc=False),
    Fault("USB plug pulled, or PC off", lambda it: it.set_usb(plugged=False),
          lambda it: it.set_usb(plugged=True), "plug in, press the stop once, 2 s, reset, arm",
          USB_ONLY, pc=False),
    Fault("bridge killed, or PC hangs", _nothing, _nothing, "start it, reset, arm", pc=False),
    Fault("servo fuse blown", lambda it: it.set_servo_fuse(whole=False),
          lambda it: it.set_servo_fuse(whole=True),
          "replace it, press the stop once, 2 s, reset, arm"),
    Fault("servo fuse blown", lambda it: it.set_servo_fuse(whole=False),
          lambda it: it.set_servo_fuse(whole=True),
          "replace it, press the stop once, 2 s, reset, arm", COIL_AT_BATTERY),
    Fault("battery off", lambda it: it.set_battery(0.0), lambda it: it.set_battery(12.0),
          "connect it, press the stop once, 2 s, reset, arm"),
    Fault("battery at 8.0 V", lambda it: it.set_battery(8.0), lambda it: it.set_battery(12.0),
          "charge it, 2 s, reset, arm"),
    Fault("battery at 6.0 V", lambda it: it.set_battery(6.0), lambda it: it.set_battery(12.0),
          "charge it, 2 s, reset, arm"),
    Fault("brown-out of the board, 0.1 s", lambda it: it.brown_out(0.1), _nothing,
          "2 s, reset, arm"),
    Fault("reset of the board", lambda it: it.reset(), _nothing, "2 s, reset, arm"),
    Fault("a program opens the port", lambda it: it.open_port(), _nothing, "2 s, reset, arm",
          AUTO_RESET),
    Fault("firmware hangs", lambda it: it.board.hang(), _nothing, "2 s, reset, arm"),
    Fault("servo dead", lambda it: _dead(it, dead=True), lambda it: _dead(it, dead=False),
          "mend it, 2 s, reset, arm"),
    Fault("servo loses its torque", lambda it: it.servos[0].switch_off(), _nothing,
          "2 s, reset, arm"),
    Fault("servo restarts", lambda it: it.servos[0].restart(), _nothing, "2 s, reset, arm"),
    Fault("servo shuts down: overload", lambda it: it.servos[0].shut_down(),
          lambda it: it.servos[0].recover(), "switch the servos off and on, 2 s, reset, arm"),
    Fault("all gimbals jam, the stick is let go", lambda it: _jammed(it, jammed=True),
          lambda it: _jammed(it, jammed=False), "free them, 2 s, reset, arm", lets_go=True),
    Fault("wheel 2 jams, with a sensor", lambda it: it.plant.stuck.add(1),
          lambda it: it.plant.stuck.clear(), "free it, 2 s, reset, arm", sensors=True),
    Fault("wire of a wheel sensor off", lambda it: _unplug(it, 1), lambda it: _unplug(it, None),
          "plug it in, 2 s, reset, arm", sensors=True),
    Fault("kill switch", lambda it: _switches(it, kill=True), lambda it: _switches(it, kill=False),
          "switch it off, 2 s, reset, arm"),
    Fault("receiver lost", lambda it: it.lose_receiver(), lambda it: _switches(it, kill=False),
          "bring it back, 2 s, reset, arm"),
)  # fmt: skip


@dataclass(frozen=True)
class Result:
    """Outcome of a fault."""

    off_s: float
    """When the wheels were no longer driven."""
    distance_m: float
    tilt_deg: float
    """Largest tilt that a gimbal is left at."""


def measure(fault: Fault, bench: Bench) -> Result:
    """Drive at 1 m/s, inject the fault, and see what it does; then mend it and arm.

    Nothing may move before a new arming, though the PC commands motion again and again.
    """
    robot = description_of_kind(load_robot("tsd"), SingularityDescription)
    joints = robot.kinematics().inverse(np.array([1.0, 0.0, 0.0]))
    goal = [round(angle / _STEP_RAD) for angle in joints.reshape(3, 3)[:, :2].ravel()]
    pulses, setup = (PULSES, SENSORS) if fault.sensors else (0, None)
    pilot = bench.pilot(receiver=True, wiring=fault.wiring, wheel_pulses=pulses)
    pilot.get_driving(setup=setup)
    pilot.drive(0.8, goal=goal)
    simulation = pilot.simulation
    simulation.board.receive()
    plant, start_s = simulation.plant, simulation.board.now_s
    start_m = plant.pose.xy_heading[:2].copy()
    fault.inject(simulation)
    off_s = math.inf
    while (passed_s := simulation.board.now_s - start_s) < _WATCHED_S:
        if not plant.driven:
            off_s = min(off_s, passed_s)
        _go_on(pilot, goal, fault)
    result = Result(
        off_s,
        float(np.hypot(*(plant.pose.xy_heading[:2] - start_m))),
        float(np.degrees(np.abs(plant.gimbals).max())),
    )
    fault.mend(simulation)
    for _ in range(30):
        simulation.run(CYCLE_S)
        simulation.board.send(pilot.command(1, CRUISE, goal))
        assert max(simulation.pulses_us()) < 1001.0, "it moves again by itself"
    simulation.run(2.2)
    simulation.board.receive()
    assert pilot.arm().mode == BoardMode.ARMED, pilot.telemetry()
    return result


def _go_on(pilot: FirmwareHost, goal: list[int], fault: Fault) -> None:
    """Command motion as before; the bridge would disarm, a careless program would not."""
    if fault.pc:
        goals = NO_GOALS if fault.lets_go else goal
        pilot.simulation.board.send(pilot.command(1, CRUISE, goals))
    pilot.simulation.run(CYCLE_S)


def row(fault: Fault, result: Result | None) -> list[str]:
    """Return the cells of a table row; without a result only fault and wiring."""
    cells = [fault.what, WIRINGS[fault.wiring]]
    if result is None:
        return cells
    tilt = "upright" if result.tilt_deg < _UPRIGHT_DEG else f"{result.tilt_deg:.1f}\u00b0"
    return [*cells, f"{result.off_s:.2f}", f"{result.distance_m:.2f}", tilt, fault.before]


def main() -> None:
    """Print the rows."""
    for fault in FAULTS:
        bench = Bench()
        try:
            sys.stdout.write(f"| {' | '.join(row(fault, measure(fault, bench)))} |\n")
        finally:
            bench.close()


if __name__ == "__main__":
    main()
