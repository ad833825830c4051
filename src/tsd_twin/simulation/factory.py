"""Factory of simulations: from the kind of a robot and the name of a plant to its simulation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tsd_twin.errors import RobotFileError
from tsd_twin.robots import KINDS, RobotDescription, SingularityDescription, implementation, kind_of
from tsd_twin.simulation.mujoco_plant import MujocoSimulation
from tsd_twin.simulation.sensors import GyroSimulation
from tsd_twin.simulation.singularity import SingularitySimulation
from tsd_twin.simulation.wrappers import Actuated, DelayWrapper, Simulation


def _singularity(plant: Callable[..., Actuated]) -> Callable[..., Simulation]:
    """Return the simulation of a robot that `plant` moves: behind its bus, and with its gyro."""

    def make(
        robot: SingularityDescription,
        batch: tuple[int, ...],
        *,
        seed: int | None,
        noise: float,
        **start: Any,
    ) -> Simulation:
        moved = plant(robot, batch, seed=seed, noise=noise, **start)
        heard = DelayWrapper(moved, robot.delay_s) if robot.delay_s > 0.0 else moved
        if robot.gyro is None:
            return heard
        return GyroSimulation(heard, robot.gyro, batch, seed=seed, noise=noise)

    return make


simulate_singularity = _singularity(SingularitySimulation)
"""Factory of the kinematic simulation of a singularity drive."""
simulate_singularity_mujoco = _singularity(MujocoSimulation)
"""Factory of the MuJoCo simulation of a singularity drive."""
PLANTS: tuple[str, ...] = tuple(dict.fromkeys(p for kind in KINDS for p in kind.simulations))
"""Models of motion: `kinematic` is rolling for all kinds, `mujoco` rigid bodies for some."""


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
) -> Simulation:
    """Return `batch` robots of one description, all at the same virtual time; `()` is a single one.

    `noise` scales the standard deviations of the description: 0 is none, 1 is as described. `pose`
    is the start pose, of the pose type of the kinematics. `plant` is one of `PLANTS`. `errors`
    scales what is
    wrong with a built machine by its description, where it says so: 0 is nothing.

    Raises:
        RobotFileError: there is no such plant for robots of this kind.
        MissingExtraError: the package that it needs is not installed.
    """
    reference = kind_of(robot).simulations.get(plant)
    if reference is None:
        kinds = ", ".join(kind.name for kind in KINDS if plant in kind.simulations)
        raise RobotFileError(robot.name, f"the plant `{plant}` cannot move it", f"only {kinds}")
    make: Callable[..., Simulation] = implementation(reference)
    built = robot.with_errors(errors)
    return make(built, batch, seed=seed, noise=noise, battery_v=battery_v, pose=pose)
