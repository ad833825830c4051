"""Model of robots whose kind has no model: a box with an arrow that points forward."""

from __future__ import annotations

from tsd_twin.models import solids
from tsd_twin.models.links import KinematicTree, Link
from tsd_twin.models.solids import Drawing, Parts, drawn, polygon, slab
from tsd_twin.robots import RobotDescription

_LENGTH, _WIDTH, _HEIGHT = 300.0, 220.0, 120.0
"""Size of the box in millimetres; descriptions do not contain the size of the robot."""
_ONE_KG = 1.0


def draw(robot: RobotDescription) -> Parts:
    """Draw the parts of the chassis, which is the only link."""
    x, y = 0.5 * _LENGTH, 0.5 * _WIDTH
    case = solids.box((-x, x), (-y, y), (0.0, _HEIGHT))
    arrow = slab(polygon([(-0.4 * x, -0.5 * y), (0.8 * x, 0.0), (-0.4 * x, 0.5 * y)]), (0.0, 2.0))
    drawings = [
        Drawing("case", case, solids.frame_material(robot.body)),
        Drawing("arrow", arrow.translate((0.0, 0.0, _HEIGHT)), solids.front_material(robot.body)),
    ]
    return {"chassis": drawn("chassis", drawings)}


def tree(_robot: RobotDescription) -> KinematicTree:
    """Return a chassis on the floor, without links."""
    return KinematicTree(0.0, (), core_m=0.0)


def masses_kg(_robot: RobotDescription) -> dict[Link, float]:
    """Return a nominal mass for the chassis, because the mass is unknown."""
    return {"chassis": _ONE_KG}
