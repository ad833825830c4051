"""Simulation of singularity drives: rolling without slip, to fourth order."""

from __future__ import annotations

import functools
import math
from typing import Unpack

import numpy as np

from tsd_twin.kinematics import SingularityKinematics
from tsd_twin.lie import SE2, Array
from tsd_twin.robots import SingularityDescription
from tsd_twin.simulation.actuators import (
    SimulationOptions,
)
from tsd_twin.simulation.gimbal_actuation import Actuation, BuiltLayout

_SLOPES = np.array([[-3.0, 4.0, -1.0], [-1.0, 0.0, 1.0], [1.0, -4.0, 3.0]])
"""Derivatives at start, middle and end of the parabola through three values there, times dt."""
_SIMPSON = np.array([[1.0, 4.0, 1.0]]) / 6.0
_CACHED_STEPS = 16
"""Number of cached step lengths; steps of 0.01 s differ in their last digits."""


@functools.lru_cache(maxsize=_CACHED_STEPS)
def _step_rules(dt_s: float) -> tuple[Array, Array]:
    """Return the matrices for derivatives and integral over a step of `dt_s` seconds."""
    return _SLOPES / dt_s, dt_s * _SIMPSON


def rolling_tangent(
    kinematics: SingularityKinematics,
    joints: Array,
    dt_s: float,
    layout: BuiltLayout | None = None,
) -> Array:
    """Return the tangent (..., 3) of rolling without slip over a step of `dt_s` seconds.

    The built robot has the described `layout` by default.

    `joints` (3, ..., n) are the true joint vectors at its start, middle and end. Gimbal rates come
    from the parabola through them, so that Simpson's rule sums exactly to the rotation angle over
    any number of steps.

    The twist changes during the step, and rotations do not commute with translations; the second
    term of the Magnus expansion preserves fourth order. Source: Iserles and Norsett, "On the
    solution of linear differential equations in Lie groups" (1999), with the sign for twists in the
    body frame.
    """
    by_node = joints.reshape(3, -1)
    slopes, weights = _step_rules(dt_s)
    rates = (slopes @ by_node).reshape(joints.shape)
    if layout is None:
        twists = kinematics.twist(joints, rates)
    else:
        twists = layout.twist(kinematics, joints, rates)
    tangent = (weights @ twists.reshape(3, -1)).reshape(twists.shape[1:])
    # For a single robot, list elements are faster than array elements.
    vx, vy, omega = twists.T.tolist() if twists.ndim == 2 else np.moveaxis(twists, -1, 0)
    twelfth = dt_s * dt_s / 12.0
    tangent[..., 0] += twelfth * (omega[2] * vy[0] - omega[0] * vy[2])
    tangent[..., 1] += twelfth * (omega[0] * vx[2] - omega[2] * vx[0])
    return tangent


_MAX_STEP_S = 0.02
"""Maximum integration step, short compared to the servo time constant of about 1/30 s."""


class SingularitySimulation:
    """`batch` robots in lockstep virtual time; `()` is a single robot.

    Servos, speed controllers and motors drive wheels that roll without slip; bodies have no mass.
    For `noise` see `Actuation`.
    """

    def __init__(
        self,
        robot: SingularityDescription,
        batch: tuple[int, ...] = (),
        *,
        pose: SE2 | None = None,
        **options: Unpack[SimulationOptions],
    ) -> None:
        self.actuation = Actuation(robot, batch, **options)
        self.kinematics = self.actuation.kinematics
        self.pose = SE2(np.zeros((*batch, 3)) + (0.0 if pose is None else pose.xy_heading))
        """True pose in the world."""
        self.joints: Array = np.zeros((*batch, len(self.kinematics.joints)))
        """(..., n): true joint vector."""
        self.joints[..., self.actuation.angles] = self.actuation.zero_rad
        self._at_rest = False
        self._displacements: dict[float, SE2] = {}
        """Displacements by step length, for steps that leave all joints unchanged."""
        self._measured: Array | None = None
        """Cached noise-free measurement while no joint changes."""
        self._halves = np.array([0.5, 1.0]).reshape(2, *(1,) * (len(batch) + 1))

    def command(self, setpoint: Array) -> None:
        """Set the setpoints of all actuators, as in `Actuation.command`."""
        if self.actuation.command(setpoint):
            self._clear_cache()

    def degrade(self, shares: Array) -> None:
        """Slow down joints, as in `Actuation.degrade`."""
        self.actuation.degrade(shares)
        self._clear_cache()

    def set_battery(self, battery_v: float) -> None:
        """Set the voltage of the battery."""
        self.actuation.set_battery(battery_v)
        self._clear_cache()

    def _clear_cache(self) -> None:
        self._at_rest = False
        self._displacements.clear()

    def lose_drive(self) -> None:
        """Cut the speed controllers' power, as in `Actuation.lose_drive`."""
        self.actuation.lose_drive()
        self._clear_cache()

    def advance(self, dt_s: float) -> None:
        """Advance by `dt_s`: in short steps while joints move, otherwise in one."""
        self.actuation.controllers.advance(dt_s)
        if self._at_rest:
            return  # A step would leave everything bit-identical.
        left_s = dt_s
        while left_s > 0.0:
            steps = math.ceil(left_s / _MAX_STEP_S)
            short = steps <= 1 or self.actuation.settled(self.joints)
            step_s = left_s if short else left_s / steps
            self._step(step_s)
            left_s -= step_s
        self._at_rest = self.actuation.stands(self.joints)

    def measure(self) -> Array:
        """Return the joint vector (..., n) as in `Actuation.measure`."""
        if self._measured is not None:
            return self._measured.copy()
        measured = self.actuation.measure(self.joints)
        if self.actuation.is_exact:
            self._measured = measured.copy()
        return measured

    def twist(self) -> Array:
        """Return the true twist (..., 3) in the body frame."""
        rates = self.actuation.rates(self.joints)
        rolling = self.actuation.surface.roll(self.joints)
        return self.actuation.layout.twist(self.kinematics, rolling, rates)

    def hardware_status(self) -> dict[str, object]:
        """Return the actuator status."""
        return self.actuation.hardware_status()

    def _step(self, dt_s: float) -> None:
        moved = self._displacements.get(dt_s)
        if moved is None:
            moved = self._move_joints(dt_s)
        self.pose = self.pose @ moved

    def _move_joints(self, dt_s: float) -> SE2:
        """Move the joints by a step, and return the displacement of the body."""
        before = self.joints.tobytes() + self.actuation.backlash_rad.tobytes()
        nodes = np.empty((3, *self.joints.shape))
        nodes[0] = self.joints
        nodes[1:] = self.actuation.after(self.joints, dt_s * self._halves)
        rolling = self.actuation.surface.roll(nodes)
        moved = SE2.exp(rolling_tangent(self.kinematics, rolling, dt_s, self.actuation.layout))
        self.joints = nodes[2]
        self.actuation.come_to_rest(self.joints)
        if self.joints.tobytes() + self.actuation.backlash_rad.tobytes() != before:
            self._displacements.clear()
            self._measured = None
        elif len(self._displacements) < _CACHED_STEPS:
            self._displacements[dt_s] = moved
        return moved
