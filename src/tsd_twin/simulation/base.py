"""Interface of all simulations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from tsd_twin.kinematics import Kinematics
from tsd_twin.lie import Array


class Simulation(Protocol):
    """Identical robots in virtual time: one, or a batch in lockstep.

    Actuators drive a plant. Measurements are separate from ground truth.
    """

    @property
    def kinematics(self) -> Kinematics[Any]:
        """Kinematics used to drive the robot."""
        ...

    @property
    def pose(self) -> Any:
        """True pose in the world (the kinematics' pose type)."""
        ...

    @property
    def joints(self) -> Array:
        """(..., n): true joint vector."""
        ...

    def command(self, setpoint: Array) -> None:
        """Set the setpoints of all actuators, (..., n) in the order of `kinematics.joints`.

        Raises:
            ValueError: If a number is not finite, or the shape is wrong.
        """
        ...

    def degrade(self, shares: Array) -> None:
        """Slow down joints: `shares` (..., n) are speeds relative to healthy joints."""
        ...

    def set_battery(self, battery_v: float) -> None:
        """Set the voltage of the battery."""
        ...

    def advance(self, dt_s: float) -> None:
        """Advance by `dt_s` seconds."""
        ...

    def measure(self) -> Array:
        """Return the measurements (..., n + s): joints, then the robot's sensors."""
        ...

    def twist(self) -> Array:
        """Return the true twist (..., 3) in the base frame."""
        ...

    def hardware_status(self) -> Mapping[str, object]:
        """Return the hardware section of a single robot's status, JSON-serializable."""
        ...
