"""The shape all drives have in common."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Generic, Protocol, TypeVar

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
class Motion:
    """What a set of measured joints says about the motion of the robot."""

    twist: Array
    """(..., 3): least-squares twist, metres and radians a second."""
    residual: Array
    """(..., m): what no twist explains, m/s at the contacts; zero when all actuators agree."""


class Drive(Protocol, Generic[PoseT]):
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
    def components(self) -> tuple[int, int, int]:
        """Where the three numbers of a twist stand in a spatial twist (vx, vy, vz, wx, wy, wz)."""
        ...

    @property
    def space(self) -> type[PoseT]:
        """What poses are elements of: SE2 for a robot on a floor, SO3 for a sphere that turns."""
        ...

    @property
    def lever_m(self) -> float:
        """Speed, m/s, that one unit of the first two numbers of a twist is: 1 for a planar twist.

        The radius of a sphere, whose twist is in radians a second: limits are in m/s for all.
        """
        ...

    def inverse(self, twist: Array) -> Array:
        """Return the joint vector (..., n) that moves the robot by `twist` (..., 3)."""
        ...

    def forward(self, joints: Array, rates: Array | None = None) -> Motion:
        """Return the motion that `joints` (..., n), changing at `rates` (..., n), produce."""
        ...

    def blame(self, residual: Array) -> Array:
        """Return what share of the squared residual (..., m) each actuator explains, (..., k)."""
        ...

    def demand(self, twist: Array) -> Array:
        """Return what `twist` (..., 3) asks of the worst joint, as a share of its limit, (...)."""
        ...

    def rate_demand(self, step: Array, dt_s: float) -> Array:
        """Return what changing the twist by `step` within `dt_s` asks of the worst joint, (...)."""
        ...

    def move(self, pose: PoseT, twist: Array, dt_s: float) -> PoseT:
        """Return `pose` after `dt_s` seconds of constant `twist` (..., 3)."""
        ...
