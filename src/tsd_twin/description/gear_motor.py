"""A motor with gearbox and encoder on one shaft, along Y: what it drives is at positive Y.

Millimetres; the face that the gearbox is bolted on by is at Y = 0.
"""

from __future__ import annotations

from typing import NamedTuple

from manifold3d import Manifold

from tsd_twin.description.solids import around, rectangle, rod, slab, tube, union


class GearMotor(NamedTuple):
    """Solids of one motor."""

    motor: Manifold
    gearbox: Manifold
    encoder: Manifold


def gear_motor(radius: float, length: float) -> GearMotor:
    """Return a motor of a radius whose parts together have a length."""
    gearbox, motor = 0.3 * length, 0.58 * length
    square = 0.92 * radius
    face = rectangle((-square, square), (-square, square), 0.3 * radius)
    bolts = around(
        rod(0.09 * radius, (-0.6, 0.05 * radius), at=(0.72 * radius, 0.72 * radius, 0.0)), 4
    )
    box = slab(face, (-0.35 * gearbox, 0.0)) + rod(0.9 * radius, (-gearbox, -0.3 * gearbox))
    rim = tube(0.84 * radius, 1.2 * radius, (-0.72 * gearbox, -0.64 * gearbox))
    can = rod(radius, (-gearbox - motor, -gearbox))
    fins = union(
        tube(0.94 * radius, 1.1 * radius, (z, z + 0.06 * motor))
        for z in (-gearbox - share * motor for share in (0.34, 0.5, 0.66))
    )
    box_end = slab(
        rectangle((0.55 * radius, 1.06 * radius), (-0.3 * radius, 0.3 * radius), 1.0),
        (-gearbox - motor, -gearbox - 0.8 * motor),
    )
    cap = rod(0.72 * radius, (-length, -gearbox - motor + 0.5)) - rod(
        0.2 * radius, (-length - 1.0, -length + 1.0)
    )
    return GearMotor(
        *(
            solid.rotate((-90.0, 0.0, 0.0))
            for solid in (union([can - fins, box_end]), union([box - rim, bolts]), cap)
        )
    )
