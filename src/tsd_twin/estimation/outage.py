"""Motion model for measurement outages, when joints are not measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsd_twin.lie import Array

OUTAGE_S = 0.1
"""Time without measurements after which an outage begins and a fault is raised."""
HARDWARE_TIMEOUT_S = 0.5
"""Maximum command timeout of the hardware, after which it stops the robot."""
_SLIP_SIGMA = 0.3
"""Standard deviation of the slip speed in each direction while the hardware stops the robot,
relative to its speed."""


@dataclass(frozen=True, slots=True, eq=False)
class CoastStep:
    """Motion during one step of an outage."""

    share: float
    """Mean fraction of the twist before the outage; 0 once motion has certainly ended."""
    twist: Array
    """(3,): mean twist over the step."""
    white_per_s: Array
    """(3, 3): displacement covariance added per second, base axes."""
    twist_covariance: Array
    """(3, 3): covariance of the twist at the end of the step."""


class MeasurementOutage:
    """Duration of an outage and the expected motion during it.

    The twist from before the outage continues until an unknown time: hardware obeys a setpoint
    until its command timeout, and then the wheels run down. This time is modelled as uniform
    between `OUTAGE_S` and the maximum. While wheels stop, the robot slides and turns. Derived in
    `docs/estimation.md`.
    """

    def __init__(self, full_twist: Array, stopping_s: float) -> None:
        """Initialize the model.

        Args:
            full_twist: (3,) full speed along each axis.
            stopping_s: Maximum stopping distance after the hardware stops the robot, expressed as
                time at full twist.
        """
        self._full_twist = full_twist
        self._width_s = HARDWARE_TIMEOUT_S + stopping_s - OUTAGE_S
        self.elapsed_s = 0.0
        """Time since the last measurement."""
        self._twist: Array = np.zeros(3)
        self._displacement: Array = np.zeros((3, 3))
        """Displacement covariance per s² of variance of the motion time."""

    def end(self) -> None:
        """End the outage after a measurement."""
        self.elapsed_s = 0.0

    def begin(self, twist: Array) -> None:
        """Begin an outage of a robot last measured with `twist` (3,)."""
        self._twist = twist
        speed = float(np.linalg.norm(twist / self._full_twist))
        slides = np.diag(np.square(_SLIP_SIGMA * speed * self._full_twist))
        self._displacement = twist[:, None] * twist + slides

    def advance(self, dt_s: float) -> CoastStep:
        """Return the motion during the next `dt_s` without a measurement."""
        before_s = self.elapsed_s
        self.elapsed_s = after_s = before_s + dt_s
        added_s2 = self._variance_s2(after_s) - self._variance_s2(before_s)
        share = (self._mean_s(after_s) - self._mean_s(before_s)) / dt_s
        ended = self._ended(after_s)
        return CoastStep(
            share=share,
            twist=share * self._twist,
            white_per_s=added_s2 / dt_s * self._displacement,
            twist_covariance=ended * (1.0 - ended) * self._displacement,
        )

    def _ended(self, elapsed_s: float) -> float:
        """Return the probability that motion has ended."""
        return min(max((elapsed_s - OUTAGE_S) / self._width_s, 0.0), 1.0)

    def _mean_s(self, elapsed_s: float) -> float:
        """Return the expected duration of the motion."""
        ended = self._ended(elapsed_s)
        return min(elapsed_s, OUTAGE_S) + self._width_s * (ended - 0.5 * ended**2)

    def _variance_s2(self, elapsed_s: float) -> float:
        """Return the variance of the motion's duration."""
        ended = self._ended(elapsed_s)
        return self._width_s**2 * (ended**3 / 3.0 - ended**4 / 4.0)
