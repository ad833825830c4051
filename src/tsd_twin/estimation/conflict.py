"""Whether the measured joints agree with one another, and who contradicts the others.

A gimbal that jams or lags contradicts the others. What is not measured cannot be seen: a wheel that
slides on the floor moves no gimbal, so this is no slip sensor; a wheel that turns at another speed
than assumed shows only where speeds are measured; a mis-homed gimbal reports what it was told.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsd_twin.drives import Drive
from tsd_twin.estimation.joint_noise import JointNoise
from tsd_twin.estimation.parity import ParityTest
from tsd_twin.lie import Array
from tsd_twin.robots import JointErrors

_SMOOTHING_S = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """What the residual says."""

    residual_mps: float
    """Smoothed, root mean square over the contacts."""
    level: float
    """Chi-square of the residual over the threshold: above 1 it is more than noise explains."""
    shares: Array
    """(k,): how much of the squared residual each actuator explains alone, 0 to 1."""
    suspect: int | None
    """The actuator that contradicts the others, when the conflict is evident."""

    @property
    def evident(self) -> bool:
        """Whether the conflict is more than the known noise explains."""
        return self.level > 1.0


class ConflictMonitor:
    """Smoothed residual of the forward kinematics against what the known noise explains.

    Errors of joints last: steps of a servo and a wrong spin do not average out. So smoothing takes
    away what is short, and the threshold is that of a single sample nonetheless.

    Who is suspected: the actuator of the one joint that explains all by itself, if there is one.
    Otherwise the actuator without which the others agree best. The second alone would not do: two
    modules measure the distance between them, and when only that is wrong, either may be.
    """

    def __init__(self, drive: Drive[Any], noise: JointErrors) -> None:
        self._drive = drive
        self._noise = JointNoise(drive, noise)
        self._owners = [_owner(joint.name, drive.actuators) for joint in drive.joints]
        self._residual: Array | None = None

    def advance(self, residual: Array, dt_s: float) -> None:
        """Take in the residual (m,) of one period."""
        if self._residual is None:
            self._residual = np.zeros(len(residual))
        share = 1.0 - math.exp(-dt_s / _SMOOTHING_S)
        self._residual = self._residual + share * (residual - self._residual)

    def judge(self, joints: Array) -> Verdict:
        """Return what the residual says of a robot whose joints are at `joints` (n,)."""
        residual = self._residual
        squared = 0.0 if residual is None else float(residual @ residual)
        if residual is None or squared == 0.0:
            return Verdict(0.0, 0.0, np.zeros(len(self._drive.actuators)), None)
        test = ParityTest.at(self._drive, joints, self._noise.sigma(joints))
        level = float(test.statistic(residual)) / test.threshold
        shares = np.clip(self._drive.blame(residual) / squared, 0.0, 1.0)
        suspect = None
        if level > 1.0:
            joint, enough = test.single_fault(residual)
            suspect = self._owners[int(joint)] if enough else int(shares.argmax())
        return Verdict(math.sqrt(squared / len(residual)), level, shares, suspect)


def _owner(joint: str, actuators: tuple[str, ...]) -> int:
    """Return the actuator that a joint belongs to: it has its name, or begins with it."""
    (owner,) = (
        i for i, name in enumerate(actuators) if joint == name or joint.startswith(name + "_")
    )
    return owner
