"""Injected wear of a simulated robot: slow servos and wheels, and a battery that sags."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsd_twin.errors import TwinError
from tsd_twin.lie import Array
from tsd_twin.robots import RobotDescription
from tsd_twin.simulation.robot import RobotWithStuckJoint

_NUMBER = r"\d+(?:\.\d+)?"
_FORM = re.compile(rf"(?P<part>\w+)=-(?P<size>{_NUMBER})(?P<unit>%|V)(?:@(?P<after>{_NUMBER}))?")
BATTERY = "battery"
_DRIVING = 0.02
"""Metres or radians a second of the true motion above which a robot drives."""


@dataclass(frozen=True, slots=True)
class Wear:
    """A joint that gets slower, or a battery that loses voltage, after some time of driving."""

    part: str
    """Name of a joint, or `battery`."""
    lost: float
    """Share of the speed that the joint loses, or volts."""
    after_s: float = 0.0
    """Time of driving before it begins."""

    @staticmethod
    def parse(text: str, robot: RobotDescription) -> Wear:
        """Parse wear such as `module2_alpha=-30%@10` or `battery=-1V`, where 10 is in seconds.

        Raises:
            TwinError: the text is malformed, or the robot has no such joint.
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


class WornRobot(RobotWithStuckJoint):
    """Simulated robot whose parts wear while it drives."""

    def __init__(self, robot: RobotDescription, wear: Sequence[Wear] = (), **kwargs: Any) -> None:
        """Take what a `RobotWithStuckJoint` takes besides."""
        super().__init__(robot, **kwargs)
        self._coming = list(wear)
        self._joint_shares = np.ones(len(self._names))
        self._driven_s = 0.0
        self._read_s: float | None = None

    def wear(self, wear: Wear) -> None:
        """Let a part wear from now on."""
        if wear.part == BATTERY:
            volts = self._simulation.hardware_status()["battery_v"]
            assert isinstance(volts, float)  # noqa: S101  As all simulations have it.
            self._simulation.set_battery(volts - wear.lost)
        else:
            self._joint_shares[self._names.index(wear.part)] = 1.0 - wear.lost
            self._simulation.degrade(self._joint_shares)

    def read(self, now_s: float) -> Array:
        """Return what is measured, after parts have worn that are due."""
        measured = super().read(now_s)
        if self._coming:
            if self._read_s is not None and np.abs(self._simulation.twist()).max() > _DRIVING:
                self._driven_s += now_s - self._read_s
            self._read_s = now_s
            due = [each for each in self._coming if each.after_s <= self._driven_s]
            self._coming = [each for each in self._coming if each not in due]
            for each in due:
                self.wear(each)
        return measured
