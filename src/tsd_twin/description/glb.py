"""Parts as binary glTF, for renderers: physically based materials, curved surfaces smooth."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import trimesh
from manifold3d import Manifold, Mesh
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from tsd_twin.description.part import Part

_CREASE_DEG = 32.0
"""Edges sharper than this stay sharp: more than a facet of 12 sides has, less than a chamfer."""


def glb(parts: Iterable[Part]) -> bytes:
    """Return one scene with a mesh for each of `parts`, metres, in the frame of their link."""
    scene: Any = trimesh.Scene()
    for part in parts:
        scene.add_geometry(_shaded(part), node_name=part.name, geom_name=part.name)
    return scene.export(file_type="glb", include_normals=True)


def _shaded(part: Part) -> trimesh.Trimesh:
    """Return the mesh with a normal for each corner, vertices split where edges are sharp."""
    solid = Manifold(
        Mesh(
            np.asarray(1e3 * part.mesh.vertices, np.float32), np.asarray(part.mesh.faces, np.uint32)
        )
    )
    drawn: Any = solid.calculate_normals(0, _CREASE_DEG).to_mesh()
    corners = np.asarray(drawn.vert_properties, np.float64)
    r, g, b, opacity = part.rgba
    material = PBRMaterial(
        name=part.name,
        baseColorFactor=[round(255 * c) for c in (*(_linear(c) for c in (r, g, b)), opacity)],
        metallicFactor=part.metallic,
        roughnessFactor=part.roughness,
        alphaMode="BLEND" if opacity < 1.0 else "OPAQUE",
    )
    return trimesh.Trimesh(
        1e-3 * corners[:, :3],
        np.asarray(drawn.tri_verts),
        vertex_normals=corners[:, 3:6],
        visual=TextureVisuals(material=material),
        process=False,
    )


def _linear(srgb: float) -> float:
    """Return a colour channel as glTF wants it; IEC 61966-2-1."""
    return srgb / 12.92 if srgb <= 0.04045 else ((srgb + 0.055) / 1.055) ** 2.4
