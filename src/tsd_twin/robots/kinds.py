"""Registry of the kinds of robots: one table of the implementations in every layer.

The implementations are in higher layers. The registry names them as `module:name` and imports them
at first use, so layers stay apart and a program loads only what it needs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from tsd_twin.robots.description import RobotDescription
from tsd_twin.robots.knobs import OMNI_KNOBS, SINGULARITY_KNOBS, SPHERE_KNOBS, Knob
from tsd_twin.robots.omni import OmniDescription
from tsd_twin.robots.singularity import SingularityDescription
from tsd_twin.robots.sphere import SphereDescription


@dataclass(frozen=True, slots=True)
class RobotKind:
    """Implementations of one kind of robot: its description class, and references to the rest."""

    name: str
    """Value of `kind` in the table `[drive]` of a description."""
    description: type[RobotDescription]
    simulations: Mapping[str, str]
    """From the name of a plant to the factory of its simulation; arguments as in `simulate`."""
    sensor_odometry: str
    """Factory of the odometry from other sensors: `(robot) -> (odometry, is_better)` or None."""
    model: str
    """Module with `draw`, `tree` and `masses_kg`."""
    telemetry: str
    """Class of the telemetry of its actuators on the dashboard."""
    actuator_tab: str
    """Label of the panel tab that shows its actuators."""
    knobs: tuple[Knob, ...]
    """Numbers of its description that the Student tab offers."""
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
        simulations={"kinematic": "tsd_twin.simulation.wheeled:OmniSimulation"},
        sensor_odometry="tsd_twin.estimation.sensor_odometry:odometry_by_dead_wheels",
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
)
"""All kinds of robots; a new kind is a new row."""
DESCRIPTIONS: dict[str, type[RobotDescription]] = {kind.name: kind.description for kind in KINDS}
"""From `drive.kind` to the description class."""
_BY_DESCRIPTION = {kind.description: kind for kind in KINDS}


def kind_of(robot: RobotDescription) -> RobotKind:
    """Kind of a robot."""
    return _BY_DESCRIPTION[type(robot)]


def implementation(reference: str) -> Any:
    """Import and return the object of a reference `module` or `module:name`."""
    module, _, name = reference.partition(":")
    return getattr(import_module(module), name) if name else import_module(module)
