# SPDX-License-Identifier: GPL-3.0-or-later
"""Fault injection for the simulated robot, one command a line."""

from __future__ import annotations

import json
import os
from collections.abc import Callable

from firmware.simulator.box import Box
from tsd_twin.dynamixel.control_table import ADDRESS


def _switch(word: str) -> bool:
    return {"on": True, "off": False}[word]


def show(box: Box) -> str:
    """Return one line of JSON: where the robot is, and what its actuators are told."""
    rig = box.rig
    return json.dumps(
        {
            "time_s": round(rig.board.now_s, 6),
            "pulses_us": rig.pulses_us(),
            "goals": [servo.goal for servo in rig.servos],
            "torque": [servo.torque for servo in rig.servos],
            "gimbals_rad": rig.body.gimbals.tolist(),
            "pose": rig.body.pose.xy_heading.tolist(),
            "mode": rig.board.peek(rig.table_address + ADDRESS["mode"]),
            "resets": rig.board.resets,
        }
    )


class Faults:
    """Parser of fault commands, applied to one simulated robot."""

    def __init__(self, box: Box) -> None:
        self._box = box
        self._kill = self._manual = False
        rig = box.rig
        self._commands: dict[str, Callable[..., object]] = {
            "show": lambda: print(show(box), flush=True),  # noqa: T201
            "hang": rig.board.hang,
            "reset": rig.board.reset,
            "freeze": lambda seconds: box.freeze(float(seconds)),
            "unplug": lambda seconds: box.unplug(float(seconds)),
            "garbage": lambda count: box.garbage(os.urandom(int(count))),
            "dead": lambda number: self._dead(number, dead=True),
            "alive": lambda number: self._dead(number, dead=False),
            "battery": lambda volts: rig.set_battery(float(volts)),
            "sticks": lambda *words: rig.set_sticks(*map(float, words)),
            "kill": lambda word: self._switches(kill=_switch(word)),
            "manual": lambda word: self._switches(manual=_switch(word)),
            "lose": rig.lose_receiver,
        }

    @property
    def names(self) -> str:
        """All commands, for people."""
        return ", ".join(self._commands)

    def obey(self, line: str) -> None:
        """Run the command of a line; report the valid commands if it is none."""
        name, *words = line.split() or [""]
        try:
            self._commands[name](*words)
        except (KeyError, TypeError, ValueError):
            print(f"not understood: {line.strip()!r}; there are {self.names}", flush=True)  # noqa: T201

    def _dead(self, number: str, *, dead: bool) -> None:
        self._box.rig.chain.servos[int(number)].dead = dead

    def _switches(self, kill: bool | None = None, manual: bool | None = None) -> None:
        self._kill = self._kill if kill is None else kill
        self._manual = self._manual if manual is None else manual
        self._box.rig.set_switches(kill=self._kill, manual=self._manual)
