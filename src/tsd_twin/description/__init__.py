"""Robots as shapes: meshes and URDF, generated from the description."""

from tsd_twin.description.files import parts, read, shipped, write
from tsd_twin.description.glb import glb
from tsd_twin.description.look import Parts, draw
from tsd_twin.description.part import LINKS, Link, Material, Part
from tsd_twin.description.urdf import urdf

__all__ = [
    "LINKS",
    "Link",
    "Material",
    "Part",
    "Parts",
    "draw",
    "glb",
    "parts",
    "read",
    "shipped",
    "urdf",
    "write",
]
