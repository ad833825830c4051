"""From the kind of a robot to its simulation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tsd_twin.errors import RobotFileError
from tsd_twin.robots import OmniRobot, Robot, SingularityRobot, SphereRobot
from tsd_twin.sim.contact import ContactSimulation
from tsd_twin.sim.gyro import GyroSimulation
from tsd_twin.sim.late import Actuated, LateSimulation
from tsd_twin.sim.omni import OmniSimulation
from tsd_twin.sim.simulation import Simulation
from tsd_twin.sim.singularity import SingularitySimulation
from tsd_twin.sim.sphere import SphereSimulation


def _singularity(plant: Callable[..., Actuated]) -> Callable[..., Simulation]:
    """Return the simulation of a robot that `plant` moves: behind its bus, and with its gyro."""

    def make(
        robot: SingularityRobot,
        batch: tuple[int, ...],
        *,
        seed: int | None,
        noise: float,
        **start: Any,
    ) -> Simulation:
        moved = plant(robot, batch, seed=seed, noise=noise, **start)
        heard = LateSimulation(moved, robot.delay_s) if robot.delay_s > 0.0 else moved
        if robot.gyro is None:
            return heard
        return GyroSimulation(heard, robot.gyro, batch, seed=seed, noise=noise)

    return make


SIMULATIONS: dict[type[Robot], Callable[..., Simulation]] = {
    SingularityRobot: _singularity(SingularitySimulation),
    OmniRobot: OmniSimulation,
    SphereRobot: SphereSimulation,
}
"""One for each kind of robot in `KINDS`; all take the same arguments, as `simulate` has them."""
PLANTS: dict[str, dict[type[Robot], Callable[..., Simulation]]] = {
    "kinematic": SIMULATIONS,
    "mujoco": {SingularityRobot: _singularity(ContactSimulation)},
}
"""What can move a robot: equations of rolling, for all; solid bodies on a floor, for some."""


def simulate(
    robot: Robot,
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
    is where they start, of the drive's space. `plant` is one of `PLANTS`. `errors` scales what is
    wrong with a built machine by its description, where it says so: 0 is nothing.

    Raises:
        RobotFileError: there is no such plant for robots of this kind.
        MissingExtraError: the package that it needs is not installed.
    """
    make = PLANTS[plant].get(type(robot))
    if make is None:
        kinds = ", ".join(sorted(kind.__name__ for kind in PLANTS[plant]))
        raise RobotFileError(robot.name, f"the plant `{plant}` cannot move it", f"only {kinds}")
    built = robot.with_errors(errors)
    return make(built, batch, seed=seed, noise=noise, battery_v=battery_v, pose=pose)
