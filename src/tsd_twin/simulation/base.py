"""Interface of all simulations, and the base class of wrappers around one."""

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


class SimulationWrapper:
    """Base class of simulation wrappers: forwards all but `measure`, which subclasses define."""

    def __init__(self, simulation: Simulation) -> None:
        self.simulation = simulation
        """Wrapped simulation."""

    @property
    def kinematics(self) -> Kinematics[Any]:
        """Kinematics used to drive the robot."""
        return self.simulation.kinematics

    @property
    def pose(self) -> Any:
        """True pose in the world."""
        return self.simulation.pose

    @property
    def joints(self) -> Array:
        """(..., n): true joint vector."""
        return self.simulation.joints

    def command(self, setpoint: Array) -> None:
        """Set the setpoints of the wrapped simulation."""
        self.simulation.command(setpoint)

    def degrade(self, shares: Array) -> None:
        """Slow down joints of the wrapped simulation."""
        self.simulation.degrade(shares)

    def set_battery(self, battery_v: float) -> None:
        """Set the voltage of the battery."""
        self.simulation.set_battery(battery_v)

    def advance(self, dt_s: float) -> None:
        """Advance by `dt_s` seconds."""
        self.simulation.advance(dt_s)

    def twist(self) -> Array:
        """Return the true twist (..., 3) in the base frame."""
        return self.simulation.twist()

    def hardware_status(self) -> Mapping[str, object]:
        """Return the hardware status of the wrapped simulation."""
        return self.simulation.hardware_status()
