"""Kinematics of platforms on wheels with rollers: omni wheels, Killough's three, Mecanum.

Source: Savnani et al. 2019, Eq. 4 for one wheel and Eq. 8 to 11 for four of them. One class does
any number of wheels with any roller angle; `docs/kinematics.md` has symbols and a drawing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from tsd_twin.drives.drive import Joint, JointKind, Motion
from tsd_twin.lie import SE2, Array

_SINGULAR = 1e-3
"""Weakest motion of a layout against its strongest; below this it counts as impossible."""


@dataclass(frozen=True, slots=True, eq=False)
class OmniDrive:
    """Any number of driven wheels with rollers, at least three.

    A wheel turns forward towards its `direction`. The axle of the roller on the floor lies in that
    direction, turned by the `roller` angle about Z: 0 for an omni wheel, 45 degrees for Mecanum.
    Along its axle a roller holds the floor, across it rolls freely. In the symbols of the paper the
    direction is `lambda + alpha - 90 degrees` and the roller angle `psi`. The joint vector holds
    the speeds of the wheels.
    """

    positions_m: Array
    """(k, 2): of the wheels in the robot frame, X forward and Y left."""
    directions_rad: Array
    """(k,): where each wheel drives to, from X towards Y."""
    rollers_rad: Array
    """(k,): axle of the roller on the floor, from the direction of the wheel."""
    wheel_radius_m: float
    max_speed_rad_per_s: float
    """Of a wheel."""
    max_acceleration_rad_per_s2: float
    """Of a wheel that takes the robot along."""
    grip_from_twist: Array = field(init=False)
    """(k, 3): velocity of each wheel over the ground along the axle of its roller."""
    speeds_from_twist: Array = field(init=False)
    """(k, 3): wheel speeds from the body twist, Eq. 4 divided by r cos psi."""
    twist_from_speeds: Array = field(init=False)
    """(3, k): its pseudo-inverse."""
    _leave_out: Array = field(init=False, repr=False)
    """(k,): inverse of each wheel's own part of the residual projection; 0 where it has none."""

    def __post_init__(self) -> None:
        """Build the matrices.

        Raises:
            ValueError: the wheels cannot move the robot in every way, or one has no grip forward.
        """
        problem = impossible(self.positions_m, self.directions_rad, self.rollers_rad)
        if problem:
            raise ValueError(problem)
        grip = _grip(self.positions_m, self.directions_rad, self.rollers_rad)
        rows = grip / (self.wheel_radius_m * np.cos(self.rollers_rad))[:, None]
        back = np.linalg.pinv(rows)
        own = 1.0 - np.einsum("ij,ji->i", rows, back)
        for name, value in (
            ("grip_from_twist", grip),
            ("speeds_from_twist", rows),
            ("twist_from_speeds", back),
            # A wheel that nothing else can stand in for leaves no residual.
            ("_leave_out", np.where(own > 1e-9, 1.0 / np.maximum(own, 1e-9), 0.0)),
        ):
            value.setflags(write=False)
            object.__setattr__(self, name, value)

    @property
    def wheels(self) -> int:
        """Number of wheels."""
        return len(self.directions_rad)

    @property
    def joints(self) -> tuple[Joint, ...]:
        """`wheel1`, `wheel2`, ..."""
        return tuple(Joint(name, JointKind.VELOCITY) for name in self.actuators)

    @property
    def actuators(self) -> tuple[str, ...]:
        """`wheel1`, `wheel2`, ..."""
        return tuple(f"wheel{i + 1}" for i in range(self.wheels))

    @property
    def components(self) -> tuple[int, int, int]:
        """The motion is planar: vx, vy, omega."""
        return (0, 1, 5)

    @property
    def space(self) -> type[SE2]:
        """Poses are planar."""
        return SE2

    @property
    def lever_m(self) -> float:
        """Twists are in metres a second."""
        return 1.0

    def demand(self, twist: Array) -> Array:
        """Return the speed of the fastest wheel over its limit, (...); 1 is at the limit."""
        return self._fastest(twist) / self.max_speed_rad_per_s

    def rate_demand(self, step: Array, dt_s: float) -> Array:
        """Return the acceleration of the worst wheel over its limit, (...), for a twist `step`."""
        return self._fastest(step) / (self.max_acceleration_rad_per_s2 * dt_s)

    def _fastest(self, twist: Array) -> Array:
        return np.maximum.reduce(np.abs(twist @ self.speeds_from_twist.T), axis=-1)

    def inverse(self, twist: Array) -> Array:
        """Return the wheel speeds (..., k) for body `twist` (..., 3), scaled to the speed limit."""
        speeds = twist @ self.speeds_from_twist.T
        worst = np.maximum.reduce(np.abs(speeds), axis=-1, keepdims=True)
        return speeds * (self.max_speed_rad_per_s / np.maximum(worst, self.max_speed_rad_per_s))

    def forward(self, joints: Array, rates: Array | None = None) -> Motion:  # noqa: ARG002  The shape.
        """Return the least-squares twist, and the residual (..., k) in m/s that no twist explains.

        It is zero when the wheels agree; three wheels always do. It cannot see all wheels slide
        alike. Rates of wheel speeds say nothing about the twist.
        """
        twist = joints @ self.twist_from_speeds.T
        left = joints - twist @ self.speeds_from_twist.T
        return Motion(twist, self.wheel_radius_m * left)

    def blame(self, residual: Array) -> Array:
        """Return how much of the squared `residual` (..., k) each wheel explains alone, (..., k).

        The drop of the squared residual when the equation of a wheel is left out.
        """
        return residual * residual * self._leave_out

    def move(self, pose: SE2, twist: Array, dt_s: float) -> SE2:
        """Return `pose` after `dt_s` seconds of constant body `twist` (..., 3)."""
        return pose.plus(twist * dt_s)


def impossible(positions_m: Array, directions_rad: Array, rollers_rad: Array) -> str:
    """Return in words which motion wheels (k,) cannot make, or which wheel is none; empty if fine.

    Of an omnidirectional platform every twist must move some wheel; a twist that moves none is one
    that no wheel can make or hold.
    """
    weak = np.flatnonzero(np.abs(np.cos(rollers_rad)) < 0.1)
    if len(weak):
        return f"the rollers of wheel {weak[0] + 1} roll where it drives to: it has no grip forward"
    if len(directions_rad) < 3:
        return f"{len(directions_rad)} wheels cannot move a robot in all three ways"
    rows = _grip(positions_m, directions_rad, rollers_rad)
    reach_m = max(float(np.hypot(*positions_m.T).max()), 1e-9)
    _, strengths, motions = np.linalg.svd(rows / [1.0, 1.0, reach_m])
    if strengths[-1] > _SINGULAR * strengths[0]:
        return ""
    vx, vy, omega = motions[-1] / [1.0, 1.0, reach_m]
    if abs(omega) * reach_m < 1e-3:
        return f"no wheel can push the robot towards {math.degrees(math.atan2(vy, vx)):.0f} degrees"
    x, y = (round(float(v), 6) + 0.0 for v in (-vy / omega, vx / omega))
    return f"no wheel can turn the robot about the point x = {x:.3g} m, y = {y:.3g} m"


def _grip(positions_m: Array, directions_rad: Array, rollers_rad: Array) -> Array:
    """Return the velocities (k, 3) over the ground along the rollers' axles, from the twist.

    Eq. 4, left side: the axle of the roller is at lambda + alpha + psi - 90 degrees, and
    -l cos(alpha + psi) is what turning moves the wheel along it.
    """
    c, s = np.cos(directions_rad + rollers_rad), np.sin(directions_rad + rollers_rad)
    x, y = positions_m[:, 0], positions_m[:, 1]
    return np.stack([c, s, s * x - c * y], axis=-1)
