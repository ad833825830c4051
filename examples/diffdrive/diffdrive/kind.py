"""Description of a differential drive, and the kind that the entry point names.

Simulation, odometry, model and view are imported when they are first used, so that a client loads
only this file and the kinematics.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from diffdrive.kinematics import DiffDriveKinematics
from tsd_twin.registry import RobotKind
from tsd_twin.robots import RPM, JointErrors, RobotDescription, WheelSpeedResponse
from tsd_twin.tables import NotNegative, Positive, Problem, Table


class Geometry(Table, frozen=True, tag="diffdrive", tag_field="kind"):
    """`[drive]`."""

    wheel_radius_m: Positive
    track_m: Positive
    """Distance between the wheels."""


class Motor(Table, frozen=True):
    """`[motor]`, the same for both wheels."""

    top_speed_rpm: Positive
    """Wheel speed without load."""
    acceleration_rpm_per_s: Positive
    """Acceleration of a wheel that carries the robot."""
    time_constant_s: Positive


class Mass(Table, frozen=True):
    """`[mass]`."""

    total_kg: Positive
    wheel_kg: Positive


class Noise(Table, frozen=True):
    """`[noise]`: standard deviations."""

    speed_scale_sigma: NotNegative = 0.0
    """Constant error of a measured wheel speed."""
    skid_share: NotNegative = 0.0
    """Sideways skid in a second, relative to the distance driven."""


class DiffDriveDescription(RobotDescription, frozen=True, kw_only=True):
    """Robot with two driven wheels."""

    drive: Geometry
    motor: Motor
    mass: Mass
    noise: Noise = Noise()

    @property
    def drives_sideways(self) -> bool:
        """Always False, so no paths are planned."""
        return False

    def kinematics(self) -> DiffDriveKinematics:
        """Kinematics."""
        return DiffDriveKinematics(
            wheel_radius_m=self.drive.wheel_radius_m,
            max_speed_rad_per_s=self.motor.top_speed_rpm * RPM,
            max_acceleration_rad_per_s2=self.motor.acceleration_rpm_per_s * RPM,
            track_m=self.drive.track_m,
        )

    def joint_errors(self) -> JointErrors:
        """Errors of the measured wheel speeds."""
        return JointErrors(speed_scale_sigma=self.noise.speed_scale_sigma)

    def spin_up(self) -> WheelSpeedResponse:
        """First-order model of the wheel speeds."""
        return WheelSpeedResponse(0.0, self.motor.time_constant_s, self.motor.time_constant_s)

    def problems(self) -> Iterator[Problem]:
        """Yield a track that is too narrow for the wheels."""
        if self.drive.track_m < 0.5 * self.drive.wheel_radius_m:
            yield f"drive.track_m is {self.drive.track_m:g}", "at least half a wheel radius"


def _odometry(robot: DiffDriveDescription) -> Any:
    from diffdrive.odometry import DiffDriveOdometry

    return DiffDriveOdometry(robot), True


def _simulation(robot: DiffDriveDescription, *args: Any, **options: Any) -> Any:
    from diffdrive.simulation import DiffDriveSimulation

    return DiffDriveSimulation(robot, *args, **options)


def _model() -> Any:
    from diffdrive import model

    return model


def _view(robot: DiffDriveDescription) -> Any:
    from diffdrive.view import DiffDriveTelemetry

    return DiffDriveTelemetry(robot)


KIND = RobotKind(
    DiffDriveDescription,
    odometry=_odometry,
    plants={"kinematic": _simulation},
    model=_model,
    view=_view,
)
