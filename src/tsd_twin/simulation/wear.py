"""Simulated robots with stuck joints, and with parts that wear."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsd_twin.errors import TwinError
from tsd_twin.kinematics import JointKind
from tsd_twin.lie import Array
from tsd_twin.robots import RobotDescription
from tsd_twin.simulation.robot import SimRobot

USUAL_LEAN_DEG = 2.0


@dataclass(frozen=True, slots=True)
class StuckJoint:
    """Injected fault: a servo that blocks once its gimbal reaches an angle."""

    joint: str
    lean_rad: float = 0.0

    @staticmethod
    def parse(text: str, robot: RobotDescription) -> StuckJoint:
        """Parse a fault such as `module2_alpha` or `module2_alpha@3`, where 3 is in degrees.

        Raises:
            TwinError: If the text is malformed, or the robot has no such gimbal.
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
        return StuckJoint(joint, math.radians(lean_deg))


_NUMBER = r"\d+(?:\.\d+)?"
_FORM = re.compile(rf"(?P<part>\w+)=-(?P<size>{_NUMBER})(?P<unit>%|V)(?:@(?P<after>{_NUMBER}))?")
BATTERY = "battery"
_DRIVING = 0.02
"""True speed (m/s or rad/s) above which the robot counts as driving."""


@dataclass(frozen=True, slots=True)
class Wear:
    """Wear after some driving time: a slower joint, or a lower battery voltage."""

    part: str
    """Name of a joint, or `battery`."""
    lost: float
    """Fractional speed loss of the joint, or volts."""
    after_s: float = 0.0
    """Driving time before the wear begins."""

    @staticmethod
    def parse(text: str, robot: RobotDescription) -> Wear:
        """Parse wear such as `module2_alpha=-30%@10` or `battery=-1V`, where 10 is in seconds.

        Raises:
            TwinError: If the text is malformed, or the robot has no such joint.
        """
        found, size, after_s = _FORM.fullmatch(text), 0.0, 0.0
        if found is not None:
            size, after_s = float(found["size"]), float(found["after"] or 0.0)
        joints = [joint.name for joint in robot.kinematics().joints]
        if found is None or (found["part"] == BATTERY) != (found["unit"] == "V"):
            raise TwinError(f"--wear: '{text}' is not like {joints[0]}=-30%@10 or {BATTERY}=-1V")
        if found["part"] not in [*joints, BATTERY]:
            raise TwinError(
                f"--wear: '{found['part']}' is no joint of {robot.name}: "
                f"there are {', '.join(joints)} and {BATTERY}"
            )
        most, unit = (robot.battery.nominal_v, " V") if found["unit"] == "V" else (100.0, " %")
        if not 0.0 < size < most:
            raise TwinError(f"--wear: '{text}' has to be more than 0 and less than {most:g}{unit}")
        return Wear(found["part"], size if found["unit"] == "V" else size / 100.0, after_s)


class DegradedRobot(SimRobot):
    """Simulated robot with blocked gimbal servos, and parts that wear while it drives."""

    def __init__(
        self,
        robot: RobotDescription,
        wear: Sequence[Wear] = (),
        jams: Sequence[StuckJoint] = (),
        **kwargs: Any,
    ) -> None:
        """Accept the arguments of `SimRobot` in addition to `wear` and `jams`."""
        super().__init__(robot, **kwargs)
        self._names = [joint.name for joint in robot.kinematics().joints]
        self._block_angles: dict[int, float] = {}
        self._held: dict[int, float] = {}
        for jam in jams:
            self.jam(jam)
        self._upcoming = list(wear)
        self._joint_shares = np.ones(len(self._names))
        self._driven_s = 0.0
        self._read_s: float | None = None

    def jam(self, jam: StuckJoint) -> None:
        """Block a gimbal servo."""
        self._block_angles[self._names.index(jam.joint)] = jam.lean_rad

    def _reachable(self, setpoint: Array) -> Array:
        """Return the setpoints (n,); a blocked joint keeps its current angle."""
        if not self._block_angles:
            return setpoint
        joints = self._simulation.joints
        for place, lean_rad in self._block_angles.items():
            if abs(joints[place]) >= lean_rad:
                self._held.setdefault(place, float(joints[place]))
        if self._held:
            setpoint = setpoint.copy()
            setpoint[list(self._held)] = list(self._held.values())
        return setpoint

    def wear(self, wear: Wear) -> None:
        """Apply wear to a part."""
        if wear.part == BATTERY:
            volts = self._simulation.hardware_status()["battery_v"]
            assert isinstance(volts, float)  # noqa: S101  Each simulation has a battery.
            self._simulation.set_battery(volts - wear.lost)
        else:
            self._joint_shares[self._names.index(wear.part)] = 1.0 - wear.lost
            self._simulation.degrade(self._joint_shares)

    def read(self, now_s: float) -> Array:
        """Apply wear that is due, and return the measurements."""
        measured = super().read(now_s)
        if self._upcoming:
            if self._read_s is not None and np.abs(self._simulation.twist()).max() > _DRIVING:
                self._driven_s += now_s - self._read_s
            self._read_s = now_s
            due = [each for each in self._upcoming if each.after_s <= self._driven_s]
            self._upcoming = [each for each in self._upcoming if each not in due]
            for each in due:
                self.wear(each)
        return measured
