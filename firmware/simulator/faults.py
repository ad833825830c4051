# SPDX-License-Identifier: GPL-3.0-or-later
"""Fault injection for the simulated robot, one command per line."""

from __future__ import annotations

import json
import os
from collections.abc import Callable

from firmware.simulator.mx64 import Mx64
from firmware.simulator.real_time import RealTimeSimulation
from tsd_twin.hardware.dynamixel.control_table import ADDRESS


def _switch(word: str) -> bool:
    return {"on": True, "closed": True, "whole": True, "off": False, "open": False, "blown": False}[
        word
    ]


def show(robot: RealTimeSimulation) -> str:
    """Return the state of the robot and its actuator setpoints as one line of JSON."""
    simulation = robot.simulation
    timing = simulation.board.timing()
    return json.dumps(
        {
            "time_s": round(simulation.board.now_s, 6),
            "pulses_us": simulation.pulses_us(),
            "goals": [servo.goal for servo in simulation.servos],
            "torque": [servo.torque for servo in simulation.servos],
            "gimbals_rad": simulation.plant.gimbals.tolist(),
            "pose": simulation.plant.pose.xy_heading.tolist(),
            "mode": simulation.board.peek(simulation.table_address + ADDRESS["mode"]),
            "resets": simulation.board.resets,
            "wheels_rad_per_s": simulation.plant.wheel_speeds.tolist(),
            "drive_v": round(simulation.power.drive_v, 2),
            "interrupt_cycles": timing.interrupts,
            "lost_bytes": timing.lost,
            "stack_bytes": timing.stack,
        }
    )


class FaultCommands:
    """Parser of fault commands for a simulated robot."""

    def __init__(self, robot: RealTimeSimulation) -> None:
        self._robot = robot
        self._kill = self._manual = False
        simulation = robot.simulation
        self._commands: dict[str, Callable[..., object]] = {
            "show": lambda: print(show(robot), flush=True),  # noqa: T201
            "hang": simulation.board.hang,
            "reset": simulation.reset,
            "brownout": lambda seconds: simulation.brown_out(float(seconds)),
            "fuse": lambda word: simulation.set_servo_fuse(whole=_switch(word)),
            "freeze": lambda seconds: robot.freeze(float(seconds)),
            "unplug": lambda seconds: robot.unplug(float(seconds)),
            "garbage": lambda count: robot.garbage(os.urandom(int(count))),
            "dead": lambda number: self._dead(number, dead=True),
            "alive": lambda number: self._dead(number, dead=False),
            "limp": lambda number: self._servo(number).switch_off(),
            "restart": lambda number: self._servo(number).restart(),
            "overload": lambda number: self._servo(number).shut_down(),
            "battery": lambda volts: simulation.set_battery(float(volts)),
            "contactor": lambda word: simulation.set_contactor(closed=_switch(word)),
            "sticks": lambda *words: simulation.set_sticks(*map(float, words)),
            "kill": lambda word: self._switches(kill=_switch(word)),
            "manual": lambda word: self._switches(manual=_switch(word)),
            "lose": simulation.lose_receiver,
            "jam": lambda number: simulation.plant.stuck.add(int(number) - 1),
            "loosen": lambda number: simulation.plant.stuck.discard(int(number) - 1),
            "sensor": lambda number, word: self._sensor(int(number) - 1, on=_switch(word)),
        }

    @property
    def names(self) -> str:
        """All commands as text."""
        return ", ".join(self._commands)

    def run(self, line: str) -> None:
        """Run the command in a line; if it is invalid, print the valid commands."""
        name, *words = line.split() or [""]
        try:
            self._commands[name](*words)
        except (KeyError, TypeError, ValueError):
            print(f"not understood: {line.strip()!r}; there are {self.names}", flush=True)  # noqa: T201

    def _dead(self, number: str, *, dead: bool) -> None:
        self._servo(number).dead = dead

    def _sensor(self, wheel: int, *, on: bool) -> None:
        self._robot.simulation.sensor_wheels[wheel] = wheel if on else None

    def _servo(self, number: str) -> Mx64:
        return self._robot.simulation.servo_bus.servos[int(number)]

    def _switches(self, kill: bool | None = None, manual: bool | None = None) -> None:
        self._kill = self._kill if kill is None else kill
        self._manual = self._manual if manual is None else manual
        self._robot.simulation.set_switches(kill=self._kill, manual=self._manual)
