"""What moves on geared motors in virtual time: goals for the wheels, and what they measure."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from tsd_twin.lie import Array
from tsd_twin.robots.geared_motor import GearedRobot
from tsd_twin.sim.geared_motor import GearedMotors


class GearedSimulation(ABC):
    """Wheels on speed-controlled motors; what they do to the body is for those who inherit.

    `noise` scales the standard deviations of the description: each wheel measures its speed wrong
    by a share that stays the same for the run. Time passes in steps of `longest_step_s` at most.
    """

    longest_step_s: float

    def __init__(
        self,
        robot: GearedRobot,
        shape: tuple[int, ...],
        inertia_kg_m2: float,
        *,
        seed: int | None,
        noise: float,
        battery_v: float | None,
    ) -> None:
        """Take the `shape` (..., k) of a batch of wheels, and what inertia each one feels."""
        self.battery_v = robot.battery.nominal_v if battery_v is None else battery_v
        self.joints: Array = np.zeros(shape)
        """(..., k): true wheel speeds."""
        self._goals = np.zeros(shape)
        share = self.battery_v / robot.battery.nominal_v
        self._motors = GearedMotors.of(robot.motor, inertia_kg_m2, share)
        self._random = np.random.default_rng(seed)
        self._scale = 1.0 + noise * robot.noise.spin_share * self._random.standard_normal(shape)

    def command(self, setpoint: Array) -> None:
        """Give all motors new speeds, (..., k), rad/s.

        Raises:
            ValueError: a number is not finite, or there is not one for each wheel.
        """
        if not np.isfinite(setpoint).all():
            raise ValueError(f"set-points must be finite, these are {setpoint}")
        self._goals[...] = np.broadcast_to(setpoint, self.joints.shape)

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` seconds pass."""
        if self._rests():
            return
        steps = int(np.ceil(dt_s / self.longest_step_s - 1e-9))
        for _ in range(steps):
            self._step(dt_s / steps)

    def measure(self) -> Array:
        """Return the wheel speeds (..., k)."""
        return self.joints * self._scale

    def _rests(self) -> bool:
        return not (self.joints.any() or self._goals.any())

    @abstractmethod
    def _step(self, dt_s: float) -> None:
        """Move wheels and body on by `dt_s` seconds."""
