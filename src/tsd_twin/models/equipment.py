"""Equipment on the upper deck: battery, controller board, motor drivers, radio, heading arrow.

The controller board is drawn after an Arduino Mega 2560.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from manifold3d import CrossSection, Manifold, OpType

from tsd_twin.models import solids
from tsd_twin.models.platform_layout import PlatformLayout
from tsd_twin.models.singularity_layout import Decks, Layout
from tsd_twin.models.solids import (
    Drawing,
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
from tsd_twin.robots.description import Body

_LENGTH, _WIDTH, _THICKNESS = 101.6, 53.3, 1.6
_HOLES = [(14.0, 2.6), (15.3, 50.6), (66.0, 7.6), (66.0, 35.5), (90.2, 50.6), (96.5, 2.6)]
_HEADERS = [
    ((18.0, 62.0), (49.5, 52.1)),
    ((70.0, 92.0), (49.5, 52.1)),
    ((28.0, 50.0), (1.2, 3.8)),
    ((54.0, 92.0), (1.2, 3.8)),
    ((93.6, 98.8), (7.0, 47.0)),
]
"""Bounds along X and Y of the strips that wires plug into."""


def board_drawings(deck: float, room: float, x: float = 0.0) -> list[Drawing]:
    """Return the board with its parts, on standoffs, smaller if there is less room.

    Args:
        deck: height of the deck it stands on.
        room: radius of what is free on the deck, about its place.
        x: how far ahead of the middle of the robot that is.
    """
    fit = min(1.0, (room - 6.0) / 66.0)

    def placed(solid: Manifold) -> Manifold:
        at = (-0.5 * _LENGTH - 9.0, -0.5 * _WIDTH, 8.0)
        return solid.translate(at).scale([fit] * 3).translate((x, 0.0, deck))

    sheet = slab(rectangle((0.0, _LENGTH), (0.0, _WIDTH), 2.5), (0.0, _THICKNESS))
    return [
        Drawing("board", placed(sheet), solids.BOARD),
        Drawing("chips", placed(_chips()), solids.BLACK),
        Drawing("sockets", placed(_sockets()), solids.STEEL),
    ]


def _chips() -> Manifold:
    """Return the black parts: headers, the power jack, the processor and smaller chips."""
    low = _THICKNESS
    headers = [box(x, y, (low, low + 8.5)) for x, y in _HEADERS]
    grooves = [
        box((x[0] + 0.9, x[1] - 0.9), (y[0] + 0.9, y[1] - 0.9), (low + 7.5, low + 9.0))
        for x, y in _HEADERS
    ]
    chips = [
        box((-1.8, 11.5), (3.2, 12.2), (low, low + 11.0)),
        box((48.0, 62.0), (20.0, 34.0), (low, low + 1.6)),
        box((17.0, 22.0), (34.0, 39.0), (low, low + 1.4)),
        box((6.0, 9.5), (15.0, 21.5), (low, low + 2.0)),
    ]
    return union([*headers, *chips]) - union(grooves)


def _sockets() -> Manifold:
    """Return the metal parts: the USB socket, capacitors, reset button, screws and standoffs."""
    low = _THICKNESS
    cans = [rod(3.0, (low, low + 5.4), at=(17.5, y, 0.0)) for y in (8.0, 16.0)]
    screws = [rod(2.8, (low, low + 1.2), at=(x, y, 0.0), corners=8) for x, y in _HOLES]
    legs = [rod(2.8, (-8.0, 0.0), at=(x, y, 0.0), corners=6) for x, y in _HOLES]
    socket = box((-6.2, 10.0), (31.5, 43.5), (low, low + 10.9))
    plug = box((-7.0, -2.0), (33.5, 41.5), (low + 2.0, low + 8.5))
    button = rod(2.2, (low, low + 3.4), at=(28.0, 42.0, 0.0))
    return union([socket - plug, button, *cans, *screws, *legs])


_MODULE_PACK = (138.0, 46.0, 34.0)
"""Length, width and height of the largest battery."""


def module_equipment_drawings(layout: Layout, decks: Decks, body: Body) -> list[Drawing]:
    """Return all equipment."""
    return [
        *_module_battery(layout),
        *board_drawings(layout.top, decks.middle),
        *_controllers(layout, decks),
        Drawing("radio", _module_radio(layout, decks), solids.BLACK),
        Drawing("standoffs", _standoffs(layout, decks), solids.STEEL),
        Drawing("arrow", _module_arrow(layout, decks), solids.front_material(body)),
    ]


def _module_battery(layout: Layout) -> list[Drawing]:
    """Return the pack between the servos, as large as fits there, with label, strap and plug."""
    radius = min(layout.core - 1.5, 0.5 * math.hypot(_MODULE_PACK[0], _MODULE_PACK[1]))
    shape = math.radians(26.0)
    x, y = radius * math.cos(shape), radius * math.sin(shape)
    low = layout.deck + 0.3
    tall = min(_MODULE_PACK[2], 0.86 * (layout.roof - layout.deck))
    high = low + tall
    label = rectangle((-0.62 * x, 0.62 * x), (-y - 0.3, y + 0.3)) - rectangle((-x, x), (-y, y))
    across = (-0.14 * x, 0.14 * x)
    strap = box(across, (-y - 1.2, y + 1.2), (low, high + 1.2))
    plug = box((x, x + 0.2 * y), (-0.3 * y, 0.3 * y), (high - 0.4 * y, high - 0.1 * y))
    return [
        Drawing("battery", slab(rectangle((-x, x), (-y, y), 0.12 * y), (low, high)), solids.SHRINK),
        Drawing("label", slab(label, (low + 0.2 * tall, low + 0.8 * tall)), solids.WHITE),
        Drawing("strap", strap - box(across, (-y, y), (low - 1.0, high)), solids.RUBBER),
        Drawing("plug", plug, solids.YELLOW),
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
        "controllers": (union([slab(case, (0.2, 9.0)), pair[0]]), solids.BLACK),
        "labels": (slab(rectangle((-9.0, 9.0), (-14.0, 14.0)), (9.0, 9.3)), solids.WHITE),
        "supply": (pair[1], solids.RED),
        "phases": (phases, solids.BLUE),
    }
    places = _controller_places(layout, decks)
    return [
        Drawing(name, union(_placed_on_decks(solid, layout, *place) for place in places), material)
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


def _placed_on_decks(
    solid: Manifold, layout: Layout, turn_deg: float, x: float, scale: float
) -> Manifold:
    """Return a drawing on the upper deck, at a distance in a direction."""
    out = solid.scale([scale] * 3).translate((x, 0.0, layout.top))
    return out.rotate((0.0, 0.0, turn_deg))


def _module_radio(layout: Layout, decks: Decks) -> Manifold:
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


def _module_arrow(layout: Layout, decks: Decks) -> Manifold:
    """Return the arrow on the upper deck that points forward, along X."""
    m = layout.scale
    shape = polygon([(-40.0, -24.0), (0.0, 0.0), (-40.0, 24.0), (-29.0, 0.0)])
    tip = (decks.middle - 2.0 * m, 0.0, layout.top)
    return slab(grown(shape, -1.0), (0.1, 3.6)).scale([m] * 3).translate(tip)


_PACK = (0.5, 0.98, 0.44)
"""Length, width and height of the battery, in radii of the free middle of the deck."""
_DRIVER = rectangle((-20.0, 20.0), (-28.0, 28.0), 3.0)
"""Footprint of a motor driver; nominal."""


def platform_equipment_drawings(layout: PlatformLayout, body: Body) -> list[Drawing]:
    """Return all that stands on the upper deck."""
    room = layout.middle
    places = list(_driver_places(layout))
    return [
        *_battery(layout, -0.36 * room),
        *board_drawings(layout.top, 0.56 * room, 0.3 * room),
        *_drivers(layout, places),
        Drawing("radio", _radio(layout).translate((-0.36 * room, 0.68 * room, 0.0)), solids.BLACK),
        Drawing("arrow", _arrow(layout), solids.front_material(body)),
    ]


def _battery(layout: PlatformLayout, x: float) -> list[Drawing]:
    """Return the pack with label, strap and plug, across the back of the deck."""
    long, wide, tall = (0.5 * share * layout.middle for share in _PACK)
    low, high = layout.top + 0.3, layout.top + 0.3 + tall
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
    drawn_solids = {
        "battery": (pack, solids.SHRINK),
        "label": (union([sides, face]), solids.WHITE),
        "strap": (union(straps), solids.RUBBER),
        "plug": (plug, solids.YELLOW),
    }
    return [
        Drawing(name, solid.translate((x, 0.0, 0.0)), material)
        for name, (solid, material) in drawn_solids.items()
    ]


def _driver_places(layout: PlatformLayout) -> Iterator[tuple[float, float, float]]:
    """Yield direction, distance and scale of a motor driver near each wheel, if one fits there."""
    room = layout.middle
    taken = union_of(
        rectangle((-0.66 * room, -0.08 * room), (-0.62 * room, 0.8 * room)),
        rectangle((-0.02 * room, 0.66 * room), (-0.4 * room, 0.4 * room)),
        rectangle((0.7 * room, 1.1 * room), (-0.2 * room, 0.2 * room)),
    )
    for mount in layout.mounts:
        toward = math.degrees(math.atan2(mount.y, mount.x))
        place = next(_free(layout, taken, toward), None)
        if place is not None:
            taken += _footprint(place)
            yield place


def _free(
    layout: PlatformLayout, taken: CrossSection, toward: float
) -> Iterator[tuple[float, float, float]]:
    """Yield places for a driver that are wholly on the deck and clear of all else, best first."""
    for fit in (1.0, 0.8, 0.6, 0.45):
        for aside in (0.0, 12.0, -12.0, 25.0, -25.0, 40.0, -40.0, 55.0, -55.0):
            for share in (0.8, 0.72, 0.9, 1.0, 1.1):
                place = (toward + aside, share * layout.middle, fit * layout.scale)
                outline = _footprint(place)
                if (outline - layout.outline).area() < 1e-6 and (outline ^ taken).area() < 1e-6:
                    yield place


def _footprint(place: tuple[float, float, float]) -> CrossSection:
    turn, distance, scale = place
    return _DRIVER.scale((scale, scale)).translate((distance, 0.0)).rotate(turn)


def _drivers(layout: PlatformLayout, places: list[tuple[float, float, float]]) -> list[Drawing]:
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
        "drivers": (union([case - fins, strip]), solids.ANODISED),
        "labels": (label, solids.WHITE),
        "supply": (union(wires[:1]), solids.RED),
        "phases": (union(wires[1:]), solids.BLUE),
    }
    return [
        Drawing(name, union(_placed(layout, solid, place) for place in places), material)
        for name, (solid, material) in one.items()
    ]


def _placed(layout: PlatformLayout, solid: Manifold, place: tuple[float, float, float]) -> Manifold:
    turn, distance, scale = place
    out = solid.scale([scale] * 3).translate((distance, 0.0, layout.top))
    return out.rotate((0.0, 0.0, turn))


def _radio(layout: PlatformLayout) -> Manifold:
    """Return the receiver with its antenna, at the origin of the upper deck."""
    solid = union(
        [
            slab(rectangle((-14.0, 14.0), (-10.0, 10.0), 2.5), (0.2, 13.0)),
            rod(3.6, (12.5, 19.0), at=(8.0, 2.0, 0.0)),
            rod(2.6, (18.0, 88.0), at=(8.0, 2.0, 0.0), tip=1.9),
            rod(3.2, (87.0, 93.0), at=(8.0, 2.0, 0.0), tip=2.4),
        ]
    )
    return solid.scale([layout.scale] * 3).translate((0.0, 0.0, layout.top))


def _arrow(layout: PlatformLayout) -> Manifold:
    """Return the arrow on the upper deck that points forward, along X."""
    m = layout.scale
    shape = polygon([(-40.0, -24.0), (0.0, 0.0), (-40.0, 24.0), (-29.0, 0.0)])
    tip = (layout.reach(0.0) - 8.0 * m, 0.0, layout.top)
    return slab(grown(shape, -1.0), (0.1, 3.6)).scale([m] * 3).translate(tip)


def union_of(*outlines: CrossSection) -> CrossSection:
    """Return outlines as one."""
    return CrossSection.batch_boolean(list(outlines), OpType.Add)
