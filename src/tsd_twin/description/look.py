"""The look of a robot and how it hangs together, whatever its kind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from tsd_twin.description import omni, singularity, sphere
from tsd_twin.description.part import Link, Parts
from tsd_twin.description.tree import Tree
from tsd_twin.robots import OmniRobot, Robot, SingularityRobot, SphereRobot


@dataclass(frozen=True, slots=True)
class Kind:
    """What has to be known of a kind of robot to show it."""

    draw: Callable[[Any], Parts]
    tree: Callable[[Any], Tree]
    masses_kg: Callable[[Any], dict[Link, float]]


KINDS: dict[type[Robot], Kind] = {
    SingularityRobot: Kind(singularity.draw, singularity.tree, singularity.masses_kg),
    OmniRobot: Kind(omni.draw, omni.tree, omni.masses_kg),
    SphereRobot: Kind(sphere.draw, sphere.tree, sphere.masses_kg),
}
"""From the tables of a robot to its kind."""


def draw(robot: Robot) -> Parts:
    """Return the parts of each kind of link, in the frame of the link, drawn to the description.

    Raises:
        RobotFileError: there is no room for what the drive needs.
        MeshError: a drawing does not make a closed solid; a bug.
    """
    return KINDS[type(robot)].draw(robot)


def tree(robot: Robot) -> Tree:
    """Return how the links of a robot hang on one another."""
    return KINDS[type(robot)].tree(robot)


def masses_kg(robot: Robot) -> dict[Link, float]:
    """Return the mass of each kind of link; the chassis weighs what the others leave.

    Raises:
        RobotFileError: they leave nothing.
    """
    return KINDS[type(robot)].masses_kg(robot)
