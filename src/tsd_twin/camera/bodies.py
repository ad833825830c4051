"""Bodies of robots for the simulated camera: the convex parts of their models."""

from __future__ import annotations

from typing import Any

import numpy as np

from tsd_twin.camera.render import Solid, cylinder
from tsd_twin.errors import MeshError, MissingExtraError, RobotFileError
from tsd_twin.lie import SO3, Array
from tsd_twin.models import kinematic_tree, load_parts
from tsd_twin.models.links import KinematicTree
from tsd_twin.robots import RobotDescription

_VERTICES = 40
"""Most vertices of a part; outlines of round parts have as many."""
FALLBACK_RADIUS_M, FALLBACK_HEIGHT_M = 0.2, 0.2
_LUMA = np.array([0.299, 0.587, 0.114])
"""Weights of red, green and blue in brightness, ITU-R BT.601."""
_SMALLEST_M = 0.012
"""Parts below it are not drawn: less than 7 px at 2.5 m."""


def robot_solids(robot: RobotDescription) -> list[Solid]:
    """Return the parts of a robot at joint zero, in the frame below it on the floor, bottom first.

    A robot without a model is a cylinder.
    """
    try:
        tree, parts = kinematic_tree(robot), load_parts(robot)
    except (MissingExtraError, MeshError, RobotFileError):
        return [cylinder(FALLBACK_RADIUS_M, FALLBACK_HEIGHT_M)]
    places = _link_places(tree)
    solids: list[Solid] = []
    for kind, drawn in parts.items():
        for part in drawn:
            brightness = round(255.0 * float(_LUMA @ np.array(part.material.rgba[:3])))
            mesh: Any = part.mesh
            for piece in mesh.split(only_watertight=False):
                if float(np.max(piece.extents)) < _SMALLEST_M:
                    continue
                vertices = _fewer(np.asarray(piece.vertices, float))
                solids += [
                    Solid(turn.rotate(vertices) + at, brightness) for turn, at in places[kind]
                ]
    return sorted(solids, key=lambda solid: float(solid.vertices_m[:, 2].max()))


def height_m(solids: list[Solid]) -> float:
    """Return the height of the highest part."""
    return max((float(solid.vertices_m[:, 2].max()) for solid in solids), default=0.0)


def _link_places(tree: KinematicTree) -> dict[str, list[tuple[SO3, Array]]]:
    """Return rotation and position of each link above the floor, by kind."""
    places: dict[str, list[tuple[SO3, Array]]] = {
        "chassis": [(SO3.identity(), np.array([0.0, 0.0, tree.height_m]))]
    }
    for group in tree.link_groups:
        above = places[group.parent]
        places[group.kind] = [
            (turn @ SO3(group.turn.wxyz[i]), turn.rotate(group.at_m[i]) + at)
            for i in range(group.count)
            for turn, at in [above[i if len(above) > 1 else 0]]
        ]
    return places


def _fewer(vertices: Array) -> Array:
    """Return the vertices of a solid that are farthest in many directions."""
    if len(vertices) <= _VERTICES:
        return vertices
    turn = np.linspace(0.0, 2.0 * np.pi, _VERTICES // 2, endpoint=False)
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    # Upward and downward slopes keep both rims of a disc.
    ways = np.concatenate([np.column_stack([ring, np.full(len(ring), z)]) for z in (1.0, -1.0)])
    return vertices[np.unique(np.argmax(vertices @ ways.T, axis=0))]
