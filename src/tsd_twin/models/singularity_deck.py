"""Chassis of a singularity drive with pivots at any positions: a deck above the modules.

The chassis of `singularity` requires pivots on a circle. This one fits every layout.
"""

from __future__ import annotations

import math
from statistics import fmean

from manifold3d import CrossSection, Manifold

from tsd_twin.models import equipment, singularity_layout, solids
from tsd_twin.models.singularity_layout import NOMINAL_SERVO, NOMINAL_WHEEL, RIB_IN, RIB_OUT, Layout
from tsd_twin.models.solids import Drawing, circle, rectangle, slab, standing, tube, union
from tsd_twin.robots import SingularityDescription

_RIM = 84.0
"""Radius of the corners of the deck about the pivots; all lengths here are nominal."""
_SWEEP = 88.0
"""Reach of the outer frame with its servo along X of the module."""
_FRAME = 31.0
"""Clearance between the deck and the frame at full tilt."""
_FOOT, _BELOW = 22.0, 14.0
"""Half width of a hanger, and its reach below the gimbal axis."""


def layout_of(robot: SingularityDescription) -> Layout:
    """Return module dimensions and deck height in millimetres; `pivot` is unused."""
    drive = robot.drive
    wheel = 1e3 * drive.wheel_radius_m
    scale = wheel / NOMINAL_WHEEL
    size = [1e3 * side for side in robot.servo.size_m]
    fit = min(scale * most / side for most, side in zip(NOMINAL_SERVO, size, strict=True))
    width, length, depth = (min(1.0, fit) * side for side in size)
    swept = _SWEEP * math.sin(math.radians(drive.max_tilt_deg))
    return Layout(
        azimuths_deg=tuple(drive.directions_deg),
        pivot=0.0,
        wheel=wheel,
        servo=(width, length, depth),
        plate=1e3 * robot.body.plate_thickness_m,
        floor=-wheel,
        roof=(swept + _FRAME) * scale,
    )


def deck_chassis_drawings(robot: SingularityDescription, layout: Layout) -> list[Drawing]:
    """Draw the chassis and everything fixed to it, in `base_link`."""
    m, t, body = layout.scale, layout.plate, robot.body
    pivots = [(1e3 * p.x_m, 1e3 * p.y_m) for p in robot.drive.positions]
    outline = CrossSection.batch_hull([circle(_RIM * m, at) for at in pivots])
    deck = slab(outline, (layout.roof, layout.top))

    def at_modules(solid: Manifold) -> Manifold:
        """Return a solid drawn in a module frame, at every module."""
        return union(
            solid.rotate((0.0, 0.0, azimuth - 90.0)).translate((x, y, 0.0))
            for (x, y), azimuth in zip(pivots, layout.azimuths_deg, strict=True)
        )

    hanger = rectangle((-_FOOT * m, _FOOT * m), (-_BELOW * m, layout.roof + 0.5))
    inboard = standing(hanger - circle(0.3 * layout.servo[0]), (-RIB_IN * m - t, -RIB_IN * m))
    outboard = standing(hanger - circle(8.0 * m), (RIB_OUT * m, RIB_OUT * m + t))
    bearing = tube(4.3 * m, 8.0 * m, (RIB_OUT * m - 0.6, RIB_OUT * m + t + 0.6), "y")
    front = -RIB_IN * m - t
    sheet = solids.acrylic_material(body)
    servo, fittings = (
        solid.rotate((0.0, 0.0, 90.0)).rotate((-90.0, 0.0, 0.0)).translate((0.0, front, 0.0))
        for solid in (
            singularity_layout.servo_case(layout.servo),
            singularity_layout.servo_fittings(layout.servo),
        )
    )
    cx, cy, top = fmean(x for x, _ in pivots), fmean(y for _, y in pivots), layout.top
    battery = solids.box(
        (cx - 50.0 * m, cx + 10.0 * m), (cy - 20.0 * m, cy + 20.0 * m), (top, top + 25.0 * m)
    )
    return [
        Drawing("decks", deck, sheet),
        Drawing("ribs", at_modules(inboard + outboard), sheet),
        Drawing("bearings", at_modules(bearing), solids.STEEL),
        Drawing("servos", at_modules(servo), solids.BLACK),
        Drawing("fittings", at_modules(fittings), solids.STEEL),
        Drawing("battery", battery, solids.BLUE),
        Drawing(
            "arrow",
            equipment.heading_arrow((cx + 60.0 * m, cy, top), m),
            solids.front_material(body),
        ),
    ]
