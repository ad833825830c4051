"""Views by robot kind: telemetry, and parameters and wheels for the Student tab."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from tsd_twin.dashboard.sessions.actuator_telemetry import (
    ActuatorTelemetry,
    GimbalDisplay,
    GimbalTelemetry,
    JointTelemetry,
    SphereTelemetry,
    TwistTelemetry,
    WheelTelemetry,
    joint_rows,
    wheel_poses,
)
from tsd_twin.dashboard.sessions.student_drives import (
    GIMBAL_STUDY,
    ROLLER_STUDY,
    SPHERE_STUDY,
    DriveStudy,
)
from tsd_twin.lie import Array
from tsd_twin.registry import KindTable
from tsd_twin.robots import (
    ExternalDescription,
    OmniDescription,
    RobotDescription,
    SingularityDescription,
    SphereDescription,
)


@dataclass(frozen=True, slots=True)
class TunableParameter:
    """A tunable number of a description, or the same number for each entry of a list."""

    key: str
    """Dotted table keys; `*` matches each entry of a list."""
    label: str
    """Label with `{}` for the entry number, counted from 1."""
    unit: str
    least: float
    most: float
    step: float


_WHEEL_RADIUS = TunableParameter("drive.wheel_radius_m", "Wheel radius", "m", 0.01, 0.2, 0.001)
_GEARED_MOTOR = (
    TunableParameter("motor.gear_ratio", "Gear ratio", "", 1.0, 60.0, 0.1),
    TunableParameter(
        "motor.no_load_speed_rpm", "Motor speed, no load", "rpm", 500.0, 15000.0, 100.0
    ),
)
SINGULARITY_KNOBS = (
    TunableParameter("drive.pivot_radius_m", "Pivot radius", "m", 0.05, 0.6, 0.005),
    _WHEEL_RADIUS,
    TunableParameter("drive.max_tilt_deg", "Tilt limit", "°", 2.0, 60.0, 1.0),
    TunableParameter("drive.cruise_speed_rpm", "Drive speed", "rpm", 500.0, 15000.0, 50.0),
    TunableParameter("drive.azimuths_deg.*", "Azimuth {}", "°", -360.0, 360.0, 5.0),
)
"""Tunable parameters of a singularity drive."""
OMNI_KNOBS = (
    _WHEEL_RADIUS,
    *_GEARED_MOTOR,
    TunableParameter("drive.wheels.*.x_m", "Wheel {} forward", "m", -0.6, 0.6, 0.01),
    TunableParameter("drive.wheels.*.y_m", "Wheel {} left", "m", -0.6, 0.6, 0.01),
    TunableParameter("drive.wheels.*.direction_deg", "Wheel {} direction", "°", -360.0, 360.0, 5.0),
    TunableParameter("drive.wheels.*.roller_deg", "Wheel {} roller", "°", -80.0, 80.0, 5.0),
)
"""Tunable parameters of a platform on wheels with rollers."""
SPHERE_KNOBS = (
    TunableParameter("drive.sphere_radius_m", "Sphere radius", "m", 0.05, 0.6, 0.005),
    _WHEEL_RADIUS,
    *_GEARED_MOTOR,
    TunableParameter("drive.wheels.*.azimuth_deg", "Wheel {} azimuth", "°", -360.0, 360.0, 5.0),
    TunableParameter(
        "drive.wheels.*.below_equator_deg", "Wheel {} below equator", "°", -80.0, 80.0, 5.0
    ),
    TunableParameter("drive.wheels.*.turn_deg", "Wheel {} turn", "°", -180.0, 180.0, 5.0),
)
"""Tunable parameters of a sphere on wheels."""


@dataclass(frozen=True, slots=True)
class RobotView:
    """Dashboard view of a robot kind."""

    telemetry: Callable[[Any], ActuatorTelemetry]
    """Class or factory of the actuator telemetry, called with the description."""
    joint_fields: Callable[[Any, Array], dict[str, Any]] = joint_rows
    """Fields of `JointPreview` for kinematics and a joint vector (n,)."""
    knobs: tuple[TunableParameter, ...] = ()
    """Description numbers offered in the Student tab."""
    study: DriveStudy | None = None
    """Wheels, equations and figures for the Student tab."""


def _wheel_fields(drive: Any, joints: Array) -> dict[str, Any]:
    return {"wheels": wheel_poses(drive, joints)}


_JOINTS = RobotView(JointTelemetry)
_VIEWS = KindTable(
    {
        SingularityDescription: RobotView(
            GimbalTelemetry,
            lambda drive, joints: {"modules": GimbalDisplay(drive).poses(joints)},
            SINGULARITY_KNOBS,
            GIMBAL_STUDY,
        ),
        OmniDescription: RobotView(WheelTelemetry, _wheel_fields, OMNI_KNOBS, ROLLER_STUDY),
        SphereDescription: RobotView(SphereTelemetry, _wheel_fields, SPHERE_KNOBS, SPHERE_STUDY),
        ExternalDescription: RobotView(TwistTelemetry, lambda _drive, _joints: {}),
    },
    lambda kind: None if kind.view is None else RobotView(kind.view),
    _JOINTS,
)


def view_of(robot: RobotDescription) -> RobotView:
    """Return the view of a robot; kinds without one get a list of joints."""
    return _VIEWS.of(robot)
