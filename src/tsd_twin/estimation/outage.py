"""Model of the motion of a robot during a measurement outage, when its joints are not measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsd_twin.lie import Array

OUTAGE_S = 0.1
"""Time without measurements that is an outage, and a fault: until then a robot moves as before."""
HARDWARE_TIMEOUT_S = 0.5
"""Longest command timeout of the hardware: it stops the robot that long after a set-point."""
_SLIDES = 0.3
"""Standard deviation of the speed at which a robot slides in each direction while its hardware
stops it, as a share of its speed."""


@dataclass(frozen=True, slots=True, eq=False)
class OutageStep:
    """Motion in a step of an outage."""

    share: float
    """Mean share of the twist before the outage; 0 once it is surely over."""
    twist: Array
    """(3,): mean twist over the step."""
    white_per_s: Array
    """(3, 3): covariance that the step adds to the displacement, in a second, axes of the base."""
    twist_covariance: Array
    """(3, 3): covariance of the twist at the end of the step."""


class MeasurementOutage:
    """Time without measurements, and how far a robot has moved in it.

    The twist before the outage goes on, and ends at a time that is not known: hardware obeys a
    set-point until its command timeout, and then wheels run down. That time is taken
    as evenly spread between `OUTAGE_S` and the longest one. As wheels stop, the robot slides and
    turns. Derived in `docs/estimation.md`.
    """

    def __init__(self, full_twist: Array, stopping_s: float) -> None:
        """`full_twist` (3,) is full speed along each axis.

        `stopping_s` is the time for which a robot goes on at full twist, at most, once its hardware
        stops it: as far as it moves until it stands.
        """
        self._full_twist = full_twist
        self._spread_s = HARDWARE_TIMEOUT_S + stopping_s - OUTAGE_S
        self._elapsed_s = 0.0
        self._twist: Array = np.zeros(3)
        self._displacement: Array = np.zeros((3, 3))
        """Covariance of the displacement, for each s² of the variance of the time of motion."""

    @property
    def elapsed_s(self) -> float:
        """Time since the last measurement."""
        return self._elapsed_s

    def end(self) -> None:
        """End the outage: there is a measurement."""
        self._elapsed_s = 0.0

    def begin(self, twist: Array) -> None:
        """Begin an outage of a robot that moved with `twist` (3,) by the last measurement."""
        self._twist = twist
        speed = float(np.linalg.norm(twist / self._full_twist))
        slides = np.diag(np.square(_SLIDES * speed * self._full_twist))
        self._displacement = twist[:, None] * twist + slides

    def advance(self, dt_s: float) -> OutageStep:
        """Return the motion of the next `dt_s` without a measurement."""
        before_s = self._elapsed_s
        self._elapsed_s = after_s = before_s + dt_s
        added_s2 = self._variance_s2(after_s) - self._variance_s2(before_s)
        share = (self._mean_s(after_s) - self._mean_s(before_s)) / dt_s
        ended = self._ended(after_s)
        return OutageStep(
            share=share,
            twist=share * self._twist,
            white_per_s=added_s2 / dt_s * self._displacement,
            twist_covariance=ended * (1.0 - ended) * self._displacement,
        )

    def _ended(self, elapsed_s: float) -> float:
        """Return the probability that the motion has ended."""
        return min(max((elapsed_s - OUTAGE_S) / self._spread_s, 0.0), 1.0)

    def _mean_s(self, elapsed_s: float) -> float:
        """Return the expected time for which the motion went on."""
        ended = self._ended(elapsed_s)
        return min(elapsed_s, OUTAGE_S) + self._spread_s * (ended - 0.5 * ended**2)

    def _variance_s2(self, elapsed_s: float) -> float:
        """Return the variance of that time."""
        ended = self._ended(elapsed_s)
        return self._spread_s**2 * (ended**3 / 3.0 - ended**4 / 4.0)
