"""The description of a platform on wheels with rollers: omni wheels, Killough's three, Mecanum."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated

import numpy as np
from msgspec import Meta

from tsd_twin.kinematics import Joint, JointKind, OmniKinematics
from tsd_twin.kinematics.omni import layout_problem
from tsd_twin.lie import Array
from tsd_twin.robots.description import (
    GearedMotorDescription,
    NotNegative,
    Positive,
    Problem,
    Table,
    carried_kg_m2,
)
from tsd_twin.robots.plausibility import proportion_problems


class OmniWheel(Table, frozen=True):
    """One of `[[drive.wheels]]`."""

    x_m: float
    y_m: float
    direction_deg: float
    """Driving direction of the wheel, from X towards Y."""
    roller_deg: float = 0.0
    """Axle of the roller on the floor, from that direction: 0 for omni, +-45 for Mecanum."""


class OmniGeometry(Table, frozen=True, tag="omni", tag_field="kind"):
    """`[drive]` of a platform on wheels with rollers."""

    wheel_radius_m: Positive
    wheels: Annotated[list[OmniWheel], Meta(min_length=1, max_length=12)]
    friction: Positive = 0.6
    """Friction of the rollers on the floor."""
    slip: Annotated[float, Meta(ge=0.0, lt=1.0)] = 0.0
    """Slip of each wheel rim as a share of its travel, in the simulator."""


class OmniMass(Table, frozen=True):
    """`[mass]`: for the dynamics and the URDF."""

    total_kg: Positive
    wheel_kg: Positive
    yaw_inertia_kg_m2: Positive
    """Inertia of the whole robot about the vertical through its centre."""


class DeadWheel(Table, frozen=True):
    """One of `[[dead_wheels.wheels]]`: a passive wheel with an encoder along its direction."""

    x_m: float
    y_m: float
    direction_deg: float


class DeadWheels(Table, frozen=True):
    """`[dead_wheels]`: two passive encoder wheels in L, and a rate gyro for the heading."""

    radius_m: Positive
    pulses_per_turn: Positive
    wheels: Annotated[list[DeadWheel], Meta(min_length=2, max_length=2)]
    gyro_range_deg_per_s: Positive
    gyro_drift_deg_per_h: NotNegative = 0.0
    """Drift of the gyro in an hour at rest."""
    radius_share: NotNegative = 0.002
    """Standard deviation of the radius of each wheel, as a share."""
    mounting_deg: NotNegative = 0.1
    """Standard deviation of the direction of each wheel."""

    def rows(self, turned_rad: float = 0.0) -> tuple[tuple[float, float, float], ...]:
        """Return the velocity over the ground that each wheel measures, from the body twist.

        `turned_rad` is added to the direction of each.
        """
        angles = [np.radians(wheel.direction_deg) + turned_rad for wheel in self.wheels]
        return tuple(
            (float(np.cos(a)), float(np.sin(a)), float(w.x_m * np.sin(a) - w.y_m * np.cos(a)))
            for a, w in zip(angles, self.wheels, strict=True)
        )


class OmniDescription(GearedMotorDescription, frozen=True, kw_only=True):
    """A platform on wheels with rollers."""

    drive: OmniGeometry
    mass: OmniMass
    dead_wheels: DeadWheels | None = None

    @property
    def sensors(self) -> tuple[Joint, ...]:
        """Sensors: angles of the dead wheels, and the rate of the gyro."""
        if self.dead_wheels is None:
            return ()
        return (
            Joint("dead1", JointKind.POSITION),
            Joint("dead2", JointKind.POSITION),
            Joint("gyro", JointKind.VELOCITY),
        )

    @property
    def wheel_radius_m(self) -> float:
        """Radius of the driven wheels."""
        return self.drive.wheel_radius_m

    def kinematics(self) -> OmniKinematics:
        """Kinematics."""
        positions, directions, rollers = self._layout()
        drive = OmniKinematics(
            positions_m=positions,
            directions_rad=directions,
            rollers_rad=rollers,
            wheel_radius_m=self.drive.wheel_radius_m,
            max_speed_rad_per_s=self.motor.top_speed_rad_per_s,
            max_acceleration_rad_per_s2=math.inf,
        )
        inertia = self.driven_inertia_kg_m2(drive)
        return replace(
            drive, max_acceleration_rad_per_s2=self.motor.acceleration_rad_per_s2(inertia)
        )

    @property
    def wheel_inertia_kg_m2(self) -> float:
        """Inertia of a wheel with its rotor."""
        rim = 0.5 * self.mass.wheel_kg * self.drive.wheel_radius_m**2
        return rim + self.motor.rotor_at_wheel_kg_m2

    def driven_inertia_kg_m2(self, drive: OmniKinematics) -> float:
        """Largest inertia at a wheel: its own and its share of the robot."""
        mass = self.mass
        body = np.array([mass.total_kg, mass.total_kg, mass.yaw_inertia_kg_m2])
        return self.wheel_inertia_kg_m2 + carried_kg_m2(drive.twist_from_speeds, body)

    def problems(self) -> Iterator[Problem]:
        """Yield the problems of the layouts of driven and dead wheels."""
        if problem := layout_problem(*self._layout()):
            yield (
                f"drive.wheels: {problem}",
                "three or more wheels that do not all drive along lines through one point",
            )
        yield from proportion_problems(
            ("drive.wheel_radius_m", self.drive.wheel_radius_m),
            ("drive.wheels", max(math.hypot(wheel.x_m, wheel.y_m) for wheel in self.drive.wheels)),
            self.mass.total_kg,
        )
        if self.dead_wheels is not None:
            (ax, ay, _), (bx, by, _) = self.dead_wheels.rows()
            if abs(ax * by - ay * bx) < 0.1:
                yield (
                    "dead_wheels.wheels: both measure along one direction",
                    "two directions, best at right angles",
                )

    def _layout(self) -> tuple[Array, Array, Array]:
        wheels = self.drive.wheels
        return (
            np.array([[wheel.x_m, wheel.y_m] for wheel in wheels]),
            np.radians([wheel.direction_deg for wheel in wheels]),
            np.radians([wheel.roller_deg for wheel in wheels]),
        )
