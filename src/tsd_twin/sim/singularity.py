"""Singularity drives in virtual time: one, or a batch in lockstep."""

from __future__ import annotations

import numpy as np

from tsd_twin.lie import SE2, Array
from tsd_twin.robots import SingularityRobot
from tsd_twin.sim.actuation import Actuation
from tsd_twin.sim.plant import KinematicPlant

_LONGEST_STEP_S = 0.02
"""The approach of the servos, some 30 per second, is a smooth curve over this."""


class SingularitySimulation:
    """`batch` robots of one description, all at the same virtual time; `()` is a single one.

    Servos, speed controllers and motors feed a kinematic plant: wheels roll without slip, and
    nothing has mass. For `noise` see `Actuation`.
    """

    def __init__(
        self,
        robot: SingularityRobot,
        batch: tuple[int, ...] = (),
        *,
        seed: int | None = 0,
        noise: float = 0.0,
        battery_v: float | None = None,
        pose: SE2 | None = None,
    ) -> None:
        self.actuation = Actuation(robot, batch, seed, noise, battery_v)
        self.drive = self.actuation.drive
        self._plant = KinematicPlant(self.drive)
        self.pose = SE2(np.zeros((*batch, 3)) + (0.0 if pose is None else pose.xy_heading))
        """True pose in the world."""
        self.joints: Array = np.zeros((*batch, len(self.drive.joints)))
        """(..., n): true joint vector."""
        self.joints[..., self.actuation.angles] = self.actuation.zero_rad
        self._halves = np.array([0.5, 1.0]).reshape(2, *(1,) * (len(batch) + 1))

    def command(self, setpoint: Array) -> None:
        """Give all actuators new set-points, as `Actuation.command` takes them."""
        self.actuation.command(setpoint)

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` seconds pass: in short steps while joints move, in one when all are still."""
        self.actuation.controllers.advance(dt_s)
        left_s = dt_s
        while left_s > 0.0:
            steps = np.ceil(left_s / _LONGEST_STEP_S)
            step_s = (
                left_s
                if steps <= 1.0 or self.actuation.settled(self.joints)
                else left_s / float(steps)
            )
            self._step(step_s)
            left_s -= step_s

    def measure(self) -> Array:
        """Return the joint vector (..., n) as `Actuation.measure` has it."""
        return self.actuation.measure(self.joints)

    def twist(self) -> Array:
        """Return the true twist (..., 3) in the body frame."""
        rates = self.actuation.rates(self.joints)
        return self.drive.forward(self.actuation.surface.roll(self.joints), rates).twist

    def facts(self) -> dict[str, object]:
        """Return what the actuators say."""
        return self.actuation.facts()

    def _step(self, dt_s: float) -> None:
        nodes = np.empty((3, *self.joints.shape))
        nodes[0] = self.joints
        nodes[1:] = self.actuation.after(self.joints, dt_s * self._halves)
        self.pose = self._plant.move(self.pose, self.actuation.surface.roll(nodes), dt_s)
        self.joints = nodes[2]
