"""Between joints of a robot and steps and pulses of its board."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from tsd_twin.drives import JointKind
from tsd_twin.hardware.errors import HardwareError
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityRobot
from tsd_twin.wire.table import ESCS, FULL_THROTTLE, SERVOS, ZERO_THROTTLE

_PULSES_PER_US = 2.0


class ThrottleLaw(Protocol):
    """What throttle makes a wheel turn how fast; `sim.Motors` is one."""

    def signal(self, speed_rad_per_s: Array) -> Array:
        """Return the throttle signal that makes each motor turn at its speed."""
        ...

    def pulse_us(self, signal: Array) -> Array:
        """Return the pulse width, microseconds, that stands for a signal."""
        ...


class Joints:
    """Which joint is which servo or speed controller, and in what units."""

    def __init__(self, robot: SingularityRobot, throttle: ThrottleLaw) -> None:
        """Take the joints of a robot.

        Raises:
            HardwareError: the board has not enough servos or speed controllers for it.
        """
        drive = robot.kinematics()
        angles = np.array([joint.kind is JointKind.POSITION for joint in drive.joints])
        self._angles, self._wheels = np.flatnonzero(angles), np.flatnonzero(~angles)
        if len(self._angles) > SERVOS or len(self._wheels) > ESCS:
            raise HardwareError(
                f"{robot.name} has {len(self._angles)} gimbals and {len(self._wheels)} wheels, "
                f"the board has {SERVOS} servos and {ESCS} speed controllers"
            )
        self._throttle = throttle
        self._trim = robot.trim()
        self._step_rad = 2.0 * math.pi / robot.servo.steps_per_turn
        self.count = len(drive.joints)
        self.names = [drive.joints[i].name for i in self._angles]
        """Of the gimbals, in the order of the servos."""
        self.servos = (1 << len(self.names)) - 1
        """Mask of the servos there are."""
        most_rad, zero_rad = math.radians(robot.drive.max_tilt_deg), self._trim.offset[self._angles]
        # It is the gimbal that must not tilt further; its servo may stand beside it.
        self._least = np.ceil((-most_rad - zero_rad) / self._step_rad)
        self._most = np.floor((most_rad - zero_rad) / self._step_rad)
        self.goal_limit = int(max(-self._least.min(), self._most.max()))
        """Steps from neutral that no goal exceeds."""

    def checked(self, setpoint: Array) -> Array:
        """Return a copy of a set-point (n,).

        Raises:
            ValueError: a number is not finite, or there is not one for each joint.
        """
        if np.shape(setpoint) != (self.count,) or not np.isfinite(setpoint).all():
            raise ValueError(f"set-points must be {self.count} finite numbers, not {setpoint}")
        return setpoint.copy()

    def goals(self, setpoint: Array) -> tuple[int, ...]:
        """Return steps from neutral for each gimbal."""
        steps = np.rint(self._trim.told(setpoint)[self._angles] / self._step_rad)
        return _ints(np.clip(steps, self._least, self._most))

    def throttles(self, setpoint: Array) -> tuple[int, ...]:
        """Return the pulse for each wheel, in half microseconds; a speed of 0 is zero throttle."""
        told = self._trim.told(setpoint)[self._wheels]
        pulses = self._throttle.pulse_us(self._throttle.signal(told))
        return _ints(np.clip(np.rint(_PULSES_PER_US * pulses), ZERO_THROTTLE, FULL_THROTTLE))

    def measured(self, steps: Sequence[int], alive: int) -> Array:
        """Return joints (n,) from steps from neutral; NaN for what is not `alive`, and for speeds.

        `alive` is a mask of servos.
        """
        joints = np.full(self.count, np.nan)
        for servo, joint in enumerate(self._angles):
            if alive >> servo & 1:
                joints[joint] = steps[servo] * self._step_rad
        return self._trim.measured(joints)

    def named(self, mask: int) -> str:
        """Return the servos in a mask by number and joint."""
        here = [f"{i + 1} ({name})" for i, name in enumerate(self.names) if mask >> i & 1]
        return ("servo " if len(here) == 1 else "servos ") + ", ".join(here)


def padded(values: Sequence[int], count: int, filler: int) -> tuple[int, ...]:
    """Return `values`, and the filler for what the robot does not have."""
    return (*values, *(filler,) * (count - len(values)))


def _ints(values: Array) -> tuple[int, ...]:
    return tuple(int(value) for value in values)
