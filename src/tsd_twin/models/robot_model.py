"""Model of a robot of any kind: its parts, its kinematic tree and the masses of its links."""

from __future__ import annotations

from typing import Any

from tsd_twin.models.links import KinematicTree
from tsd_twin.models.solids import Link, Parts
from tsd_twin.robots import RobotDescription, implementation, kind_of


def _model(robot: RobotDescription) -> Any:
    """Return the module with the model of this kind of robot."""
    return implementation(kind_of(robot).model)


def draw_parts(robot: RobotDescription) -> Parts:
    """Return the parts of each kind of link, in the frame of the link, drawn to the description.

    Raises:
        RobotFileError: there is no room for what the drive needs.
        MeshError: a drawing does not make a closed solid; a bug.
    """
    return _model(robot).draw(robot)


def kinematic_tree(robot: RobotDescription) -> KinematicTree:
    """Return how the links of a robot hang on one another."""
    return _model(robot).tree(robot)


def masses_kg(robot: RobotDescription) -> dict[Link, float]:
    """Return the mass of each kind of link; the chassis weighs what the others leave.

    Raises:
        RobotFileError: they leave nothing.
    """
    return _model(robot).masses_kg(robot)
