"""Slip model of spinning wheels under side force: actual twist for a commanded one."""

from __future__ import annotations

import math

import msgspec
import numpy as np

from tsd_twin.kinematics import SingularityKinematics
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityDescription

_GRAVITY_MPS2 = 9.81
_SPIN_IN_SLIP = 8.0 / (3.0 * math.pi)
"""Weight of the rim speed of a contact patch relative to the slip (Zhuravlev 1998)."""

_SLIP_IN_SPIN = 15.0 * math.pi / 16.0
"""Weight of the slip relative to the rim speed, for the torque of the patch."""
_MEAN_LEVER = 3.0 * math.pi / 16.0
"""Friction lever of a purely spinning patch, in radii, under Hertz pressure."""
_ROUNDS = 20
"""Iterations of a fixed point that halves its error each time, up to 0.7 of the friction."""


class Slip:
    """Slip model: twist of robots on a floor with friction, from the rolling of their wheels.

    The friction of a spinning wheel is viscous: it pushes only while it slides, by some centimetres
    a second, which no gimbal measures. So the body lags its wheels, and hardly follows a demand
    beyond the friction limit. Accelerating the body slows the wheels down, and braking it speeds
    them up, faster than the motors compensate. All wheels carry the same load; the chassis is a
    disc of the size of the pivot circle, with the modules on its rim, and a wheel is half a hollow
    sphere.
    """

    def __init__(self, robot: SingularityDescription, batch: tuple[int, ...] = ()) -> None:
        kinematics: SingularityKinematics = robot.kinematics()
        mass = robot.mass.total_kg
        self._robot, self._batch = robot, batch
        self._mass = np.diag([mass, mass, robot.turning_inertia_kg_m2])
        self._rows = kinematics.contact_from_twist
        self._squares = np.einsum("kij,kil->kjl", self._rows, self._rows)
        self._most_n = robot.floor.friction * mass * _GRAVITY_MPS2 / kinematics.modules
        patch_m, self._spin_rad_per_s = robot.floor.patch_radius_m, kinematics.spin_rad_per_s
        self._rim_mps = patch_m * self._spin_rad_per_s
        self._lever_m = _MEAN_LEVER * patch_m
        # The motor torque follows from its time constant, see `MujocoSimulation`.
        inertia = robot.mass.wheel_kg * kinematics.wheel_radius_m**2 * 2.0 / 3.0
        self._share_per_nms = 1.0 / (inertia * self._spin_rad_per_s)
        self._up_s = robot.motor.time_constant_up_s
        self._down_s = robot.motor.time_constant_down_s
        slower = self._most_n * self._lever_m * self._up_s * self._share_per_nms
        self.rest_share: float = 1.0 - slower
        """Speed of wheels that spin on the floor at rest, as a share of their set-point."""
        self.spin_share: Array = np.full((*batch, kinematics.modules), self.rest_share)
        """(..., k): speed of each wheel, as a share of its set-point."""
        self.twist: Array = np.zeros((*batch, 3))
        """(..., 3): twist of the body, in its frame."""

    @property
    def lag_s(self) -> float:
        """Time constant with which the body follows its wheels, for small forces."""
        wheels = len(self._rows)
        return float(self._mass[0, 0]) * _SPIN_IN_SLIP * self._rim_mps / (wheels * self._most_n)

    @property
    def turning_lag_s(self) -> float:
        """Time constant of a turning body, for small forces."""
        across = float(np.trace(self._squares.sum(axis=0)[2:, 2:]))
        return float(self._mass[2, 2]) * _SPIN_IN_SLIP * self._rim_mps / (across * self._most_n)

    def later(self, turning_s: float) -> Slip:
        """Return this model at rest on a floor where the lag of turns is longer by `turning_s`.

        The friction is limited to between half and twice the present one.
        """
        share = np.clip(1.0 + turning_s / self.turning_lag_s, 0.5, 2.0)
        floor = self._robot.floor
        floor = msgspec.structs.replace(floor, friction=floor.friction / float(share))
        return Slip(msgspec.structs.replace(self._robot, floor=floor), self._batch)

    def advance(self, rolling: Array, dt_s: float, pieces: int = 4) -> Array:
        """Return the twist (..., 3) after `dt_s` seconds.

        `rolling` (..., 3) is the twist without slip and with wheels at their set-points. By the
        trapezoidal rule, with the friction of the previous slip: stable for any step.
        """
        step_s = dt_s / pieces
        told = np.einsum("kij,...j->...ki", self._rows, rolling)
        for _ in range(pieces):
            share = self.spin_share
            over = np.einsum("kij,...j->...ki", self._rows, self.twist)
            slip = share[..., None] * told - over
            slip2 = np.square(slip).sum(axis=-1)
            rim2 = np.square(share * self._rim_mps)
            pull = self._most_n / np.sqrt(slip2 + _SPIN_IN_SLIP**2 * rim2)
            force = pull[..., None] * slip
            drag = step_s * np.einsum("...k,kjl->...jl", pull, self._squares)
            pulled = step_s * np.einsum("...ki,kij->...j", force, self._rows)
            gained = np.asarray(
                np.linalg.solve(self._mass + 0.5 * drag, pulled[..., None]), dtype=float
            )
            self.spin_share = share + step_s * self._spin_up(share, told, force, slip2, rim2)
            self.twist = self.twist + gained[..., 0]
            # Coriolis term: the axes of the body rotate.
            turned = step_s * self.twist[..., 2:]
            self.twist[..., :2] += turned * self.twist[..., 1::-1] * [1.0, -1.0]
        return self.twist

    def push(self, twist: Array, acceleration: Array, dt_s: float) -> tuple[Array, Array]:
        """Inverse of `advance`: return the rolling and the forces for `twist` (3,), over `dt_s`.

        The rolling velocities (k, 2) are those of wheels at their set-points; the forces (k, 2) are
        those at the contacts. `acceleration` (3,) is over the ground, in the frame of the body.
        Demands beyond the friction limit give finite results, but are not reached.
        """
        forces = self._mass @ acceleration
        rim2 = np.square(self.spin_share * self._rim_mps)
        slip = np.zeros((len(self._rows), 2))
        pull = np.zeros(len(self._rows))
        for _ in range(_ROUNDS):
            slip2 = np.square(slip).sum(axis=-1)
            pull = self._most_n / np.sqrt(slip2 + _SPIN_IN_SLIP**2 * rim2)
            grip = np.einsum("k,kjl->jl", pull, self._squares)
            slip = self._rows @ np.asarray(np.linalg.solve(grip, forces), dtype=float)
        force = pull[:, None] * slip
        rolled = (self._rows @ twist + slip) / self.spin_share[:, None]
        slip2 = np.square(slip).sum(axis=-1)
        rise_per_s = self._spin_up(self.spin_share, rolled, force, slip2, rim2)
        self.spin_share = self.spin_share + dt_s * rise_per_s
        return rolled, force

    def _spin_up(self, share: Array, told: Array, force: Array, slip2: Array, rim2: Array) -> Array:
        """Return the spin acceleration: motor torque less the load of push and spin friction."""
        time_constant_s = np.where(share < 1.0, self._up_s, self._down_s)
        pushing = (force * told).sum(axis=-1) / self._spin_rad_per_s
        drilling = self._most_n * self._lever_m * np.sqrt(rim2 / (rim2 + _SLIP_IN_SPIN**2 * slip2))
        return (1.0 - share) / time_constant_s - self._share_per_nms * (pushing + drilling)
