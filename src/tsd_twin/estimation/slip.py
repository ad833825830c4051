"""What a floor makes of rolling: a body that wheels push along slides a little against them."""

from __future__ import annotations

import math

import numpy as np

from tsd_twin.drives import SingularityDrive
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityRobot

_GRAVITY_MPS2 = 9.81
_SPIN_IN_SLIP = 8.0 / (3.0 * math.pi)
"""How much the speed of the rim of a contact patch counts beside the slip (Zhuravlev 1998)."""

_MEAN_LEVER = 3.0 * math.pi / 16.0
"""Lever of the friction of a patch that only spins, in radii, under the pressure of Hertz."""


class Slip:
    """The twist of robots over a floor with friction, from what their wheels roll.

    A wheel that spins on the spot rubs like oil: it has to slide to push, by some centimetres a
    second, and no gimbal shows it. So the body follows its wheels late, and hardly at all when they
    ask for more than friction gives. All wheels carry the same load; the chassis is a disc of the
    size of the pivot circle.
    """

    def __init__(self, robot: SingularityRobot, batch: tuple[int, ...] = ()) -> None:
        drive: SingularityDrive = robot.kinematics()
        mass, radius_m = robot.mass.total_kg, drive.pivot_radius_m
        self._mass = np.diag([mass, mass, 0.5 * mass * radius_m**2])
        self._rows = drive.contact_from_twist
        self._squares = np.einsum("kij,kil->kjl", self._rows, self._rows)
        self._most_n = robot.floor.friction * mass * _GRAVITY_MPS2 / drive.modules
        self._rim_mps = _SPIN_IN_SLIP * robot.floor.patch_radius_m * drive.spin_rad_per_s
        # A motor gives what its time constant takes, see `ContactSimulation`; the wheel is half a
        # hollow sphere.
        inertia = robot.mass.wheel_kg * drive.wheel_radius_m**2 * 2.0 / 3.0
        drag_nm = self._most_n * _MEAN_LEVER * robot.floor.patch_radius_m
        slower = drag_nm * robot.motor.time_constant_up_s / inertia
        self.spin_share: float = 1.0 - slower / drive.spin_rad_per_s
        """Speed of wheels that drill on the floor, as a share of that without load."""
        self.twist: Array = np.zeros((*batch, 3))
        """(..., 3): of the body, in its frame."""

    def advance(self, rolling: Array, dt_s: float, pieces: int = 4) -> Array:
        """Return the twist (..., 3) after `dt_s` seconds in which the wheels roll `rolling`.

        Implicit Euler with the friction of the slip there was: stable over any step.
        """
        step_s = dt_s / pieces
        for _ in range(pieces):
            slip = np.einsum("kij,...j->...ki", self._rows, rolling - self.twist)
            speed2 = np.square(slip).sum(axis=-1) + self._rim_mps**2
            pull = self._most_n / np.sqrt(speed2)
            drag = step_s * np.einsum("...k,kjl->...jl", pull, self._squares)
            pulled = drag @ (rolling - self.twist)[..., None]
            gained = np.asarray(np.linalg.solve(self._mass + drag, pulled), dtype=float)
            self.twist = self.twist + gained[..., 0]
            # The axes of the body turn away under its speed.
            turned = step_s * self.twist[..., 2:]
            self.twist[..., :2] += turned * self.twist[..., 1::-1] * [1.0, -1.0]
        return self.twist
