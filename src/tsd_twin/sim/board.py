"""A simulated controller board: what stands between a node that hangs and the actuators."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tsd_twin.drives import JointKind
from tsd_twin.lie import Array
from tsd_twin.robots import Robot
from tsd_twin.sim.sim_robot import SimRobot, Truth

TIMEOUT_S = 0.25
"""Set-points older than this are not obeyed any more."""


class Board:
    """Passes set-points on to a simulated robot, and trips when they cease.

    `TIMEOUT_S` after the last set-point it puts the actuators at rest by itself, in the middle of
    whatever time has passed when it is asked next. A board that has tripped measures nothing, which
    is a fault to the node, and obeys nothing but zero throttle on all wheels, which ends it: so the
    way back is reset and arm. Where all throttles are zero there is nothing to trip.
    """

    def __init__(self, robot: Robot, simulated: SimRobot) -> None:
        drive = robot.kinematics()
        self._simulated = simulated
        self._wheels = np.flatnonzero([j.kind is JointKind.VELOCITY for j in drive.joints])
        self._rest = drive.inverse(np.zeros(len(drive.components)))
        self._rest[self._wheels] = 0.0
        self._obeyed: Array = self._rest
        self._fed_s = 0.0
        self.tripped = False

    def read(self, now_s: float) -> Array | None:
        """Return the measured joints (n,); None once it has tripped."""
        self._look_at_the_clock(now_s)
        measured = self._simulated.read(now_s)
        return None if self.tripped else measured

    def write(self, setpoint: Array, now_s: float) -> None:
        """Pass a set-point (n,) on, unless it has tripped.

        Raises:
            ValueError: a number is not finite, or there is not one for each joint.
        """
        self._look_at_the_clock(now_s)
        if self.tripped and not setpoint[self._wheels].any():
            self.tripped = False
        if not self.tripped:
            self._simulated.write(setpoint, now_s)
            self._obeyed, self._fed_s = setpoint.copy(), now_s

    def truth(self, now_s: float) -> Truth:
        """Return the true state."""
        self._look_at_the_clock(now_s)
        return self._simulated.truth(now_s)

    def hardware(self) -> Mapping[str, object]:
        """Return facts for the status that JSON can hold."""
        return {**self._simulated.hardware(), "tripped": self.tripped}

    def close(self) -> None:
        """Close what is behind it."""
        self._simulated.close()

    def _look_at_the_clock(self, now_s: float) -> None:
        spins = bool(self._obeyed[self._wheels].any())
        if spins and not self.tripped and now_s - self._fed_s > TIMEOUT_S:
            self.tripped = True
            self._obeyed = self._rest
            self._simulated.write(self._rest, self._fed_s + TIMEOUT_S)
