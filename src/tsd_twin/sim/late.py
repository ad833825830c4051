"""A simulation at the far end of a bus: what it is told and what it measures comes late."""

from __future__ import annotations

from collections import deque
from typing import Protocol

import numpy as np

from tsd_twin.lie import Array
from tsd_twin.sim.actuation import Actuation
from tsd_twin.sim.around import Around
from tsd_twin.sim.simulation import Simulation


class Actuated(Simulation, Protocol):
    """A simulation whose measurements are made of its joints alone."""

    actuation: Actuation


class LateSimulation(Around[Actuated]):
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
