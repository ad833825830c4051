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

    Actuators drive a plant. Measurements are separate from ground truth.
    """

    @property
    def kinematics(self) -> Kinematics[Any]:
        """The kinematics that the robot is driven by."""
        ...

    @property
    def pose(self) -> Any:
        """True pose in the world, of the pose type of the kinematics."""
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
        """Advance by `dt_s` seconds."""
        ...

    def measure(self) -> Array:
        """Return what is measured, (..., n + s): the joints, then the sensors of the robot."""
        ...

    def twist(self) -> Array:
        """Return the true twist (..., 3) in the base frame."""
        ...

    def hardware_status(self) -> Mapping[str, object]:
        """Return the hardware section of the status of a single robot, JSON-serializable."""
        ...


S = TypeVar("S", bound=Simulation)


class SimulationWrapper(Generic[S]):
    """Base class of simulation wrappers: forwards everything but `measure`, which subclasses
    define.
    """

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
        """Set all actuators' set-points, as the wrapped simulation takes them."""
        self.simulation.command(setpoint)

    def advance(self, dt_s: float) -> None:
        """Advance by `dt_s` seconds."""
        self.simulation.advance(dt_s)

    def twist(self) -> Array:
        """Return the true twist (..., 3) in the base frame."""
        return self.simulation.twist()

    def hardware_status(self) -> Mapping[str, object]:
        """Return the hardware status of the wrapped simulation."""
        return self.simulation.hardware_status()


class Actuated(Simulation, Protocol):
    """Simulation whose measurements depend on its joints alone."""

    actuation: Actuation


class DelayWrapper(SimulationWrapper[Actuated]):
    """Simulation wrapper that delays set-points and joint measurements by `delay_s`.

    Ground truth is not delayed. Joints are interpolated linearly between two calls of `advance`.
    """

    def __init__(self, simulation: Actuated, delay_s: float) -> None:
        super().__init__(simulation)
        self._delay_s = delay_s
        self._now_s = 0.0
        self._coming: deque[tuple[float, Array]] = deque()
        self._been: deque[tuple[float, Array]] = deque([(0.0, simulation.joints.copy())])

    def command(self, setpoint: Array) -> None:
        """Queue new set-points, as `Actuation.command` takes them."""
        checked = self.simulation.actuation.checked(setpoint)
        self._coming.append((self._now_s + self._delay_s, checked.copy()))

    def advance(self, dt_s: float) -> None:
        """Advance by `dt_s` seconds; set-points take effect when their delay is over."""
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
