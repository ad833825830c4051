"""Dead wheels: passive tracking wheels with encoders, and a rate gyro for the heading."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from msgspec import Meta

from tsd_twin.kinematics import Joint, JointKind
from tsd_twin.lie import Array
from tsd_twin.sensors.base import Bias, BodyMotion, Sensor
from tsd_twin.tables import NotNegative, Positive, Table


class DeadWheel(Table, frozen=True):
    """Entry of `[[dead_wheels.wheels]]`: a passive wheel with an encoder along its direction."""

    x_m: float
    y_m: float
    direction_deg: float


class DeadWheels(Table, frozen=True):
    """`[dead_wheels]`: two perpendicular tracking wheels, and a rate gyro for the heading."""

    radius_m: Positive
    pulses_per_turn: Positive
    wheels: Annotated[list[DeadWheel], Meta(min_length=2, max_length=2)]
    gyro_range_deg_per_s: Positive
    gyro_drift_deg_per_h: NotNegative = 0.0
    """Drift of the gyro in an hour at rest."""
    radius_share: NotNegative = 0.002
    """Relative standard deviation of each wheel's radius."""
    mounting_deg: NotNegative = 0.1
    """Standard deviation of each wheel's direction."""

    def rows(self, turned_rad: float = 0.0) -> tuple[tuple[float, float, float], ...]:
        """Return the ground velocity measured by each wheel, as rows from the body twist.

        `turned_rad` is added to each direction.
        """
        angles = [np.radians(wheel.direction_deg) + turned_rad for wheel in self.wheels]
        return tuple(
            (float(np.cos(a)), float(np.sin(a)), float(w.x_m * np.sin(a) - w.y_m * np.cos(a)))
            for a, w in zip(angles, self.wheels, strict=True)
        )


class DeadWheelSensors:
    """Two passive tracking wheels without slip, and a gyro; arrays have a leading batch."""

    def __init__(
        self, sensors: DeadWheels, batch: tuple[int, ...], random: np.random.Generator, noise: float
    ) -> None:
        self._step_rad = 2.0 * math.pi / sensors.pulses_per_turn
        self._range = math.radians(sensors.gyro_range_deg_per_s)
        drift = noise * math.radians(sensors.gyro_drift_deg_per_h) / 3600.0
        self._drift = drift * random.standard_normal(batch)
        rows = np.array(sensors.rows())
        across = np.array(sensors.rows(0.5 * math.pi))
        turned = noise * math.radians(sensors.mounting_deg) * random.standard_normal((*batch, 2, 1))
        radius = 1.0 + noise * sensors.radius_share * random.standard_normal((*batch, 2, 1))
        self._rows = (np.cos(turned) * rows + np.sin(turned) * across) / (sensors.radius_m * radius)
        # Wheels start anywhere between two pulses.
        between = random.uniform(0.0, self._step_rad, (*batch, 2))
        self._rate: Array = np.zeros(batch)
        self._angles = between if noise > 0.0 else np.zeros((*batch, 2))

    def advance(self, motion: BodyMotion, dt_s: float) -> None:
        """Integrate the wheel angles for `dt_s` at the twist of `motion`."""
        self._rate = motion.twist[..., 2]
        self._angles = self._angles + dt_s * (self._rows @ motion.twist[..., None])[..., 0]

    def read(self) -> Array:
        """Return both angles in whole pulses, radians, and the rate, rad/s, (..., 3)."""
        pulses = np.floor(self._angles / self._step_rad) * self._step_rad
        rate = np.clip(self._rate + self._drift, -self._range, self._range)
        return np.concatenate([pulses, rate[..., None]], axis=-1)


class _DeadWheelSensor:
    """Dead wheels; `DeadWheelOdometry` computes pose and twist from them."""

    def channels(self, table: DeadWheels) -> tuple[Joint, ...]:  # noqa: ARG002  Common signature.
        """Return the angles of both wheels, and the turn rate."""
        angles = (Joint(name, JointKind.POSITION) for name in ("dead1", "dead2"))
        return (*angles, Joint("gyro", JointKind.VELOCITY))

    def biases(self, table: DeadWheels) -> tuple[Bias, ...]:
        """Return the errors of radii and directions, and the drift of the gyro."""
        mounting_rad = math.radians(table.mounting_deg)
        return (
            Bias("dead_wheel1_share", table.radius_share),
            Bias("dead_wheel2_share", table.radius_share),
            Bias("dead_wheel1_mounting_rad", mounting_rad),
            Bias("dead_wheel2_mounting_rad", mounting_rad),
            Bias("gyro_bias_rad_per_s", math.radians(table.gyro_drift_deg_per_h) / 3600.0),
        )

    def simulate(
        self, table: DeadWheels, batch: tuple[int, ...], random: np.random.Generator, scale: float
    ) -> DeadWheelSensors:
        """Return the dead wheels of simulated robots."""
        return DeadWheelSensors(table, batch, random, scale)

    def model(self, table: DeadWheels) -> None:
        """Return None: an odometry uses the sensor."""


DEAD_WHEELS: Sensor[DeadWheels] = _DeadWheelSensor()
