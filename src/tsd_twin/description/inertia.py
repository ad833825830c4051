"""Mass, centre and inertia of a link, from its parts."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsd_twin.description.part import Part
from tsd_twin.lie import Array


@dataclass(frozen=True, slots=True, eq=False)
class Inertia:
    """A rigid body, in the frame of its link."""

    mass_kg: float
    centre_m: Array
    """(3,): centre of mass."""
    tensor_kg_m2: Array
    """(3, 3): about the centre of mass, axes as those of the link."""


def inertia(parts: Iterable[Part], mass_kg: float) -> Inertia:
    """Return the inertia of `parts` that are rigidly connected and together weigh `mass_kg`.

    Densities only say how the mass is shared out: parts are solid here that are hollow in truth.
    """
    bodies: list[tuple[float, Array, Array]] = []
    for part in parts:
        mesh: Any = part.mesh
        density = part.density_kg_per_m3
        bodies.append(
            (density * mesh.volume, np.array(mesh.center_mass), density * mesh.moment_inertia)
        )
    total = sum(mass for mass, _, _ in bodies)
    centre = sum((mass * at for mass, at, _ in bodies), start=np.zeros(3)) / total
    tensor = np.zeros((3, 3))
    for mass, at, own in bodies:
        arm = at - centre
        # Parallel axis theorem.
        tensor += own + mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Inertia(mass_kg, centre, tensor * (mass_kg / total))
