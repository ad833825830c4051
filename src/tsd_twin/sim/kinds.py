"""From the kind of a robot to its simulation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tsd_twin.robots import OmniRobot, Robot, SingularityRobot, SphereRobot
from tsd_twin.sim.omni import OmniSimulation
from tsd_twin.sim.simulation import Simulation
from tsd_twin.sim.singularity import SingularitySimulation
from tsd_twin.sim.sphere import SphereSimulation

SIMULATIONS: dict[type[Robot], Callable[..., Simulation]] = {
    SingularityRobot: SingularitySimulation,
    OmniRobot: OmniSimulation,
    SphereRobot: SphereSimulation,
}
"""One for each kind of robot in `KINDS`; all take the same arguments, as `simulate` has them."""


def simulate(
    robot: Robot,
    batch: tuple[int, ...] = (),
    *,
    seed: int | None = 0,
    noise: float = 0.0,
    battery_v: float | None = None,
    pose: Any = None,
) -> Simulation:
    """Return `batch` robots of one description, all at the same virtual time; `()` is a single one.

    `noise` scales the standard deviations of the description: 0 is none, 1 is as described. `pose`
    is where they start, of the drive's space.
    """
    make = SIMULATIONS[type(robot)]
    return make(robot, batch, seed=seed, noise=noise, battery_v=battery_v, pose=pose)
