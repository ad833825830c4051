"""Robots as shapes: meshes and URDF, generated from the description."""

from tsd_twin.description.files import parts, read, shipped, write
from tsd_twin.description.glb import glb
from tsd_twin.description.look import draw, tree
from tsd_twin.description.part import Link, Material, Part, Parts
from tsd_twin.description.tree import BASE, Hinge, Limbs, Tree
from tsd_twin.description.urdf import urdf

__all__ = [
    "BASE",
    "Hinge",
    "Limbs",
    "Link",
    "Material",
    "Part",
    "Parts",
    "Tree",
    "draw",
    "glb",
    "parts",
    "read",
    "shipped",
    "tree",
    "urdf",
    "write",
]
