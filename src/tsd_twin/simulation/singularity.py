"""Kinematic simulation of singularity drives: rolling without slip, integrated to fourth order."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Unpack

import numpy as np

from tsd_twin.kinematics import SingularityKinematics
from tsd_twin.lie import SE2, Array
from tsd_twin.robots import SingularityDescription
from tsd_twin.simulation.actuators import Actuation, SimulationOptions

_SLOPES = np.array([[-3.0, 4.0, -1.0], [-1.0, 0.0, 1.0], [1.0, -4.0, 3.0]])
"""Slopes at the start, middle and end of the parabola through three values there, times dt."""
_SIMPSON = np.array([[1.0, 4.0, 1.0]]) / 6.0
_REMEMBERED = 16
"""Number of step lengths that are remembered: steps of 0.01 s differ in their last digits."""


@functools.lru_cache(maxsize=_REMEMBERED)
def _step_rules(dt_s: float) -> tuple[Array, Array]:
    """Matrices for the slopes, and for the integral, over a step of `dt_s` seconds."""
    return _SLOPES / dt_s, dt_s * _SIMPSON


@dataclass(frozen=True, slots=True, eq=False)
class KinematicPlant:
    """Kinematic plant: wheels roll without slip."""

    kinematics: SingularityKinematics

    def tangent(self, joints: Array, dt_s: float) -> Array:
        """Tangent (..., 3) of the motion over a step of `dt_s` seconds.

        `joints` (3, ..., n) are the true joint vectors at its start, middle and end. Rates of the
        gimbals come from the parabola through them, so that Simpson's rule adds up to the angle
        turned through, exactly and over any number of steps.

        The twist changes during the step and turns do not commute with translations: the second
        term of the Magnus expansion keeps fourth order. Source: Iserles and Norsett, "On the
        solution of linear differential equations in Lie groups" (1999), with the sign for twists
        in the body frame.
        """
        by_node = joints.reshape(3, -1)
        slopes, weights = _step_rules(dt_s)
        rates = (slopes @ by_node).reshape(joints.shape)
        twists = self.kinematics.twist(joints, rates)
        tangent = (weights @ twists.reshape(3, -1)).reshape(twists.shape[1:])
        # Of one robot, the numbers of a list are quicker than those of an array.
        vx, vy, omega = twists.T.tolist() if twists.ndim == 2 else np.moveaxis(twists, -1, 0)
        twelfth = dt_s * dt_s / 12.0
        tangent[..., 0] += twelfth * (omega[2] * vy[0] - omega[0] * vy[2])
        tangent[..., 1] += twelfth * (omega[0] * vx[2] - omega[2] * vx[0])
        return tangent

    def displacement(self, joints: Array, dt_s: float) -> SE2:
        """Pose after a step, in the frame at its start; `joints` as in `tangent`."""
        return SE2.exp(self.tangent(joints, dt_s))


_LONGEST_STEP_S = 0.02
"""Longest integration step: short beside the time constant of the servos, about 1/30 s."""


class SingularitySimulation:
    """`batch` robots of one description, all at the same virtual time; `()` is a single one.

    Servos, speed controllers and motors feed a kinematic plant: wheels roll without slip, and
    nothing has mass. For `noise` see `Actuation`.
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
        self._plant = KinematicPlant(self.kinematics)
        self.pose = SE2(np.zeros((*batch, 3)) + (0.0 if pose is None else pose.xy_heading))
        """True pose in the world."""
        self.joints: Array = np.zeros((*batch, len(self.kinematics.joints)))
        """(..., n): true joint vector."""
        self.joints[..., self.actuation.angles] = self.actuation.zero_rad
        self._stands = False
        self._displacements: dict[float, SE2] = {}
        """Displacements of the steps, by their length, that leave all joints as they are."""
        self._measured: Array | None = None
        """What is measured while no joint changes, if that has no noise."""
        self._halves = np.array([0.5, 1.0]).reshape(2, *(1,) * (len(batch) + 1))

    def command(self, setpoint: Array) -> None:
        """Give all actuators new set-points, as `Actuation.command` takes them."""
        if self.actuation.command(setpoint):
            self._forget()

    def degrade(self, shares: Array) -> None:
        """Slow joints down, as `Actuation.degrade` takes them."""
        self.actuation.degrade(shares)
        self._forget()

    def set_battery(self, battery_v: float) -> None:
        """Set the voltage of the battery."""
        self.actuation.set_battery(battery_v)
        self._forget()

    def _forget(self) -> None:
        self._stands = False
        self._displacements.clear()

    def lose_drive(self) -> None:
        """Take the power of the speed controllers away, as `Actuation.lose_drive`."""
        self.actuation.lose_drive()
        self._stands = False
        self._displacements.clear()

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` seconds pass: in short steps while joints move, in one when all are still."""
        self.actuation.controllers.advance(dt_s)
        if self._stands:
            return  # A step would leave everything as it is, to the bit.
        left_s = dt_s
        while left_s > 0.0:
            steps = math.ceil(left_s / _LONGEST_STEP_S)
            short = steps <= 1 or self.actuation.settled(self.joints)
            step_s = left_s if short else left_s / steps
            self._step(step_s)
            left_s -= step_s
        self._stands = self.actuation.stands(self.joints)

    def measure(self) -> Array:
        """Joint vector (..., n) as `Actuation.measure` has it."""
        if self._measured is not None:
            return self._measured.copy()
        measured = self.actuation.measure(self.joints)
        if self.actuation.is_exact:
            self._measured = measured.copy()
        return measured

    def twist(self) -> Array:
        """True twist (..., 3) in the body frame."""
        rates = self.actuation.rates(self.joints)
        return self.kinematics.twist(self.actuation.surface.roll(self.joints), rates)

    def hardware_status(self) -> dict[str, object]:
        """Actuator status."""
        return self.actuation.hardware_status()

    def _step(self, dt_s: float) -> None:
        moved = self._displacements.get(dt_s)
        if moved is None:
            moved = self._move_joints(dt_s)
        self.pose = self.pose @ moved

    def _move_joints(self, dt_s: float) -> SE2:
        """Move the joints by a step, and return the displacement of the body."""
        before = self.joints.tobytes() + self.actuation.play_rad.tobytes()
        nodes = np.empty((3, *self.joints.shape))
        nodes[0] = self.joints
        nodes[1:] = self.actuation.after(self.joints, dt_s * self._halves)
        moved = self._plant.displacement(self.actuation.surface.roll(nodes), dt_s)
        self.joints = nodes[2]
        self.actuation.come_to_rest(self.joints)
        if self.joints.tobytes() + self.actuation.play_rad.tobytes() != before:
            self._displacements.clear()
            self._measured = None
        elif len(self._displacements) < _REMEMBERED:
            self._displacements[dt_s] = moved
        return moved
