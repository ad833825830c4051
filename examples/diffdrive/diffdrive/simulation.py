"""Simulation of a differential drive: wheels with a time constant, rolling, and sideways skid."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from diffdrive.kind import DiffDriveDescription
from diffdrive.kinematics import DiffDriveKinematics
from tsd_twin.lie import SE2, Array

_STEP_S = 0.01
"""Maximum integration step."""


class DiffDriveSimulation:
    """`batch` equal robots at the same virtual time; `()` is a single robot."""

    def __init__(
        self,
        robot: DiffDriveDescription,
        batch: tuple[int, ...] = (),
        *,
        seed: int | None = 0,
        noise: float = 0.0,
        battery_v: float | None = None,
        pose: SE2 | None = None,
    ) -> None:
        self.kinematics: DiffDriveKinematics = robot.kinematics()
        self.pose = SE2(np.zeros((*batch, 3)) + (0.0 if pose is None else pose.xy_heading))
        self.joints: Array = np.zeros((*batch, 2))
        self._random = np.random.default_rng(seed)
        self._scale = 1.0 + noise * robot.noise.speed_scale_sigma * self._random.standard_normal(
            self.joints.shape
        )
        self._skid_share = noise * robot.noise.skid_share
        self._time_constant_s = robot.motor.time_constant_s
        self._nominal_v = robot.battery.nominal_v
        self._battery_v = self._nominal_v if battery_v is None else battery_v
        self._setpoint = np.zeros((*batch, 2))
        self._shares = np.ones((*batch, 2))
        self._twist = np.zeros((*batch, 3))

    def command(self, setpoint: Array) -> None:
        """Set the speeds (..., 2) of the wheels, rad/s.

        Raises:
            ValueError: If a number is not finite.
        """
        if not np.isfinite(setpoint).all():
            raise ValueError(f"set-points must be finite, these are {setpoint}")
        self._setpoint[...] = setpoint

    def degrade(self, shares: Array) -> None:
        """Slow the wheels down to `shares` (..., 2) of their setpoints."""
        self._shares[...] = shares

    def set_battery(self, battery_v: float) -> None:
        """Set the voltage of the battery, which limits the speed of the wheels."""
        self._battery_v = battery_v

    def advance(self, dt_s: float) -> None:
        """Advance by `dt_s` seconds."""
        steps = max(1, int(np.ceil(dt_s / _STEP_S - 1e-9)))
        for _ in range(steps):
            self._step(dt_s / steps)

    def measure(self) -> Array:
        """Measured speeds (..., 2) of the wheels."""
        return self.joints * self._scale

    def twist(self) -> Array:
        """True twist (..., 3) in the base frame."""
        return self._twist.copy()

    def hardware_status(self) -> Mapping[str, object]:
        """Voltage of the battery."""
        return {"battery_v": self._battery_v}

    def _step(self, dt_s: float) -> None:
        limit = self.kinematics.max_speed_rad_per_s * self._battery_v / self._nominal_v
        goal = np.clip(self._setpoint * self._shares, -limit, limit)
        before, reached = self.joints, 1.0 - np.exp(-dt_s / self._time_constant_s)
        self.joints = before + reached * (goal - before)
        # The mean speed over the step, because the approach is exponential.
        mean = goal + (before - goal) * reached * self._time_constant_s / dt_s
        moved = self.kinematics.forward(mean).twist * dt_s
        skid = self._skid_share * np.abs(moved[..., 0]) / np.sqrt(dt_s)
        moved[..., 1] = skid * self._random.standard_normal(skid.shape)
        self.pose = self.pose.plus(moved)
        self._twist = self.kinematics.forward(self.joints).twist
