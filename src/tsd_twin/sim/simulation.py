"""The shape all simulations have in common."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from tsd_twin.drives import Drive
from tsd_twin.lie import Array


class Simulation(Protocol):
    """Robots of one description in virtual time: one, or a batch in lockstep.

    Actuators feed a plant. What a robot measures is apart from what is true.
    """

    @property
    def drive(self) -> Drive[Any]:
        """The kinematics that the robot is driven by."""
        ...

    @property
    def pose(self) -> Any:
        """True pose in the world, of the drive's space."""
        ...

    @property
    def joints(self) -> Array:
        """(..., n): true joint vector."""
        ...

    def command(self, setpoint: Array) -> None:
        """Give all actuators new set-points, (..., n) in the order of `drive.joints`.

        Raises:
            ValueError: a number is not finite, or there is not one for each joint.
        """
        ...

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` seconds pass."""
        ...

    def measure(self) -> Array:
        """Return what is measured, (..., n + s): the joints, then the sensors of the robot."""
        ...

    def twist(self) -> Array:
        """Return the true twist (..., 3) in the base frame."""
        ...

    def facts(self) -> Mapping[str, object]:
        """Return what the status of a single robot says about its hardware, fit for JSON."""
        ...
