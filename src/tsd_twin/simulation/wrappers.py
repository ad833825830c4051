"""Interface of all simulations, the base class of wrappers around one, and the delay of a servo
bus.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from tsd_twin.kinematics import Kinematics
from tsd_twin.lie import Array
from tsd_twin.simulation.actuators import Actuation


class Simulation(Protocol):
    """Robots of one description in virtual time: one, or a batch in lockstep.

    Actuators feed a plant. What a robot measures is apart from what is true.
    """

    @property
    def kinematics(self) -> Kinematics[Any]:
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

    def hardware_status(self) -> Mapping[str, object]:
        """Return what the status of a single robot says about its hardware, fit for JSON."""
        ...


S = TypeVar("S", bound=Simulation)


class SimulationWrapper(Generic[S]):
    """Passes on what is true; how it is told and measured is for those who inherit."""

    def __init__(self, simulation: S) -> None:
        self.simulation = simulation
        """The one that moves the robot."""

    @property
    def kinematics(self) -> Kinematics[Any]:
        """The kinematics that the robot is driven by."""
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
        """Give all actuators new set-points, as the other simulation takes them."""
        self.simulation.command(setpoint)

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` seconds pass."""
        self.simulation.advance(dt_s)

    def twist(self) -> Array:
        """Return the true twist (..., 3) in the base frame."""
        return self.simulation.twist()

    def hardware_status(self) -> Mapping[str, object]:
        """Return what the other simulation says."""
        return self.simulation.hardware_status()


class Actuated(Simulation, Protocol):
    """A simulation whose measurements are made of its joints alone."""

    actuation: Actuation


class DelayWrapper(SimulationWrapper[Actuated]):
    """Another simulation, which hears of set-points and tells of its joints `delay_s` later.

    What is true is not late. Between the times it was let pass, joints are taken to move evenly.
    """

    def __init__(self, simulation: Actuated, delay_s: float) -> None:
        super().__init__(simulation)
        self._delay_s = delay_s
        self._now_s = 0.0
        self._coming: deque[tuple[float, Array]] = deque()
        self._been: deque[tuple[float, Array]] = deque([(0.0, simulation.joints.copy())])

    def command(self, setpoint: Array) -> None:
        """Send new set-points off, as `Actuation.command` takes them."""
        checked = self.simulation.actuation.checked(setpoint)
        self._coming.append((self._now_s + self._delay_s, checked.copy()))

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` seconds pass; what arrives meanwhile counts from then on."""
        end_s = self._now_s + dt_s
        while self._coming and self._coming[0][0] <= end_s:
            due_s, setpoint = self._coming.popleft()
            self._pass(due_s)
            self.simulation.command(setpoint)
        self._pass(end_s)

    def measure(self) -> Array:
        """Return what was measured `delay_s` ago, (..., n)."""
        asked_s = self._now_s - self._delay_s
        (before_s, before), *rest = self._been
        if not rest or asked_s <= before_s:
            return self.simulation.actuation.measure(before)
        after_s, after = rest[0]
        share = (asked_s - before_s) / (after_s - before_s)
        return self.simulation.actuation.measure(before + share * (after - before))

    def _pass(self, now_s: float) -> None:
        if now_s > self._now_s:
            self.simulation.advance(now_s - self._now_s)
            self._now_s = now_s
            self._been.append((now_s, np.array(self.simulation.joints)))
        while len(self._been) > 1 and self._been[1][0] <= self._now_s - self._delay_s:
            self._been.popleft()
