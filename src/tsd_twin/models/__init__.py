"""Models of robots, generated from their descriptions: meshes, kinematic tree, URDF.

URDF of shipped robots are files; everything that draws needs the packages of the extra `models`.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from tsd_twin.models.files import (
    glb,
    load_parts,
    read_model,
    robot_urdf,
    shipped_model,
    urdf,
    write_model,
)
from tsd_twin.models.kinds import (
    RobotModel,
    check_room,
    draw_parts,
    kinematic_tree,
    masses_kg,
)
from tsd_twin.models.links import (
    BASE,
    JointType,
    KinematicTree,
    LinkGroup,
)

if TYPE_CHECKING:
    from tsd_twin.models.solids import Link, Material, Part, Parts

__all__ = [
    "BASE",
    "JointType",
    "KinematicTree",
    "Link",
    "LinkGroup",
    "Material",
    "Part",
    "Parts",
    "RobotModel",
    "check_room",
    "draw_parts",
    "glb",
    "kinematic_tree",
    "load_parts",
    "masses_kg",
    "read_model",
    "robot_urdf",
    "shipped_model",
    "urdf",
    "write_model",
]


def __getattr__(name: str) -> Any:
    if name not in ("Link", "Material", "Part", "Parts"):
        raise AttributeError(f"module 'tsd_twin.models' has no attribute '{name}'")
    return getattr(importlib.import_module("tsd_twin.models.solids"), name)
