"""Delay of measurements and set-points."""

from __future__ import annotations

from collections import deque

import numpy as np

from tsd_twin.lie import Array
from tsd_twin.simulation.base import SimulationWrapper
from tsd_twin.simulation.mujoco_plant import MujocoSimulation
from tsd_twin.simulation.singularity import SingularitySimulation


class DelayWrapper(SimulationWrapper):
    """Simulation wrapper that delays setpoints and joint measurements by `delay_s`.

    Ground truth is not delayed. Joints are interpolated linearly between two calls of `advance`.
    """

    def __init__(
        self, simulation: SingularitySimulation | MujocoSimulation, delay_s: float
    ) -> None:
        super().__init__(simulation)
        self._actuation = simulation.actuation
        self._delay_s = delay_s
        self._now_s = 0.0
        self._in_transit: deque[tuple[float, Array]] = deque()
        self._history: deque[tuple[float, Array]] = deque([(0.0, simulation.joints.copy())])

    def command(self, setpoint: Array) -> None:
        """Queue setpoints, as in `Actuation.command`."""
        checked = self._actuation.checked(setpoint)
        self._in_transit.append((self._now_s + self._delay_s, checked.copy()))

    def advance(self, dt_s: float) -> None:
        """Advance by `dt_s` seconds; setpoints take effect after their delay."""
        end_s = self._now_s + dt_s
        while self._in_transit and self._in_transit[0][0] <= end_s:
            due_s, setpoint = self._in_transit.popleft()
            self._pass(due_s)
            self.simulation.command(setpoint)
        self._pass(end_s)

    def measure(self) -> Array:
        """Return the measurements (..., n) from `delay_s` ago."""
        delayed_s = self._now_s - self._delay_s
        (before_s, before), *rest = self._history
        if not rest or delayed_s <= before_s:
            return self._actuation.measure(before)
        after_s, after = rest[0]
        share = (delayed_s - before_s) / (after_s - before_s)
        return self._actuation.measure(before + share * (after - before))

    def _pass(self, now_s: float) -> None:
        if now_s > self._now_s:
            self.simulation.advance(now_s - self._now_s)
            self._now_s = now_s
            self._history.append((now_s, np.array(self.simulation.joints)))
        while len(self._history) > 1 and self._history[1][0] <= self._now_s - self._delay_s:
            self._history.popleft()
