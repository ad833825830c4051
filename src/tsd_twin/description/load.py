"""What a platform carries on its upper deck: battery, controller board, drivers, radio, the arrow.

Millimetres in `base_link`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from manifold3d import CrossSection, Manifold, OpType

from tsd_twin.description import board, paint
from tsd_twin.description.bay import Bay
from tsd_twin.description.part import Drawing
from tsd_twin.description.solids import (
    box,
    grown,
    polygon,
    rectangle,
    rod,
    slab,
    union,
    wire,
)
from tsd_twin.robots.robot import Body

_PACK = (0.5, 0.98, 0.44)
"""Length, width and height of the battery, in radii of the free middle of the deck."""
_DRIVER = rectangle((-20.0, 20.0), (-28.0, 28.0), 3.0)
"""Footprint of a motor driver; nominal."""


def load_drawings(bay: Bay, body: Body) -> list[Drawing]:
    """Return all that stands on the upper deck."""
    room = bay.middle
    places = list(_driver_places(bay))
    return [
        *_battery(bay, -0.36 * room),
        *board.drawings(bay.top, 0.56 * room, 0.3 * room),
        *_drivers(bay, places),
        Drawing("radio", _radio(bay).translate((-0.36 * room, 0.68 * room, 0.0)), paint.BLACK),
        Drawing("arrow", _arrow(bay), paint.front(body)),
    ]


def _battery(bay: Bay, x: float) -> list[Drawing]:
    """Return the pack with label, strap and plug, across the back of the deck."""
    long, wide, tall = (0.5 * share * bay.middle for share in _PACK)
    low, high = bay.top + 0.3, bay.top + 0.3 + tall
    label = rectangle((-0.62 * long, 0.62 * long), (-wide - 0.3, wide + 0.3))
    label -= rectangle((-2.0 * long, 2.0 * long), (-wide, wide))
    straps = [
        box((-long - 1.2, long + 1.2), (y - 0.09 * wide, y + 0.09 * wide), (low, high + 1.2))
        - box((-long, long), (-wide, wide), (low - 1.0, high))
        for y in (-0.5 * wide, 0.5 * wide)
    ]
    plug = box((-0.3 * long, 0.3 * long), (wide + 0.3, 1.16 * wide), (low + 0.5 * tall, high - 2.0))
    face = slab(rectangle((-0.5 * long, 0.5 * long), (-0.3 * wide, 0.3 * wide)), (high, high + 0.3))
    pack = slab(rectangle((-long, long), (-wide, wide), 0.12 * long), (low, high))
    sides = slab(label, (low + 0.2 * tall, low + 0.8 * tall))
    solids = {
        "battery": (pack, paint.SHRINK),
        "label": (union([sides, face]), paint.WHITE),
        "strap": (union(straps), paint.RUBBER),
        "plug": (plug, paint.YELLOW),
    }
    return [
        Drawing(name, solid.translate((x, 0.0, 0.0)), material)
        for name, (solid, material) in solids.items()
    ]


def _driver_places(bay: Bay) -> Iterator[tuple[float, float, float]]:
    """Yield direction, distance and scale of a motor driver near each wheel, if one fits there."""
    room = bay.middle
    taken = union_of(
        rectangle((-0.66 * room, -0.08 * room), (-0.62 * room, 0.8 * room)),
        rectangle((-0.02 * room, 0.66 * room), (-0.4 * room, 0.4 * room)),
        rectangle((0.7 * room, 1.1 * room), (-0.2 * room, 0.2 * room)),
    )
    for mount in bay.mounts:
        toward = math.degrees(math.atan2(mount.y, mount.x))
        place = next(_free(bay, taken, toward), None)
        if place is not None:
            taken += _footprint(place)
            yield place


def _free(bay: Bay, taken: CrossSection, toward: float) -> Iterator[tuple[float, float, float]]:
    """Yield places for a driver that are wholly on the deck and clear of all else, best first."""
    for fit in (1.0, 0.8, 0.6, 0.45):
        for aside in (0.0, 12.0, -12.0, 25.0, -25.0, 40.0, -40.0, 55.0, -55.0):
            for share in (0.8, 0.72, 0.9, 1.0, 1.1):
                place = (toward + aside, share * bay.middle, fit * bay.scale)
                outline = _footprint(place)
                if (outline - bay.outline).area() < 1e-6 and (outline ^ taken).area() < 1e-6:
                    yield place


def _footprint(place: tuple[float, float, float]) -> CrossSection:
    turn, distance, scale = place
    return _DRIVER.scale((scale, scale)).translate((distance, 0.0)).rotate(turn)


def _drivers(bay: Bay, places: list[tuple[float, float, float]]) -> list[Drawing]:
    """Return the motor drivers: a case with fins, a label, and the wires to its motor."""
    case = slab(rectangle((-18.0, 18.0), (-24.0, 24.0), 3.0), (0.3, 16.0))
    fins = union(box((x, x + 2.0), (-23.0, 23.0), (11.0, 17.0)) for x in (-13.0, -7.0, 5.0, 11.0))
    strip = box((-14.0, 14.0), (-28.0, -23.0), (0.3, 9.0))
    wires = [
        wire([(x, -27.0, 5.0), (x, -31.0, 4.0), (0.6 * x + 18.0, -33.0, -6.0)], 1.5)
        for x in (-9.0, -3.0, 3.0)
    ]
    label = slab(rectangle((-3.5, 3.5), (-14.0, 14.0)), (16.0, 16.3))
    one = {
        "drivers": (union([case - fins, strip]), paint.ANODISED),
        "labels": (label, paint.WHITE),
        "supply": (union(wires[:1]), paint.RED),
        "phases": (union(wires[1:]), paint.BLUE),
    }
    return [
        Drawing(name, union(_placed(bay, solid, place) for place in places), material)
        for name, (solid, material) in one.items()
    ]


def _placed(bay: Bay, solid: Manifold, place: tuple[float, float, float]) -> Manifold:
    turn, distance, scale = place
    out = solid.scale([scale] * 3).translate((distance, 0.0, bay.top))
    return out.rotate((0.0, 0.0, turn))


def _radio(bay: Bay) -> Manifold:
    """Return the receiver with its antenna, at the origin of the upper deck."""
    solid = union(
        [
            slab(rectangle((-14.0, 14.0), (-10.0, 10.0), 2.5), (0.2, 13.0)),
            rod(3.6, (12.5, 19.0), at=(8.0, 2.0, 0.0)),
            rod(2.6, (18.0, 88.0), at=(8.0, 2.0, 0.0), tip=1.9),
            rod(3.2, (87.0, 93.0), at=(8.0, 2.0, 0.0), tip=2.4),
        ]
    )
    return solid.scale([bay.scale] * 3).translate((0.0, 0.0, bay.top))


def _arrow(bay: Bay) -> Manifold:
    """Return the arrow on the upper deck that points forward, along X."""
    m = bay.scale
    shape = polygon([(-40.0, -24.0), (0.0, 0.0), (-40.0, 24.0), (-29.0, 0.0)])
    tip = (bay.reach(0.0) - 8.0 * m, 0.0, bay.top)
    return slab(grown(shape, -1.0), (0.1, 3.6)).scale([m] * 3).translate(tip)


def union_of(*outlines: CrossSection) -> CrossSection:
    """Return outlines as one."""
    return CrossSection.batch_boolean(list(outlines), OpType.Add)
