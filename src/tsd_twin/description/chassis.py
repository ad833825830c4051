"""The chassis: decks, ribs, the servos that turn the outer frames, and the equipment.

Millimetres in `base_link`.
"""

from __future__ import annotations

from manifold3d import Manifold

from tsd_twin.description import equipment, paint, servo
from tsd_twin.description.decks import Decks
from tsd_twin.description.layout import RIB_IN, RIB_OUT, Layout
from tsd_twin.description.part import Drawing
from tsd_twin.description.ribs import ribs
from tsd_twin.description.solids import slab, tube, union
from tsd_twin.robots.robot import Body


def drawings(layout: Layout, body: Body) -> list[Drawing]:
    """Return the chassis and all that is fixed to it."""
    decks = Decks.of(layout)
    standing = ribs(layout, decks)
    lower, upper = decks.lower, decks.upper
    for rib in standing:
        lower -= rib.slots(layout, rib.low)
        upper -= rib.slots(layout, rib.high)
    floor, roof = (layout.floor, layout.deck), (layout.roof, layout.top)
    sheet = paint.acrylic(body)
    return [
        Drawing("decks", union([slab(lower, floor), slab(upper, roof)]), sheet),
        Drawing("ribs", union(rib.solid(layout) for rib in standing), sheet),
        Drawing("bearings", _at_modules(layout, _bearing(layout)), paint.STEEL),
        Drawing("servos", _servos(layout, servo.case(layout.servo)), paint.BLACK),
        Drawing("fittings", _servos(layout, servo.fittings(layout.servo)), paint.STEEL),
        *equipment.drawings(layout, decks, body),
    ]


def _at_modules(layout: Layout, solid: Manifold) -> Manifold:
    """Return a `solid` drawn in a module frame, at every module."""
    return union(layout.in_base(solid, azimuth) for azimuth in layout.azimuths_deg)


def _servos(layout: Layout, solid: Manifold) -> Manifold:
    """Return a drawing of a servo behind every inboard rib, shaft outward, its long end at -X."""
    turned = solid.rotate((0.0, 0.0, 90.0)).rotate((-90.0, 0.0, 0.0))
    front = -RIB_IN * layout.scale - layout.plate
    return _at_modules(layout, turned.translate((0.0, front, 0.0)))


def _bearing(layout: Layout) -> Manifold:
    """Return the bearing in the outboard rib of a module."""
    m = layout.scale
    along = (RIB_OUT * m - 0.6, RIB_OUT * m + layout.plate + 0.6)
    return tube(4.3 * m, 8.0 * m, along, "y")
