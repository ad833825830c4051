"""Models of robots, generated from their descriptions: meshes, kinematic tree, URDF.

URDF of shipped robots are files; everything that draws needs the packages of the extra `models`.
Parts and materials are in `solids`, which imports them.
"""

from __future__ import annotations

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
    Link,
    LinkGroup,
)

__all__ = [
    "BASE",
    "JointType",
    "KinematicTree",
    "Link",
    "LinkGroup",
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
