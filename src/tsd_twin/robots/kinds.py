"""Registry of robot kinds: references to their implementations in every layer.

Implementations are in higher layers. The registry refers to them as `module:name` and imports them
at first use, so layers remain independent and programs load only what they need.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from tsd_twin.robots.description import RobotDescription
from tsd_twin.robots.imported import ImportedDescription
from tsd_twin.robots.omni import OmniDescription, SphereDescription
from tsd_twin.robots.singularity import SingularityDescription


@dataclass(frozen=True, slots=True)
class Knob:
    """A tunable number of a description, or the same number for each entry of a list."""

    key: str
    """Dotted table keys; `*` matches each entry of a list."""
    label: str
    """Label with `{}` for the entry number, counted from 1."""
    unit: str
    least: float
    most: float
    step: float


_WHEEL_RADIUS = Knob("drive.wheel_radius_m", "Wheel radius", "m", 0.01, 0.2, 0.001)
_GEARED_MOTOR = (
    Knob("motor.gear_ratio", "Gear ratio", "", 1.0, 60.0, 0.1),
    Knob("motor.no_load_speed_rpm", "Motor speed, no load", "rpm", 500.0, 15000.0, 100.0),
)
SINGULARITY_KNOBS = (
    Knob("drive.pivot_radius_m", "Pivot radius", "m", 0.05, 0.6, 0.005),
    _WHEEL_RADIUS,
    Knob("drive.max_tilt_deg", "Tilt limit", "°", 2.0, 60.0, 1.0),
    Knob("drive.cruise_speed_rpm", "Drive speed", "rpm", 500.0, 15000.0, 50.0),
    Knob("drive.azimuths_deg.*", "Azimuth {}", "°", -360.0, 360.0, 5.0),
)
"""Tunable parameters of a singularity drive."""
OMNI_KNOBS = (
    _WHEEL_RADIUS,
    *_GEARED_MOTOR,
    Knob("drive.wheels.*.x_m", "Wheel {} forward", "m", -0.6, 0.6, 0.01),
    Knob("drive.wheels.*.y_m", "Wheel {} left", "m", -0.6, 0.6, 0.01),
    Knob("drive.wheels.*.direction_deg", "Wheel {} direction", "°", -360.0, 360.0, 5.0),
    Knob("drive.wheels.*.roller_deg", "Wheel {} roller", "°", -80.0, 80.0, 5.0),
)
"""Tunable parameters of a platform on wheels with rollers."""
SPHERE_KNOBS = (
    Knob("drive.sphere_radius_m", "Sphere radius", "m", 0.05, 0.6, 0.005),
    _WHEEL_RADIUS,
    *_GEARED_MOTOR,
    Knob("drive.wheels.*.azimuth_deg", "Wheel {} azimuth", "°", -360.0, 360.0, 5.0),
    Knob("drive.wheels.*.below_equator_deg", "Wheel {} below equator", "°", -80.0, 80.0, 5.0),
    Knob("drive.wheels.*.turn_deg", "Wheel {} turn", "°", -180.0, 180.0, 5.0),
)
"""Tunable parameters of a sphere on wheels."""


@dataclass(frozen=True, slots=True)
class RobotKind:
    """Description class of a robot kind, and references to its implementations."""

    name: str
    """Value of `kind` in the table `[drive]` of a description."""
    description: type[RobotDescription]
    simulations: Mapping[str, str]
    """Maps a plant name to its simulation factory, with arguments as in `simulate`. Empty for kinds
    without simulation, which have no shipped robots."""
    sensor_odometry: str
    """Factory of the odometry from other sensors: `(robot) -> (odometry, is_better)` or None."""
    model: str
    """Module with `draw`, `tree` and `masses_kg`."""
    telemetry: str
    """Class for the actuator telemetry on the dashboard."""
    actuator_tab: str
    """Label of the panel tab that shows the actuators."""
    knobs: tuple[Knob, ...]
    """Description numbers offered in the Student tab."""
    student_wheels: str
    """Wheels at a twist, for the Student tab: `(robot, twist) -> list[StudentWheel]`."""


KINDS: tuple[RobotKind, ...] = (
    RobotKind(
        name="singularity",
        description=SingularityDescription,
        simulations={
            "kinematic": "tsd_twin.simulation.robot:simulate_singularity",
            "mujoco": "tsd_twin.simulation.robot:simulate_singularity_mujoco",
        },
        sensor_odometry="tsd_twin.estimation.sensor_odometry:odometry_by_gyro",
        model="tsd_twin.models.singularity",
        telemetry="tsd_twin.dashboard.server.telemetry:GimbalTelemetry",
        actuator_tab="Gimbals",
        knobs=SINGULARITY_KNOBS,
        student_wheels="tsd_twin.dashboard.server.student:gimbal_wheels",
    ),
    RobotKind(
        name="omni",
        description=OmniDescription,
        simulations={"kinematic": "tsd_twin.simulation.robot:simulate_omni"},
        sensor_odometry="tsd_twin.estimation.sensor_odometry:odometry_of_platform",
        model="tsd_twin.models.omni",
        telemetry="tsd_twin.dashboard.server.telemetry:WheelTelemetry",
        actuator_tab="Wheels",
        knobs=OMNI_KNOBS,
        student_wheels="tsd_twin.dashboard.server.student:roller_wheels",
    ),
    RobotKind(
        name="sphere",
        description=SphereDescription,
        simulations={"kinematic": "tsd_twin.simulation.wheeled:SphereSimulation"},
        sensor_odometry="tsd_twin.estimation.sensor_odometry:odometry_by_rows",
        model="tsd_twin.models.sphere",
        telemetry="tsd_twin.dashboard.server.telemetry:SphereTelemetry",
        actuator_tab="Sphere",
        knobs=SPHERE_KNOBS,
        student_wheels="tsd_twin.dashboard.server.student:sphere_wheels",
    ),
    RobotKind(
        name="imported",
        description=ImportedDescription,
        simulations={},
        sensor_odometry="tsd_twin.estimation.sensor_odometry:odometry_of_another",
        model="tsd_twin.models.imported",
        telemetry="tsd_twin.dashboard.server.telemetry:TwistTelemetry",
        actuator_tab="ROS",
        knobs=(),
        student_wheels="tsd_twin.dashboard.server.student:no_wheels",
    ),
)
"""All kinds of robots; add a row for a new kind."""
DESCRIPTIONS: dict[str, type[RobotDescription]] = {kind.name: kind.description for kind in KINDS}
"""From `drive.kind` to the description class."""
_BY_DESCRIPTION = {kind.description: kind for kind in KINDS}


def kind_of(robot: RobotDescription) -> RobotKind:
    """Return the kind of a robot."""
    return _BY_DESCRIPTION[type(robot)]


def implementation(reference: str) -> Any:
    """Import and return the object of a reference `module` or `module:name`."""
    module, _, name = reference.partition(":")
    return getattr(import_module(module), name) if name else import_module(module)
