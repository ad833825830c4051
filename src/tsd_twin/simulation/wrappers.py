"""Wrappers around a simulation: delay of the actuator bus, and sensors."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tsd_twin.kinematics import Kinematics
from tsd_twin.lie import Array
from tsd_twin.sensors import MountedSensor
from tsd_twin.sensors.base import BodyMotion
from tsd_twin.simulation.base import Simulation
from tsd_twin.simulation.mujoco_plant import MujocoSimulation
from tsd_twin.simulation.singularity import SingularitySimulation


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


class SensedSimulation(SimulationWrapper):
    """Simulation wrapper that appends the readings of sensors to the measurements.

    `noise` scales the described standard deviations. The sensors are not on the actuator bus, so
    they have no delay.
    """

    def __init__(
        self,
        simulation: Simulation,
        sensors: Sequence[MountedSensor],
        batch: tuple[int, ...] = (),
        *,
        seed: int | None = 0,
        noise: float = 0.0,
    ) -> None:
        super().__init__(simulation)
        # Separate random generators keep the errors of a robot the same with and without a sensor.
        seeds = [None if seed is None else [seed, 2 + i] for i in range(len(sensors))]
        self._sensors = [
            sensor.simulate(table, batch, np.random.default_rng(own), noise)
            for (sensor, table), own in zip(sensors, seeds, strict=True)
        ]

    def advance(self, dt_s: float) -> None:
        """Advance the robots and their sensors by `dt_s` seconds."""
        self.simulation.advance(dt_s)
        motion = BodyMotion(self.simulation.pose, self.simulation.twist())
        for sensor in self._sensors:
            sensor.advance(motion, dt_s)

    def measure(self) -> Array:
        """Return the wrapped simulation's measurements and the readings, (..., n + s)."""
        readings = [sensor.read() for sensor in self._sensors]
        return np.concatenate([self.simulation.measure(), *readings], axis=-1)
