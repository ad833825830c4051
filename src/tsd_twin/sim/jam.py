"""Gimbals that stick: a fault to inject, for whoever wants to see that it is noticed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsd_twin.drives import JointKind
from tsd_twin.errors import TwinError
from tsd_twin.lie import Array
from tsd_twin.robots import Robot
from tsd_twin.sim.sim_robot import SimRobot

USUAL_LEAN_DEG = 2.0


@dataclass(frozen=True, slots=True)
class Jam:
    """A servo that turns no more, whatever it is told, once its gimbal leans so far."""

    joint: str
    lean_rad: float = 0.0

    @staticmethod
    def parse(text: str, robot: Robot) -> Jam:
        """Return the jam in `module2_alpha` or `module2_alpha@3`, where 3 is in degrees.

        Raises:
            TwinError: it is none, or the robot has no such gimbal.
        """
        joint, _, lean = text.partition("@")
        gimbals = [j.name for j in robot.kinematics().joints if j.kind is JointKind.POSITION]
        if joint not in gimbals:
            there = f"there are {', '.join(gimbals)}" if gimbals else "it has none"
            raise TwinError(f"--jam: '{joint}' is no gimbal of {robot.name}: {there}")
        try:
            lean_deg = float(lean) if lean else USUAL_LEAN_DEG
        except ValueError:
            lean_deg = math.nan
        if not 0.0 <= lean_deg < 90.0:
            raise TwinError(f"--jam: '{lean}' has to be degrees, from 0 to less than 90")
        return Jam(joint, math.radians(lean_deg))


class JammedRobot(SimRobot):
    """A simulated robot with gimbals that stick; all else is as it was."""

    def __init__(self, robot: Robot, jams: Sequence[Jam] = (), **kwargs: Any) -> None:
        """Take what a `SimRobot` takes besides."""
        super().__init__(robot, **kwargs)
        self._names = [joint.name for joint in robot.kinematics().joints]
        self._leans: dict[int, float] = {}
        self._held: dict[int, float] = {}
        for jam in jams:
            self.jam(jam)

    def jam(self, jam: Jam) -> None:
        """Let a gimbal stick from now on."""
        self._leans[self._names.index(jam.joint)] = jam.lean_rad

    def write(self, setpoint: Array, now_s: float) -> None:
        """Give the actuators their set-points (n,), those that stick the one that they are at."""
        joints = self.truth(now_s).joints
        for place, lean_rad in self._leans.items():
            if abs(joints[place]) >= lean_rad:
                self._held.setdefault(place, float(joints[place]))
        if self._held and np.shape(setpoint) == np.shape(joints):
            setpoint = setpoint.copy()
            setpoint[list(self._held)] = list(self._held.values())
        super().write(setpoint, now_s)
