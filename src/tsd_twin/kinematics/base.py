"""Interface of all kinematics: joint vector, inverse, forward, residual; and wheels that are linear
in the twist.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Generic, Protocol, TypeVar

import numpy as np

from tsd_twin.lie import SE2, SO3, Array

PoseT = TypeVar("PoseT", SE2, SO3)


class JointKind(StrEnum):
    """What the number of a joint means."""

    POSITION = "position"
    """An angle in radians; positive as REP-103 turns."""
    VELOCITY = "velocity"
    """A speed in radians a second."""


@dataclass(frozen=True, slots=True)
class Joint:
    """One entry of a joint vector."""

    name: str
    kind: JointKind


@dataclass(frozen=True, slots=True, eq=False)
class TwistSolution:
    """What a set of measured joints says about the motion of the robot."""

    twist: Array
    """(..., 3): least-squares twist, metres and radians a second."""
    residual: Array
    """(..., m): what no twist explains, m/s at the contacts; zero when all actuators agree."""


class Kinematics(Protocol, Generic[PoseT]):
    """Kinematics of one kind of robot: data in, data out, nothing kept.

    A joint vector has one number for each of `joints`, in that order: an angle for a position
    joint, a speed for a velocity joint. All arrays take leading batch dimensions. Linearity is not
    assumed by anybody who uses this.
    """

    @property
    def joints(self) -> tuple[Joint, ...]:
        """Names and kinds of the joints, in the order of the joint vector."""
        ...

    @property
    def actuators(self) -> tuple[str, ...]:
        """Names of the parts that can contradict one another: a module, a wheel."""
        ...

    @property
    def twist_axes(self) -> tuple[int, int, int]:
        """Where the three numbers of a twist stand in a spatial twist (vx, vy, vz, wx, wy, wz)."""
        ...

    @property
    def pose_type(self) -> type[PoseT]:
        """What poses are elements of: SE2 for a robot on a floor, SO3 for a sphere that turns."""
        ...

    @property
    def twist_scale_m(self) -> float:
        """Speed, m/s, that one unit of the first two numbers of a twist is: 1 for a planar twist.

        The radius of a sphere, whose twist is in radians a second: limits are in m/s for all.
        """
        ...

    def inverse(self, twist: Array) -> Array:
        """Return the joint vector (..., n) that moves the robot by `twist` (..., 3)."""
        ...

    def forward(self, joints: Array, rates: Array | None = None) -> TwistSolution:
        """Return the motion that `joints` (..., n), changing at `rates` (..., n), produce."""
        ...

    def fault_contribution(self, residual: Array) -> Array:
        """Return what share of the squared residual (..., m) each actuator explains, (..., k)."""
        ...

    def joint_utilization(self, twist: Array) -> Array:
        """Return what `twist` (..., 3) asks of the worst joint, as a share of its limit, (...)."""
        ...

    def rate_utilization(self, step: Array, dt_s: float) -> Array:
        """Return what changing the twist by `step` within `dt_s` asks of the worst joint, (...)."""
        ...

    def integrate(self, pose: PoseT, twist: Array, dt_s: float) -> PoseT:
        """Return `pose` after `dt_s` seconds of constant `twist` (..., 3)."""
        ...


class WheelKinematics:
    """Limits, inverse and forward kinematics from one matrix, by least squares.

    Subclasses have these as fields.
    """

    __slots__ = ()

    wheel_radius_m: float
    max_speed_rad_per_s: float
    """Of a wheel."""
    max_acceleration_rad_per_s2: float
    """Of a wheel that takes the robot along."""
    speeds_from_twist: Array
    """(k, 3): wheel speeds from the twist."""
    twist_from_speeds: Array
    """(3, k): its pseudo-inverse."""
    _leave_one_out_gain: Array
    """(k,): inverse of each wheel's own part of the residual projection; 0 where it has none."""

    @property
    def wheels(self) -> int:
        """Number of wheels."""
        return len(self.speeds_from_twist)

    @property
    def joints(self) -> tuple[Joint, ...]:
        """`wheel1`, `wheel2`, ..."""
        return tuple(Joint(name, JointKind.VELOCITY) for name in self.actuators)

    @property
    def actuators(self) -> tuple[str, ...]:
        """`wheel1`, `wheel2`, ..."""
        return tuple(f"wheel{i + 1}" for i in range(self.wheels))

    def joint_utilization(self, twist: Array) -> Array:
        """Return the speed of the fastest wheel over its limit, (...); 1 is at the limit."""
        return self._largest_speed(twist) / self.max_speed_rad_per_s

    def rate_utilization(self, step: Array, dt_s: float) -> Array:
        """Return the acceleration of the worst wheel over its limit, (...), for a twist `step`."""
        return self._largest_speed(step) / (self.max_acceleration_rad_per_s2 * dt_s)

    def _largest_speed(self, twist: Array) -> Array:
        return np.maximum.reduce(np.abs(twist @ self.speeds_from_twist.T), axis=-1)

    def inverse(self, twist: Array) -> Array:
        """Return the wheel speeds (..., k) for `twist` (..., 3), scaled to the speed limit."""
        speeds = twist @ self.speeds_from_twist.T
        worst = np.maximum.reduce(np.abs(speeds), axis=-1, keepdims=True)
        return speeds * (self.max_speed_rad_per_s / np.maximum(worst, self.max_speed_rad_per_s))

    def forward(self, joints: Array, rates: Array | None = None) -> TwistSolution:  # noqa: ARG002  The shape.
        """Return the least-squares twist, and the residual (..., k) in m/s that no twist explains.

        It is zero when the wheels agree; three wheels always do. It cannot see all wheels slide
        alike. Rates of wheel speeds say nothing about the twist.
        """
        twist = joints @ self.twist_from_speeds.T
        left = joints - twist @ self.speeds_from_twist.T
        return TwistSolution(twist, self.wheel_radius_m * left)

    def fault_contribution(self, residual: Array) -> Array:
        """Return how much of the squared `residual` (..., k) each wheel explains alone, (..., k).

        The drop of the squared residual when the equation of a wheel is left out.
        """
        return residual * residual * self._leave_one_out_gain


def leave_one_out_gain(rows: Array, back: Array) -> Array:
    """Return `_leave_one_out_gain` (k,) of wheels with the matrix `rows` (k, 3) and its
    pseudo-inverse.
    """
    own = 1.0 - np.einsum("ij,ji->i", rows, back)
    # A wheel that nothing else can stand in for leaves no residual.
    return np.where(own > 1e-9, 1.0 / np.maximum(own, 1e-9), 0.0)
