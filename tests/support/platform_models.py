"""Platforms on wheels with rollers, spheres, and where the rollers of a drawn wheel lie."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np
from manifold3d import Manifold

from tests.support.robot_solids import solid
from tsd_twin.lie import Array
from tsd_twin.models.solids import Part
from tsd_twin.robots import OmniDescription, SphereDescription, load_robot
from tsd_twin.robots.omni import OmniGeometry, OmniWheel, SphereGeometry, SphereWheel


def omni(name: str) -> OmniDescription:
    robot = load_robot(name)
    assert isinstance(robot, OmniDescription)
    return robot


def sphere(name: str) -> SphereDescription:
    robot = load_robot(name)
    assert isinstance(robot, SphereDescription)
    return robot


def ring(count: int, reach_m: float, radius_m: float, roller_deg: float = 0.0) -> OmniDescription:
    """Return a platform on wheels in a circle, which drive along it."""
    wheels = [
        OmniWheel(
            reach_m * math.cos(2.0 * math.pi * i / count),
            reach_m * math.sin(2.0 * math.pi * i / count),
            360.0 * i / count - 90.0,
            roller_deg,
        )
        for i in range(count)
    ]
    base = omni("kiwi")
    return msgspec.structs.replace(
        base,
        drive=OmniGeometry(wheel_radius_m=radius_m, wheels=wheels),
        mass=msgspec.structs.replace(base.mass, total_kg=1.0 * count),
    )


def mounted(below_equator_deg: float, turns_deg: Sequence[float]) -> SphereDescription:
    """Return a sphere on wheels in another mounting."""
    base = sphere("atlas")
    count = len(turns_deg)
    wheels = [
        SphereWheel(360.0 * i / count + 17.0, below_equator_deg, turn)
        for i, turn in enumerate(turns_deg)
    ]
    geometry: SphereGeometry = msgspec.structs.replace(base.drive, wheels=wheels)
    return msgspec.structs.replace(base, drive=geometry)


PLATFORMS = {
    "omni4": omni("omni4"),
    "kiwi": omni("kiwi"),
    "mecanum": omni("mecanum"),
    "six wheels": ring(6, 0.4, 0.06),
    "slanting": ring(4, 0.25, 0.05, 30.0),
}
SPHERES = {
    "atlas": sphere("atlas"),
    "orthogonal": mounted(math.degrees(math.asin(math.sqrt(1.0 / 3.0))), [0.0, 0.0, 0.0]),
    "four wheels": mounted(35.0, [0.0, 20.0, 0.0, 20.0]),
}


def pieces(parts: Sequence[Part], name: str) -> list[Manifold]:
    """Return the solids that a part consists of, in millimetres."""
    (part,) = (part for part in parts if part.name == name)
    return list(solid([part]).decompose())


def lowest_roller_axis(parts: Sequence[Part]) -> Array:
    """Return the unit vector (3,) along the roller at the contact, by the shape of it alone."""
    rollers = pieces(parts, "rollers")
    roller = min(rollers, key=lambda piece: float(np.mean(_corners(piece)[:, 2])))
    corners = _corners(roller)
    _, _, axes = np.linalg.svd(corners - corners.mean(axis=0))
    return axes[0]


def _corners(piece: Manifold) -> Array:
    return np.asarray(piece.to_mesh().vert_properties, np.float64)[:, :3]
