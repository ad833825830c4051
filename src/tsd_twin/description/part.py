"""A part: one closed solid of one material, in the frame of its link."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import trimesh
from manifold3d import Manifold

from tsd_twin.errors import MeshError

Link: TypeAlias = str
"""A kind of link: `chassis`, `wheel`, ...; links of one kind are alike and share their parts."""
Parts: TypeAlias = dict[Link, tuple["Part", ...]]
"""Parts of each kind of link, once for all links that are alike; the chassis first."""
_GRID_M = 1e-6
"""Vertices are rounded to this, so that the last digits of a processor do not reach the files."""


@dataclass(frozen=True, slots=True)
class Material:
    """How a part looks and what it weighs."""

    rgba: tuple[float, float, float, float]
    """Red, green, blue (sRGB) and opacity, 0 to 1."""
    metallic: float
    roughness: float
    density_kg_per_m3: float


class Drawing(NamedTuple):
    """A solid as it comes from the drawing board."""

    name: str
    solid: Manifold
    """Millimetres, in the frame of its link."""
    material: Material


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """One closed solid, which need not hang together, of one material."""

    name: str
    link: Link
    """What it is fixed to."""
    mesh: trimesh.Trimesh
    """Metres, in the frame of the link; watertight."""
    rgba: tuple[float, float, float, float]
    metallic: float
    roughness: float
    density_kg_per_m3: float

    @classmethod
    def of(cls, name: str, link: Link, mesh: trimesh.Trimesh, material: Material) -> Part:
        """Return the part.

        Raises:
            MeshError: the mesh is empty or not a closed solid.
        """
        if not mesh.is_volume or mesh.volume <= 0.0:
            raise MeshError(f"{link}_{name} is not a closed solid: it has holes or no volume")
        m = material
        return cls(name, link, mesh, m.rgba, m.metallic, m.roughness, m.density_kg_per_m3)

    @classmethod
    def drawn(cls, link: Link, drawing: Drawing) -> Part:
        """Return the part of a drawing.

        Raises:
            MeshError: the drawing does not make a closed solid.
        """
        return cls.of(drawing.name, link, _mesh(drawing.solid), drawing.material)

    @property
    def file(self) -> str:
        """Name of the file that holds the mesh."""
        return f"{self.link}_{self.name}.stl"


def _mesh(solid: Manifold) -> trimesh.Trimesh:
    """Return a drawing in metres, rounded, in an order that depends on nothing but the shape.

    Corners that rounding moves to the same place stay two: sheets that touch are not welded.
    """
    drawn: Any = solid.to_mesh()
    # Adding zero turns minus zero into zero.
    grid = np.round(1e-3 * np.asarray(drawn.vert_properties, np.float64) / _GRID_M) + 0.0
    order = np.lexsort(grid.T[::-1])
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    faces = place[np.asarray(drawn.tri_verts, np.int64)]
    first = np.argmin(faces, axis=1)[:, None]
    faces = np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1)
    return trimesh.Trimesh(grid[order] * _GRID_M, faces[np.lexsort(faces.T[::-1])], process=False)


def drawn(link: Link, drawings: Iterable[Drawing]) -> tuple[Part, ...]:
    """Return the parts of a kind of link, without what there was no room for.

    Raises:
        MeshError: a drawing does not make a closed solid.
    """
    return tuple(Part.drawn(link, one) for one in drawings if not one.solid.is_empty())
