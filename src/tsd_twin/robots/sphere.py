"""The description of a spherical platform: a sphere that omni wheels turn in place."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from tsd_twin.kinematics import SphereKinematics
from tsd_twin.kinematics.sphere import contacts_and_directions, layout_problem
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


class SphereWheel(Table, frozen=True):
    """One of `[[drive.wheels]]`."""

    azimuth_deg: float
    """Azimuth of the contact, from X towards Y."""
    below_equator_deg: Annotated[float, Meta(gt=-90.0, lt=90.0)]
    """Angle of the contact below the equator."""
    turn_deg: float = 0.0
    """Turn of the wheel about the outward normal; 0 pushes horizontally, counter-clockwise."""


class SphereGeometry(Table, frozen=True, tag="sphere", tag_field="kind"):
    """`[drive]` of a spherical platform."""

    sphere_radius_m: Positive
    wheel_radius_m: Positive
    roller_radius_m: Positive
    row_distance_m: NotNegative
    """Distance of the two rows of rollers along the axle; 0 is an ideal wheel."""
    rollers: Annotated[int, Meta(ge=2)]
    """Number of rollers of a wheel, both rows together."""
    wheels: Annotated[list[SphereWheel], Meta(min_length=1, max_length=8)]


class SphereMass(Table, frozen=True):
    """`[mass]`: for the dynamics and the URDF."""

    total_kg: Positive
    """Mass of stand, wheels and sphere."""
    sphere_kg: Positive
    wheel_kg: Positive


class Estimate(Table, frozen=True):
    """`[estimate]`."""

    model: Literal["ideal", "dual"] = "dual"
    """Kinematic model of the estimate: contacts half-way between the rows, or dual-row."""


class SphereDescription(GearedMotorDescription, frozen=True, kw_only=True):
    """A sphere on omni wheels."""

    drive: SphereGeometry
    mass: SphereMass
    estimate: Estimate = Estimate()

    @property
    def wheel_radius_m(self) -> float:
        """Radius of the driven wheels."""
        return self.drive.wheel_radius_m

    def kinematics(self) -> SphereKinematics:
        """Kinematics."""
        g = self.drive
        contacts, actuations = self._mounting()
        drive = SphereKinematics(
            contacts=contacts,
            actuations=actuations,
            sphere_radius_m=g.sphere_radius_m,
            wheel_radius_m=g.wheel_radius_m,
            row_offset_rad=math.asin(g.row_distance_m / (2.0 * self._roller_circle_m)),
            row_rad=2.0 * math.pi / g.rollers,
            max_speed_rad_per_s=self.motor.top_speed_rad_per_s,
            max_acceleration_rad_per_s2=math.inf,
        )
        inertia = self.driven_inertia_kg_m2(drive)
        return replace(
            drive, max_acceleration_rad_per_s2=self.motor.acceleration_rad_per_s2(inertia)
        )

    def driven_inertia_kg_m2(self, drive: SphereKinematics) -> float:
        """Largest inertia at a wheel: its own and its share of a solid sphere."""
        mass, g = self.mass, self.drive
        sphere = np.full(3, 0.4 * mass.sphere_kg * g.sphere_radius_m**2)
        rim = 0.5 * mass.wheel_kg * g.wheel_radius_m**2
        carried = carried_kg_m2(drive.twist_from_speeds, sphere)
        return self.motor.rotor_at_wheel_kg_m2 + rim + carried

    def problems(self) -> Iterator[Problem]:
        """Yield impossible rows and rollers, and missing turns of the mounting."""
        if self.drive.rollers % 2:
            yield f"drive.rollers is {self.drive.rollers}", "an even number: two rows of as many"
        if self.drive.row_distance_m >= 2.0 * self._roller_circle_m:
            yield "drive.row_distance_m: the rows are farther apart than the sphere is wide", ""
            return
        yield from proportion_problems(
            ("drive.wheel_radius_m", self.drive.wheel_radius_m),
            ("drive.sphere_radius_m", self.drive.sphere_radius_m),
            self.mass.total_kg,
        )
        if problem := layout_problem(*self._mounting()):
            yield (
                f"drive.wheels: {problem}",
                "three or more wheels with axes that do not all lie in one plane",
            )

    @property
    def _roller_circle_m(self) -> float:
        """Distance of the middle of a roller that carries from the centre of the sphere."""
        return self.drive.sphere_radius_m + self.drive.roller_radius_m

    def _mounting(self) -> tuple[Array, Array]:
        wheels = self.drive.wheels
        return contacts_and_directions(
            np.radians([wheel.azimuth_deg for wheel in wheels]),
            np.radians([wheel.below_equator_deg for wheel in wheels]),
            np.radians([wheel.turn_deg for wheel in wheels]),
        )
