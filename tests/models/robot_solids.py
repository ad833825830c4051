"""Robots of many shapes, and their parts as solids that can be posed and intersected."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import msgspec
import numpy as np
from manifold3d import Manifold, Mesh, OpType

from tsd_twin.models.solids import Part
from tsd_twin.robots import RobotDescription, load_robot


def variant(azimuths_deg: Sequence[float], pivot_m: float, wheel_m: float) -> RobotDescription:
    """Return the shipped robot with another geometry, heavy enough for its modules."""
    tsd = load_robot("tsd")
    count = len(azimuths_deg)
    return msgspec.structs.replace(
        tsd,
        drive=msgspec.structs.replace(
            tsd.drive,
            azimuths_deg=list(azimuths_deg),
            pivot_radius_m=pivot_m,
            wheel_radius_m=wheel_m,
        ),
        motor=msgspec.structs.replace(tsd.motor, speed_rpm=[tsd.motor.speed_rpm[0]] * count),
        mass=msgspec.structs.replace(tsd.mass, total_kg=1.0 * count),
    )


def spaced(count: int) -> list[float]:
    """Return evenly spaced azimuths."""
    return [90.0 + 360.0 * i / count for i in range(count)]


VARIANTS = {
    "two modules": variant(spaced(2), 0.15, 0.04),
    "four modules": variant(spaced(4), 0.15, 0.04),
    "six modules": variant(spaced(6), 0.25, 0.04),
    "uneven": variant([10.0, 70.0, 200.0], 0.2, 0.04),
    "small wheels": variant(spaced(3), 0.1, 0.02),
    "large wheels": variant(spaced(3), 0.3, 0.1),
    "far out": variant(spaced(3), 0.6, 0.05),
}
"""Geometries that a description may well have."""


def solid(parts: Iterable[Part]) -> Manifold:
    """Return parts as one solid, in millimetres."""
    meshes = [
        Mesh(
            np.asarray(1e3 * part.mesh.vertices, np.float32), np.asarray(part.mesh.faces, np.uint32)
        )
        for part in parts
    ]
    return Manifold.batch_boolean([Manifold(mesh) for mesh in meshes], OpType.Add)
