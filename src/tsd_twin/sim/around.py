"""What stands around another simulation and is it in all but a few ways."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Generic, TypeVar

from tsd_twin.drives import Drive
from tsd_twin.lie import Array
from tsd_twin.sim.simulation import Simulation

S = TypeVar("S", bound=Simulation)


class Around(Generic[S]):
    """Passes on what is true; how it is told and measured is for those who inherit."""

    def __init__(self, simulation: S) -> None:
        self.simulation = simulation
        """The one that moves the robot."""

    @property
    def drive(self) -> Drive[Any]:
        """The kinematics that the robot is driven by."""
        return self.simulation.drive

    @property
    def pose(self) -> Any:
        """True pose in the world."""
        return self.simulation.pose

    @property
    def joints(self) -> Array:
        """(..., n): true joint vector."""
        return self.simulation.joints

    def command(self, setpoint: Array) -> None:
        """Give all actuators new set-points, as the other simulation takes them."""
        self.simulation.command(setpoint)

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` seconds pass."""
        self.simulation.advance(dt_s)

    def twist(self) -> Array:
        """Return the true twist (..., 3) in the base frame."""
        return self.simulation.twist()

    def facts(self) -> Mapping[str, object]:
        """Return what the other simulation says."""
        return self.simulation.facts()
