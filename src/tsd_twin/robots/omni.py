"""Descriptions of robots on geared motors: omni and Mecanum platforms, spheres on omni wheels."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from msgspec import Meta
from msgspec.structs import replace as replace_fields

from tsd_twin.kinematics import OmniKinematics, SphereKinematics
from tsd_twin.kinematics.omni import contacts_and_directions, layout_problem, sphere_layout_problem
from tsd_twin.lie import Array
from tsd_twin.robots.description import GRAVITY_MPS2, RPM, BuildErrors, RobotDescription
from tsd_twin.robots.joint_model import JointErrors, WheelSpeedResponse
from tsd_twin.robots.plausibility import proportion_problems
from tsd_twin.sensors import MountedSensor
from tsd_twin.sensors.dead_wheels import DEAD_WHEELS, DeadWheels
from tsd_twin.sensors.gyro import GYRO, Gyro
from tsd_twin.tables import NotNegative, Positive, Problem, Table

ROLLER_CREEP_MPS = 0.01
"""Creep scale: roller friction saturates at a few times this creep."""


class GearedMotor(Table, frozen=True):
    """`[motor]`: drive motor with gearbox, encoder and speed control; identical for all wheels."""

    power_w: Positive
    """Maximum mechanical power, at half the no-load speed."""
    gear_ratio: Positive
    """Motor turns per wheel turn."""
    no_load_speed_rpm: Positive
    """No-load speed of the motor at nominal battery voltage."""
    rotor_inertia_kg_m2: Positive
    """Inertia of the rotor."""
    time_constant_s: Positive
    """Time constant of a wheel's speed control."""
    current_limit: Positive = 1.0
    """Torque limit of the motor driver, relative to the stall torque."""
    temperature_limit_c: Annotated[float, Meta(ge=40.0, le=150.0)] = 80.0
    """Temperature at which the motor or its driver shuts off; the robot slows down 10 °C below."""

    @property
    def top_speed_rad_per_s(self) -> float:
        """No-load speed of the wheel."""
        return self.no_load_speed_rpm * RPM / self.gear_ratio

    @property
    def stall_torque_nm(self) -> float:
        """Stall torque at the wheel, from the peak power of a linear torque curve."""
        return 4.0 * self.power_w / self.top_speed_rad_per_s

    @property
    def rotor_at_wheel_kg_m2(self) -> float:
        """Inertia of the rotor, reflected to the wheel."""
        return self.rotor_inertia_kg_m2 * self.gear_ratio**2

    def acceleration_rad_per_s2(self, inertia_kg_m2: float) -> float:
        """Return the acceleration of a wheel with this inertia from rest."""
        return self.stall_torque_nm * min(1.0, self.current_limit) / inertia_kg_m2


class WheelNoise(Table, frozen=True):
    """`[noise]`: standard deviations, for the covariance and as the simulator's default."""

    speed_scale_sigma: NotNegative = 0.0
    """Standard deviation of a measured wheel speed."""
    creep_m: NotNegative = 0.0002
    """Standard deviation of each contact's creep distance in a second, while wheels turn."""


class GearedMotorDescription(RobotDescription, frozen=True, kw_only=True):
    """Robot with identical geared-motor wheels."""

    motor: GearedMotor
    noise: WheelNoise = WheelNoise()
    drive: OmniGeometry | SphereGeometry

    @property
    def servo_limit_c(self) -> float:
        """Temperature at which motors shut off."""
        return self.motor.temperature_limit_c

    def joint_errors(self) -> JointErrors:
        """Return the errors of the wheel speeds."""
        noise = self.noise
        return JointErrors(
            speed_scale_sigma=noise.speed_scale_sigma,
            random_walk_rad=noise.creep_m / self.drive.wheel_radius_m,
        )

    def spin_up(self) -> WheelSpeedResponse:
        """Return a first-order model of a wheel speed, valid while torque and grip suffice."""
        time_constant_s = self.motor.time_constant_s
        return WheelSpeedResponse(0.0, time_constant_s, time_constant_s)


def _carried_kg_m2(twist_from_speeds: Array, body: Array) -> float:
    """Return the maximum inertia at a wheel due to a body with masses and inertias (3,).

    This is the maximum over all motions of the kinetic energy in terms of the wheel speeds.
    """
    by_wheels = twist_from_speeds.T @ (body[:, None] * twist_from_speeds)
    return float(np.linalg.eigvalsh(by_wheels)[-1])


class OmniWheel(Table, frozen=True):
    """Entry of `[[drive.wheels]]`."""

    x_m: float
    y_m: float
    direction_deg: float
    """Driving direction of the wheel, from X towards Y."""
    roller_deg: float = 0.0
    """Axle of the roller on the floor relative to that direction: 0 for omni, ±45 for Mecanum."""


class OmniGeometry(Table, frozen=True, tag="omni", tag_field="kind"):
    """`[drive]` of a platform on wheels with rollers."""

    wheel_radius_m: Positive
    wheels: Annotated[list[OmniWheel], Meta(min_length=1, max_length=12)]
    friction: Positive = 0.6
    """Friction of the rollers on the floor."""
    slip: Annotated[float, Meta(ge=0.0, lt=1.0)] = 0.0
    """Slip of each wheel rim relative to its travel, in the simulator."""


class OmniMass(Table, frozen=True):
    """`[mass]`: for the dynamics and the URDF."""

    total_kg: Positive
    wheel_kg: Positive
    yaw_inertia_kg_m2: Positive
    """Inertia of the whole robot about the vertical through its centre."""


class OmniDescription(GearedMotorDescription, frozen=True, kw_only=True):
    """Platform on wheels with rollers."""

    drive: OmniGeometry
    mass: OmniMass
    errors: BuildErrors = BuildErrors()
    gyro: Gyro | None = None
    dead_wheels: DeadWheels | None = None

    @property
    def own_sensors(self) -> tuple[MountedSensor, ...]:
        """Tracking wheels with their gyro, or the gyro alone."""
        if self.dead_wheels is not None:
            return ((DEAD_WHEELS, self.dead_wheels),)
        return () if self.gyro is None else ((GYRO, self.gyro),)

    def with_errors(self, scale: float) -> Self:
        """Return the robot with its `[errors]` multiplied by `scale`; 0 removes them.

        Raises:
            TwinError: If the scale is negative or not finite.
        """
        return replace_fields(self, errors=self.errors.scaled(scale))

    def kinematics(self) -> OmniKinematics:
        """Return the kinematics."""
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
        """Return the maximum inertia at a wheel, including its fraction of the robot."""
        return self.wheel_inertia_kg_m2 + _carried_kg_m2(drive.twist_from_speeds, self.inertia)

    @property
    def inertia(self) -> Array:
        """(3,): mass for motion along X and Y, kg, and yaw inertia, kg m²."""
        mass = self.mass
        return np.array([mass.total_kg, mass.total_kg, mass.yaw_inertia_kg_m2])

    @property
    def contact_friction_n(self) -> float:
        """Maximum friction per wheel, under equal loads."""
        return self.drive.friction * self.mass.total_kg * GRAVITY_MPS2 / len(self.drive.wheels)

    def joint_errors(self) -> JointErrors:
        """Return the errors of the wheel speeds and of roller creep.

        Friction is proportional to a small creep. The force of all wheels is therefore a matrix
        times the twist between body and wheels, and its inverse gives the twist needed for an
        acceleration.
        """
        grip = self.kinematics().grip_from_twist
        force_per_twist = self.contact_friction_n / ROLLER_CREEP_MPS * grip.T @ grip
        lag_s = np.linalg.inv(force_per_twist) * self.inertia
        rows = tuple(tuple(float(value) for value in row) for row in lag_s)
        errors = self.errors
        return replace(
            super().joint_errors(),
            creep_lag_s=rows,
            mount_rad=math.radians(errors.mount_deg),
            place_m=errors.place_m,
            slope_mps2=errors.slope_mps2 / math.sqrt(2.0),
        )

    def problems(self) -> Iterator[Problem]:
        """Yield the problems of the layouts of driven and tracking wheels."""
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
            if self.gyro is not None:
                yield "gyro: the dead wheels have one", "[gyro] or [dead_wheels]"
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


class SphereWheel(Table, frozen=True):
    """Entry of `[[drive.wheels]]`."""

    azimuth_deg: float
    """Azimuth of the contact, from X towards Y."""
    below_equator_deg: Annotated[float, Meta(gt=-90.0, lt=90.0)]
    """Angle of the contact below the equator."""
    turn_deg: float = 0.0
    """Rotation of the wheel about the outward normal; at 0 it pushes horizontally,
    counter-clockwise."""


class SphereGeometry(Table, frozen=True, tag="sphere", tag_field="kind"):
    """`[drive]` of a spherical platform."""

    sphere_radius_m: Positive
    wheel_radius_m: Positive
    roller_radius_m: Positive
    row_distance_m: NotNegative
    """Distance between the two rows of rollers along the axle; 0 is an ideal wheel."""
    rollers: Annotated[int, Meta(ge=2)]
    """Number of rollers per wheel, in both rows together."""
    wheels: Annotated[list[SphereWheel], Meta(min_length=1, max_length=8)]


class SphereMass(Table, frozen=True):
    """`[mass]`: for the dynamics and the URDF."""

    total_kg: Positive
    """Total mass of stand, wheels and sphere."""
    sphere_kg: Positive
    wheel_kg: Positive


class EstimateSettings(Table, frozen=True):
    """`[estimate]`: settings of the estimator."""

    model: Literal["ideal", "dual"] = "dual"
    """Kinematic model of the estimate: contacts midway between the rows, or dual-row."""


class SphereDescription(GearedMotorDescription, frozen=True, kw_only=True):
    """Sphere on omni wheels."""

    drive: SphereGeometry
    mass: SphereMass
    estimate: EstimateSettings = EstimateSettings()
    not_drawn: ClassVar[frozenset[str]] = RobotDescription.not_drawn - {"motor"}
    """The model has the wheel speed limit of the motors."""

    def kinematics(self) -> SphereKinematics:
        """Return the kinematics."""
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
        """Return the maximum inertia at a wheel, including its fraction of a solid sphere."""
        mass, g = self.mass, self.drive
        sphere = np.full(3, 0.4 * mass.sphere_kg * g.sphere_radius_m**2)
        rim = 0.5 * mass.wheel_kg * g.wheel_radius_m**2
        carried = _carried_kg_m2(drive.twist_from_speeds, sphere)
        return self.motor.rotor_at_wheel_kg_m2 + rim + carried

    def problems(self) -> Iterator[Problem]:
        """Yield impossible rows and rollers, and impossible rotations of the mounting."""
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
        if problem := sphere_layout_problem(*self._mounting()):
            yield (
                f"drive.wheels: {problem}",
                "three or more wheels with axes that do not all lie in one plane",
            )

    @property
    def _roller_circle_m(self) -> float:
        """Distance between the centres of the sphere and of the supporting roller."""
        return self.drive.sphere_radius_m + self.drive.roller_radius_m

    def _mounting(self) -> tuple[Array, Array]:
        wheels = self.drive.wheels
        return contacts_and_directions(
            np.radians([wheel.azimuth_deg for wheel in wheels]),
            np.radians([wheel.below_equator_deg for wheel in wheels]),
            np.radians([wheel.turn_deg for wheel in wheels]),
        )
