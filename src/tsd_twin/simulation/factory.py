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
from tsd_twin.simulation.delay import Actuated, DelayWrapper
from tsd_twin.simulation.mujoco_plant import MujocoSimulation
from tsd_twin.simulation.sensed import SensedSimulation
from tsd_twin.simulation.singularity import SingularitySimulation
from tsd_twin.simulation.wheeled import GearedSimulation, OmniSimulation, SphereSimulation

_Factory: TypeAlias = Callable[..., Simulation]


def _behind_bus(plant: Callable[..., Actuated]) -> _Factory:
    """Return a factory for robots moved by `plant`, behind a bus with delay."""

    def make(robot: RobotDescription, batch: tuple[int, ...], **options: Any) -> Simulation:
        simulation = plant(robot, batch, **options)
        return DelayWrapper(simulation, robot.delay_s) if robot.delay_s > 0.0 else simulation

    return make


def _sensed(make: _Factory, *, simulates_own: bool = False) -> _Factory:
    """Return a factory that adds the sensors of the robot.

    `simulates_own` is for a plant that has dead wheels: it turns them by the mean twist of a step,
    while an added sensor only gets the twist at its end.
    """

    def add(
        robot: RobotDescription,
        batch: tuple[int, ...],
        *,
        seed: int | None,
        noise: float,
        **options: Any,
    ) -> Simulation:
        simulation = make(robot, batch, seed=seed, noise=noise, **options)
        own = [s for s in robot.own_sensors if not (simulates_own and s[0] is DEAD_WHEELS)]
        sensors = (*own, *robot.mounted_sensors)
        if not sensors:
            return simulation
        return SensedSimulation(simulation, sensors, batch, seed=seed, noise=noise)

    return add


simulate_singularity = _sensed(_behind_bus(SingularitySimulation))
"""Factory of the kinematic simulation of a singularity drive."""
simulate_singularity_mujoco = _sensed(_behind_bus(MujocoSimulation))
"""Factory of the MuJoCo simulation of a singularity drive."""
simulate_omni = _sensed(OmniSimulation, simulates_own=True)
"""Factory of the simulation of a platform on wheels with rollers."""
_NONE: Mapping[str, _Factory] = {}
_SIMULATIONS = KindTable[Mapping[str, _Factory]](
    {
        SingularityDescription: {
            "kinematic": simulate_singularity,
            "mujoco": simulate_singularity_mujoco,
        },
        OmniDescription: {"kinematic": simulate_omni},
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
    moves = made.simulation if isinstance(made, SensedSimulation) else made
    if step_s is not None and isinstance(moves, GearedSimulation):
        moves.longest_step_s = step_s
    return made
