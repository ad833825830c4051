"""Kinematics interface, kinematics linear in the twist, and sets of reachable twists.

The set of twists within the joint limits is convex and symmetric about zero, and
`joint_utilization` is its gauge: 1 on the boundary, 2 at twice the twist. For wheels with a speed
limit it is a polytope, for gimbals an intersection of elliptic cylinders.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from tsd_twin.lie import SE2, SO3, Array

PoseT = TypeVar("PoseT", SE2, SO3)


class JointKind(StrEnum):
    """Quantity of a joint value: angle or speed."""

    POSITION = "position"
    """Angle in radians; sign as in REP-103."""
    VELOCITY = "velocity"
    """Speed in rad/s."""


@dataclass(frozen=True, slots=True)
class Joint:
    """One entry of a joint vector."""

    name: str
    kind: JointKind
    unit: str = ""
    """Unit of a sensor's channel, such as `m`; "" for rad or rad/s, by `kind`."""


@dataclass(frozen=True, slots=True, eq=False)
class TwistSolution:
    """Forward-kinematics solution: least-squares twist and residual."""

    twist: Array
    """(..., 3): least-squares twist, m/s and rad/s."""
    residual: Array
    """(..., m): residual at the contacts, m/s; zero if all actuators are consistent."""


class Kinematics(Protocol, Generic[PoseT]):
    """Stateless kinematics of one kind of robot.

    A joint vector has one value per entry of `joints`, in that order: an angle for a position
    joint, a speed for a velocity joint. All arrays accept leading batch dimensions. Callers must
    not assume linearity.
    """

    @property
    def wheel_radius_m(self) -> float:
        """Radius of the wheels."""
        ...

    @property
    def joints(self) -> tuple[Joint, ...]:
        """Names and kinds of the joints, in joint-vector order."""
        ...

    @property
    def actuators(self) -> tuple[str, ...]:
        """Names of the actuators checked for consistency: modules or wheels."""
        ...

    @property
    def twist_axes(self) -> tuple[int, int, int]:
        """Indices of the three twist components in a spatial twist (vx, vy, vz, wx, wy, wz)."""
        ...

    @property
    def pose_type(self) -> type[PoseT]:
        """Lie group of the poses: SE2 on a floor, SO3 for a turning sphere."""
        ...

    @property
    def twist_scale_m(self) -> float:
        """Speed in m/s per unit of the first two twist components; 1 for planar twists.

        For a sphere, whose twist is in rad/s, it is the radius, because limits are in m/s for all
        robots.
        """
        ...

    def inverse(self, twist: Array) -> Array:
        """Return the joint vector (..., n) for `twist` (..., 3)."""
        ...

    def forward(self, joints: Array, rates: Array | None = None) -> TwistSolution:
        """Return the motion produced by `joints` (..., n) changing at `rates` (..., n)."""
        ...

    def fault_contribution(self, residual: Array) -> Array:
        """Return the fraction (..., k) of the squared residual (..., m) due to each actuator."""
        ...

    def joint_utilization(self, twist: Array) -> Array:
        """Return the largest joint value for `twist` (..., 3) relative to its limit, (...)."""
        ...

    def rate_utilization(self, step: Array, dt_s: float) -> Array:
        """Return the largest relative joint rate for a twist `step` in `dt_s`, (...)."""
        ...

    def integrate(self, pose: PoseT, twist: Array, dt_s: float) -> PoseT:
        """Return `pose` after `dt_s` of constant `twist` (..., 3)."""
        ...


def set_matrices(kinematics: object, matrices: Mapping[str, npt.NDArray[Any]]) -> None:
    """Set computed fields of frozen kinematics to read-only arrays."""
    for name, value in matrices.items():
        value.setflags(write=False)
        object.__setattr__(kinematics, name, value)


@dataclass(frozen=True, slots=True, eq=False)
class ContactLayout:
    """Places of wheels on the floor and directions in which they grip, in the robot frame."""

    places_m: Array
    """(k, 2)."""
    directions: Array
    """(k, m, 2): unit vectors; the wheels impose the ground velocity along these."""
    twist_from_grips: Array
    """(3, k, m): least-squares twist from those velocities."""
    rollers_rad: Array
    """(k,): angle between a direction and the direction of its wheel; 0 without rollers."""

    def slopes(self, twist: Array) -> Array:
        """Return the twist error (3, 4 k) per error of the layout at `twist` (3,).

        For each wheel: an angle by which it is mounted wrongly, rad; an angle of its rollers, rad;
        displacements along X and Y, m. Turned rollers also change the speed that the wheel imposes
        along their axles.
        """
        velocities = self._velocities(twist)[:, None]
        turned = -(self._turned * velocities).sum(axis=-1)
        along = (self.directions * velocities).sum(axis=-1)
        rollers = turned - along * np.tan(self.rollers_rad)[:, None]
        rollers = rollers * (self.rollers_rad != 0.0)[:, None]
        x, y = self.directions[..., 0], self.directions[..., 1]
        omega = float(twist[2])
        grips = np.stack([turned, rollers, -omega * y, omega * x], axis=1)  # (k, 4, m)
        errors = (self.twist_from_grips[:, :, None] * grips).sum(axis=-1)
        return np.asarray(errors.reshape(3, -1), dtype=float)

    @property
    def _turned(self) -> Array:
        return np.stack([-self.directions[..., 1], self.directions[..., 0]], axis=-1)

    def _velocities(self, twist: Array) -> Array:
        x, y = self.places_m.T
        vx, vy, omega = twist.tolist()
        return np.stack([vx - omega * y, vy + omega * x], axis=-1)


class PlanarMotion:
    """Planar part of `Kinematics`, shared by all robots on a floor."""

    __slots__ = ()

    @property
    def twist_axes(self) -> tuple[int, int, int]:
        """Planar: vx, vy, omega."""
        return (0, 1, 5)

    @property
    def pose_type(self) -> type[SE2]:
        """Planar poses."""
        return SE2

    @property
    def twist_scale_m(self) -> float:
        """Twists are in m/s."""
        return 1.0

    def integrate(self, pose: SE2, twist: Array, dt_s: float) -> SE2:
        """Return `pose` after `dt_s` of constant body `twist` (..., 3)."""
        return pose.plus(twist * dt_s)

    @property
    def contact_layout(self) -> ContactLayout | None:
        """Places and directions in which wheels grip, or None if the kinematics have none."""
        return None


@cache
def _wheel_joints(wheels: int) -> tuple[Joint, ...]:
    return tuple(Joint(f"wheel{i + 1}", JointKind.VELOCITY) for i in range(wheels))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WheelKinematics:
    """Kinematics of wheels that are linear in the twist: limits, inverse and least-squares forward.

    Subclasses call `_set_wheel_matrices` at the end of construction.
    """

    wheel_radius_m: float
    max_speed_rad_per_s: float
    """Speed limit of a wheel."""
    max_acceleration_rad_per_s2: float
    """Acceleration limit of a wheel under load."""
    speeds_from_twist: Array = field(init=False)
    """(k, 3): maps a twist to wheel speeds."""
    twist_from_speeds: Array = field(init=False)
    """(3, k): pseudo-inverse of `speeds_from_twist`."""
    _leave_one_out_gain: Array = field(init=False, repr=False)
    """(k,): reciprocal diagonal of the residual projection; 0 for wheels without redundancy."""

    def _set_wheel_matrices(self, speeds_from_twist: Array, **others: Array) -> None:
        """Set the wheel matrices, and `others` of the subclass."""
        back: Array = np.asarray(np.linalg.pinv(speeds_from_twist), dtype=float)
        own = 1.0 - np.einsum("ij,ji->i", speeds_from_twist, back)
        # A wheel without redundancy leaves no residual.
        gain = np.where(own > 1e-9, 1.0 / np.maximum(own, 1e-9), 0.0)
        matrices = {"speeds_from_twist": speeds_from_twist, "twist_from_speeds": back}
        set_matrices(self, matrices | {"_leave_one_out_gain": gain} | others)

    @property
    def wheels(self) -> int:
        """Number of wheels."""
        return len(self.speeds_from_twist)

    @property
    def joints(self) -> tuple[Joint, ...]:
        """`wheel1`, `wheel2`, ..."""
        return _wheel_joints(self.wheels)

    @property
    def actuators(self) -> tuple[str, ...]:
        """Names of the wheels."""
        return tuple(joint.name for joint in self.joints)

    def joint_utilization(self, twist: Array) -> Array:
        """Return the speed of the fastest wheel relative to its limit, (...)."""
        return self._max_wheel_speed(twist) / self.max_speed_rad_per_s

    def rate_utilization(self, step: Array, dt_s: float) -> Array:
        """Return the largest relative wheel acceleration, (...), for a twist `step`."""
        return self._max_wheel_speed(step) / (self.max_acceleration_rad_per_s2 * dt_s)

    def _max_wheel_speed(self, twist: Array) -> Array:
        return np.maximum.reduce(np.abs(twist @ self.speeds_from_twist.T), axis=-1)

    def inverse(self, twist: Array) -> Array:
        """Return the wheel speeds (..., k) for `twist` (..., 3), scaled to the speed limit."""
        speeds = twist @ self.speeds_from_twist.T
        worst = np.maximum.reduce(np.abs(speeds), axis=-1, keepdims=True)
        return speeds * (self.max_speed_rad_per_s / np.maximum(worst, self.max_speed_rad_per_s))

    def forward(self, joints: Array, rates: Array | None = None) -> TwistSolution:  # noqa: ARG002  Common signature.
        """Return the least-squares twist, and the unexplained residual (..., k) in m/s.

        The residual is zero if the wheels are consistent, as three wheels always are. Equal slip of
        all wheels is not observable. Rates of wheel speeds do not affect the twist.
        """
        twist = joints @ self.twist_from_speeds.T
        left = joints - twist @ self.speeds_from_twist.T
        return TwistSolution(twist, self.wheel_radius_m * left)

    def fault_contribution(self, residual: Array) -> Array:
        """Return the fraction (..., k) of the squared `residual` (..., k) due to each wheel.

        It equals the decrease of the squared residual when the wheel's equation is omitted.
        """
        return residual * residual * self._leave_one_out_gain


@dataclass(frozen=True, slots=True, eq=False)
class TwistKinematics(PlanarMotion):
    """Kinematics of a robot that accepts twists: the joints are the twist's components.

    For robots with an external motion controller, whose wheels are unknown. The residual is empty
    because there is no redundancy.
    """

    speed_mps: float
    turn_rate_rad_per_s: float
    sideways: bool
    """Whether the robot can drive sideways; otherwise `vy` has no joint and no effect."""
    wheel_radius_m: float = field(init=False, default=0.0)
    """Zero, because the wheels are unknown."""

    @property
    def joints(self) -> tuple[Joint, ...]:
        """`vx`, `vy` and `omega`, in m/s and rad/s."""
        return tuple(Joint(name, JointKind.VELOCITY) for name in self.actuators)

    @property
    def actuators(self) -> tuple[str, ...]:
        """Names of the twist components that the robot can follow."""
        return ("vx", "vy", "omega") if self.sideways else ("vx", "omega")

    @property
    def _columns(self) -> list[int]:
        return [0, 1, 2] if self.sideways else [0, 2]

    @property
    def _component_limits(self) -> Array:
        most = np.array([self.speed_mps, self.speed_mps, self.turn_rate_rad_per_s])
        return most[self._columns]

    def inverse(self, twist: Array) -> Array:
        """Return the components (..., n) of `twist` (..., 3), scaled to the limits."""
        joints = twist[..., self._columns]
        worst = np.max(np.abs(joints) / self._component_limits, axis=-1, keepdims=True)
        return joints / np.maximum(1.0, worst)

    def forward(self, joints: Array, rates: Array | None = None) -> TwistSolution:  # noqa: ARG002  Common signature.
        """Return the twist with these components, and an empty residual."""
        twist = np.zeros((*joints.shape[:-1], 3))
        twist[..., self._columns] = joints
        return TwistSolution(twist, np.zeros((*joints.shape[:-1], 0)))

    def fault_contribution(self, residual: Array) -> Array:
        """Return zeros (..., k), because there is no residual."""
        return np.zeros((*residual.shape[:-1], len(self.actuators)))

    def joint_utilization(self, twist: Array) -> Array:
        """Return the largest component of `twist` (..., 3) relative to its limit, (...)."""
        return np.maximum.reduce(
            np.abs(twist[..., self._columns]) / self._component_limits, axis=-1
        )

    def rate_utilization(self, step: Array, dt_s: float) -> Array:  # noqa: ARG002  Common signature.
        """Return 0 (...): accelerations are limited by the description only."""
        return np.maximum.reduce(0.0 * step, axis=-1)


_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_STEPS = 64
"""Iterations of the golden-section search, which reduce the interval by a factor of 1e-13."""


def largest_twist(kinematics: Kinematics[Any], direction: Array) -> Array:
    """Return the largest twist (..., 3) along a non-zero `direction` within the joint limits."""
    return direction / kinematics.joint_utilization(direction)[..., None]


def section(kinematics: Kinematics[Any], axes: tuple[int, int], points: int) -> Array:
    """Return the boundary (points, 2) of the reachable twists whose third component is zero."""
    return largest_twist(kinematics, _directions(kinematics, axes, points))[:, axes]


def shadow(kinematics: Kinematics[Any], axes: tuple[int, int], points: int) -> Array:
    """Return the boundary (points, 2) of all reachable twists projected onto two components.

    The third component is free, so the projection can be wider than the section.
    """
    towards = _directions(kinematics, axes, points)
    return largest_projection(kinematics, towards, 3 - sum(axes))[:, axes]


def largest_projection(kinematics: Kinematics[Any], towards: Array, free: int) -> Array:
    """Return the largest twists (n, 3) along `towards` (n, 3), with a free component `free`.

    `towards` is zero in that component. Utilization is convex in it and minimized by a
    golden-section search.
    """
    axis = np.eye(3)[free]

    def demand(s: Array) -> Array:
        return kinematics.joint_utilization(towards + s[:, None] * axis)

    # u(d + s e) >= |s| u(e) - u(d), so the minimum satisfies |s| <= 2 u(d) / u(e).
    alone = kinematics.joint_utilization(towards)
    high = 2.0 * alone / kinematics.joint_utilization(axis)
    low = -high
    for _ in range(_STEPS):
        left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        is_left = demand(left) < demand(right)
        low, high = np.where(is_left, low, left), np.where(is_left, right, high)
    return towards / np.minimum(demand(0.5 * (low + high)), alone)[:, None]


def _directions(kinematics: Kinematics[Any], axes: tuple[int, int], points: int) -> Array:
    """Return directions (points, 3) in a plane, evenly spaced relative to the axes' limits."""
    angles = np.linspace(0.0, 2.0 * np.pi, points, endpoint=False)
    directions = np.zeros((points, 3))
    directions[:, axes[0]], directions[:, axes[1]] = np.cos(angles), np.sin(angles)
    return directions / kinematics.joint_utilization(np.eye(3))
