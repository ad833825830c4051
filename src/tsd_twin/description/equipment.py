"""What is bolted to the decks: battery, controller board, speed controllers, radio, the arrow.

Millimetres in `base_link`.
"""

from __future__ import annotations

import math

from manifold3d import Manifold

from tsd_twin.description import board, paint
from tsd_twin.description.decks import Decks
from tsd_twin.description.layout import Layout
from tsd_twin.description.part import Drawing
from tsd_twin.description.solids import (
    box,
    circle,
    grown,
    polygon,
    rectangle,
    rod,
    slab,
    union,
    wire,
)
from tsd_twin.robots.robot import Body

_PACK = (138.0, 46.0, 34.0)
"""Length, width and height of the largest battery."""


def drawings(layout: Layout, decks: Decks, body: Body) -> list[Drawing]:
    """Return all equipment."""
    return [
        *_battery(layout),
        *board.drawings(layout.top, decks.middle),
        *_controllers(layout, decks),
        Drawing("radio", _radio(layout, decks), paint.BLACK),
        Drawing("standoffs", _standoffs(layout, decks), paint.STEEL),
        Drawing("arrow", _arrow(layout, decks), paint.front(body)),
    ]


def _battery(layout: Layout) -> list[Drawing]:
    """Return the pack between the servos, as large as fits there, with label, strap and plug."""
    radius = min(layout.core - 1.5, 0.5 * math.hypot(_PACK[0], _PACK[1]))
    shape = math.radians(26.0)
    x, y = radius * math.cos(shape), radius * math.sin(shape)
    low = layout.deck + 0.3
    tall = min(_PACK[2], 0.86 * (layout.roof - layout.deck))
    high = low + tall
    label = rectangle((-0.62 * x, 0.62 * x), (-y - 0.3, y + 0.3)) - rectangle((-x, x), (-y, y))
    across = (-0.14 * x, 0.14 * x)
    strap = box(across, (-y - 1.2, y + 1.2), (low, high + 1.2))
    plug = box((x, x + 0.2 * y), (-0.3 * y, 0.3 * y), (high - 0.4 * y, high - 0.1 * y))
    return [
        Drawing("battery", slab(rectangle((-x, x), (-y, y), 0.12 * y), (low, high)), paint.SHRINK),
        Drawing("label", slab(label, (low + 0.2 * tall, low + 0.8 * tall)), paint.WHITE),
        Drawing("strap", strap - box(across, (-y, y), (low - 1.0, high)), paint.RUBBER),
        Drawing("plug", plug, paint.YELLOW),
    ]


def _controllers(layout: Layout, decks: Decks) -> list[Drawing]:
    """Return a speed controller on each lobe of the upper deck, with its wires."""
    case = rectangle((-13.0, 13.0), (-24.0, 24.0), 3.0)
    ends = [(side * 9.0, -23.0, 5.0) for side in (-1.0, 1.0)]
    pair = [wire([end, (end[0], -31.0, 5.0), (0.8 * end[0], -35.0, -9.0)], 1.4) for end in ends]
    phases = union(
        wire([(x, 23.0, 5.0), (x, 30.0, 5.0), (0.8 * x, 34.0, -9.0)], 1.2) for x in (-7.0, 0.0, 7.0)
    )
    one = {
        "controllers": (union([slab(case, (0.2, 9.0)), pair[0]]), paint.BLACK),
        "labels": (slab(rectangle((-9.0, 9.0), (-14.0, 14.0)), (9.0, 9.3)), paint.WHITE),
        "supply": (pair[1], paint.RED),
        "phases": (phases, paint.BLUE),
    }
    places = _controller_places(layout, decks)
    return [
        Drawing(name, union(_placed(solid, layout, *place) for place in places), material)
        for name, (solid, material) in one.items()
    ]


def _controller_places(layout: Layout, decks: Decks) -> list[tuple[float, float, float]]:
    """Return direction, distance and scale for a controller on each lobe that is large enough."""
    footprint = rectangle((-14.0, 14.0), (-36.0, 36.0))
    places: list[tuple[float, float, float]] = []
    for lobe in layout.lobes_deg:
        x = 0.5 * (0.7 * decks.middle + decks.reach(lobe, 12.0 * layout.scale))
        for fit in (1.0, 0.8, 0.6, 0.45):
            scale = fit * layout.scale
            if decks.carries(footprint.scale([scale, scale]).translate((x, 0.0)).rotate(lobe)):
                places.append((lobe, x, scale))
                break
    return places


def _placed(solid: Manifold, layout: Layout, turn_deg: float, x: float, scale: float) -> Manifold:
    """Return a drawing on the upper deck, at a distance in a direction."""
    out = solid.scale([scale] * 3).translate((x, 0.0, layout.top))
    return out.rotate((0.0, 0.0, turn_deg))


def _radio(layout: Layout, decks: Decks) -> Manifold:
    """Return the receiver with its antenna, at the back of the upper deck."""
    solid = union(
        [
            slab(rectangle((-9.0, 9.0), (-14.0, 14.0), 2.5), (0.2, 11.0)),
            rod(3.2, (10.5, 17.0), at=(-3.0, 8.0, 0.0)),
            rod(2.4, (16.0, 62.0), at=(-3.0, 8.0, 0.0), tip=1.7),
            rod(2.8, (61.0, 66.0), at=(-3.0, 8.0, 0.0), tip=2.2),
        ]
    )
    m = layout.scale
    return solid.scale([m] * 3).translate((14.0 * m - decks.middle, 0.0, layout.top))


def _standoffs(layout: Layout, decks: Decks) -> Manifold:
    """Return the hexagonal spacers near the ends of the lobes, with their screws."""
    m = layout.scale
    spacer = union(
        [
            rod(3.2 * m, (layout.deck, layout.roof), corners=6),
            rod(2.9 * m, (layout.top, layout.top + 2.2 * m), corners=8),
        ]
    )
    ends = [(lobe, decks.reach(lobe, 12.0 * m) - 10.0 * m) for lobe in layout.lobes_deg]
    seats = [(lobe, x, y) for lobe, x in ends for y in (-44.0 * m, 44.0 * m)]
    return union(
        spacer.translate((x, y, 0.0)).rotate((0.0, 0.0, lobe))
        for lobe, x, y in seats
        if decks.carries(circle(5.0 * m, (x, y)).rotate(lobe))
    )


def _arrow(layout: Layout, decks: Decks) -> Manifold:
    """Return the arrow on the upper deck that points forward, along X."""
    m = layout.scale
    shape = polygon([(-40.0, -24.0), (0.0, 0.0), (-40.0, 24.0), (-29.0, 0.0)])
    tip = (decks.middle - 2.0 * m, 0.0, layout.top)
    return slab(grown(shape, -1.0), (0.1, 3.6)).scale([m] * 3).translate(tip)
