"""Factory of simulations by kind of robot and plant."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

from tsd_twin.errors import RobotFileError
from tsd_twin.registry import KindTable
from tsd_twin.robots import (
    ExternalDescription,
    OmniDescription,
    RobotDescription,
    SingularityDescription,
    SphereDescription,
    kind_of,
)
from tsd_twin.sensors.dead_wheels import DEAD_WHEELS
from tsd_twin.simulation.base import Simulation
from tsd_twin.simulation.mujoco_plant import MujocoSimulation
from tsd_twin.simulation.singularity import SingularitySimulation
from tsd_twin.simulation.wheeled import GearedSimulation, OmniSimulation, SphereSimulation
from tsd_twin.simulation.wrappers import DelayWrapper, SensedSimulation

_Factory: TypeAlias = Callable[..., Simulation]
_NONE: Mapping[str, _Factory] = {}
_SIMULATIONS = KindTable[Mapping[str, _Factory]](
    {
        SingularityDescription: {"kinematic": SingularitySimulation, "mujoco": MujocoSimulation},
        OmniDescription: {"kinematic": OmniSimulation},
        SphereDescription: {"kinematic": SphereSimulation},
        ExternalDescription: _NONE,
    },
    lambda kind: kind.plants,
    _NONE,
)
PLANTS: tuple[str, ...] = tuple(dict.fromkeys(p for f in _SIMULATIONS.shipped.values() for p in f))
"""Motion models: `kinematic` (rolling) for all kinds, `mujoco` (rigid bodies) for some."""


def plants_of(robot: RobotDescription) -> tuple[str, ...]:
    """Return the names of the plants that support a robot; empty if it is not simulated."""
    return tuple(_SIMULATIONS.of(robot))


def simulate(
    robot: RobotDescription,
    batch: tuple[int, ...] = (),
    *,
    seed: int | None = 0,
    noise: float = 0.0,
    battery_v: float | None = None,
    pose: Any = None,
    plant: str = "kinematic",
    errors: float = 0.0,
    step_s: float | None = None,
) -> Simulation:
    """Return `batch` simulated robots in lockstep virtual time; `()` is a single robot.

    Args:
        robot: Description of the robots.
        batch: Batch dimensions.
        pose: Initial pose (the kinematics' pose type).
        seed: Random seed.
        noise: Factor on the described standard deviations.
        battery_v: Battery voltage.
        plant: One of `PLANTS`.
        errors: Factor on the described model errors, such as gimbal zeros.
        step_s: Maximum integration step of robots with geared motors, to override the default.

    Raises:
        RobotFileError: If robots of this kind do not support the plant.
        MissingExtraError: If a required package is not installed.
    """
    make = _SIMULATIONS.of(robot).get(plant)
    if make is None:
        shipped = _SIMULATIONS.shipped.items()
        kinds = ", ".join(kind_of(cls) for cls, factories in shipped if plant in factories)
        raise RobotFileError(robot.name, f"the plant `{plant}` cannot move it", f"only {kinds}")
    built = robot.with_errors(errors)
    made = make(built, batch, seed=seed, noise=noise, battery_v=battery_v, pose=pose)
    if step_s is not None and isinstance(made, GearedSimulation):
        made.longest_step_s = step_s
    if type(built) not in _SIMULATIONS.shipped:
        return made  # The package of this kind simulates delay and sensors.
    return _with_delay_and_sensors(made, built, batch, seed, noise)


def _with_delay_and_sensors(
    simulation: Simulation,
    robot: RobotDescription,
    batch: tuple[int, ...],
    seed: int | None,
    noise: float,
) -> Simulation:
    if isinstance(simulation, SingularitySimulation | MujocoSimulation) and robot.delay_s > 0.0:
        simulation = DelayWrapper(simulation, robot.delay_s)
    # The omni plant turns its dead wheels by the mean twist of a step; an added sensor only gets
    # the twist at its end.
    own = [each for each in robot.own_sensors if each[0] is not DEAD_WHEELS]
    sensors = (*own, *robot.mounted_sensors)
    if not sensors:
        return simulation
    return SensedSimulation(simulation, sensors, batch, seed=seed, noise=noise)
