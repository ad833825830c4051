"""Equipment on the upper deck: battery, controller board, motor drivers, radio, heading arrow.

The controller board resembles an Arduino Mega 2560.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from manifold3d import CrossSection, Manifold, OpType

from tsd_twin.models import solids
from tsd_twin.models.omni_wheel import PlatformLayout
from tsd_twin.models.singularity_layout import Layout
from tsd_twin.models.solids import (
    Drawing,
    Point,
    Span,
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
"""Bounds of the pin headers along X and Y."""


def board_drawings(deck: float, room: float, x: float = 0.0) -> list[Drawing]:
    """Draw the controller board on standoffs, smaller if there is less room.

    Args:
        deck: Height of the supporting deck.
        room: Radius of the free area around the board.
        x: Distance ahead of the robot's centre.
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
    """Draw the black parts: headers, power jack, processor and smaller chips."""
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
    """Draw the metal parts: USB socket, capacitors, reset button, screws and standoffs."""
    low = _THICKNESS
    cans = [rod(3.0, (low, low + 5.4), at=(17.5, y, 0.0)) for y in (8.0, 16.0)]
    screws = [rod(2.8, (low, low + 1.2), at=(x, y, 0.0), corners=8) for x, y in _HOLES]
    legs = [rod(2.8, (-8.0, 0.0), at=(x, y, 0.0), corners=6) for x, y in _HOLES]
    socket = box((-6.2, 10.0), (31.5, 43.5), (low, low + 10.9))
    plug = box((-7.0, -2.0), (33.5, 41.5), (low + 2.0, low + 8.5))
    button = rod(2.2, (low, low + 3.4), at=(28.0, 42.0, 0.0))
    return union([socket - plug, button, *cans, *screws, *legs])


class Place(NamedTuple):
    """Place of a device on a deck."""

    direction_deg: float
    distance: float
    """Distance from the robot's centre in that direction, millimetres."""
    scale: float

    def on_deck(self, solid: Manifold, height: float) -> Manifold:
        """Move a solid to this place, on a deck of the given height."""
        scaled = solid.scale([self.scale] * 3).translate((self.distance, 0.0, height))
        return scaled.rotate((0.0, 0.0, self.direction_deg))

    def footprint(self, outline: CrossSection) -> CrossSection:
        """Move an outline to this place."""
        scaled = outline.scale((self.scale, self.scale)).translate((self.distance, 0.0))
        return scaled.rotate(self.direction_deg)


def copies(device: Sequence[Drawing], places: Sequence[Place], height: float) -> list[Drawing]:
    """Copy a device to several places on a deck: one drawing per part."""
    return [
        part._replace(solid=union(place.on_deck(part.solid, height) for place in places))
        for part in device
    ]


def driver_case(x: float, y: float, height: float) -> Manifold:
    """Draw the case of a motor driver with cooling grooves along Y; `x` and `y` are half sides."""
    case = slab(rectangle((-x, x), (-y, y), 3.0), (0.3, height))
    return case - union(
        box((at, at + 2.0), (1.0 - y, y - 1.0), (height - 5.0, height + 1.0))
        for at in (5.0 - x, 11.0 - x, x - 13.0, x - 7.0)
    )


def heading_arrow(
    body: Body,
    tip: Point,
    scale: float,
    size: tuple[float, float, float, float] = (40.0, 24.0, 29.0, 3.6),
    rounding: float = 1.0,
) -> Drawing:
    """Draw an arrow on a deck that points forward, along X.

    `size` is its length, half width, length without the notch, and height; `scale` multiplies these
    and the corner `rounding`.
    """
    length, half, notched, height = size
    shape = polygon([(-length, -half), (0.0, 0.0), (-length, half), (-notched, 0.0)])
    outline = grown(shape, -rounding) if rounding else shape
    arrow = slab(outline, (0.1, height)).scale([scale] * 3).translate(tip)
    return Drawing("arrow", arrow, solids.front_material(body))


def _battery(
    x: float, y: float, z: Span, *, straps: Manifold, plug: Manifold, top_label: Manifold | None
) -> list[Drawing]:
    """Draw a battery with label, straps and plug about the origin; `x` and `y` are half sides."""
    tall = z[1] - z[0]
    band = rectangle((-0.62 * x, 0.62 * x), (-y - 0.3, y + 0.3)) - rectangle((-x, x), (-y, y))
    label = slab(band, (z[0] + 0.2 * tall, z[0] + 0.8 * tall))
    pack = slab(rectangle((-x, x), (-y, y), 0.12 * min(x, y)), z)
    return [
        Drawing("battery", pack, solids.SHRINK),
        Drawing("label", label if top_label is None else label + top_label, solids.WHITE),
        Drawing("strap", straps, solids.RUBBER),
        Drawing("plug", plug, solids.YELLOW),
    ]


def _radio(
    half: tuple[float, float],
    antenna: tuple[float, float],
    z: tuple[float, float, float],
    radii: tuple[float, float, float, float, float],
) -> Manifold:
    """Draw a receiver with its antenna about the origin.

    `half` are half sides of the case, and `z` the heights of the antenna's foot and of both ends
    of its cap. `radii`: foot, and both ends of mast and cap.
    """
    (x, y), at, (low, top, end) = half, (*antenna, 0.0), z
    foot, mast, thin, cap, cap_end = radii
    return union(
        [
            slab(rectangle((-x, x), (-y, y), 2.5), (0.2, low + 0.5)),
            rod(foot, (low, low + 6.5), at=at),
            rod(mast, (low + 5.5, top + 1.0), at=at, tip=thin),
            rod(cap, (top, end), at=at, tip=cap_end),
        ]
    )


def spacer(layout: Layout | PlatformLayout, leg: float, head: float, tall: float) -> Manifold:
    """Draw a hexagonal spacer between the decks, with its screw; nominal radii and height."""
    m = layout.scale
    return union(
        [
            rod(leg * m, (layout.deck, layout.roof), corners=6),
            rod(head * m, (layout.top, layout.top + tall * m), corners=8),
        ]
    )


_MODULE_PACK = (138.0, 46.0, 34.0)
"""Length, width and height of the largest battery."""


def module_equipment_drawings(layout: Layout, body: Body) -> list[Drawing]:
    """Draw the equipment of a robot on gimballed wheels."""
    m, top = layout.scale, layout.top
    radio = _radio((9.0, 14.0), (-3.0, 8.0), (10.5, 61.0, 66.0), (3.2, 2.4, 1.7, 2.8, 2.2))
    radio = radio.scale([m] * 3).translate((14.0 * m - layout.middle, 0.0, top))
    return [
        *_module_battery(layout),
        *board_drawings(top, layout.middle),
        *_controllers(layout),
        Drawing("radio", radio, solids.BLACK),
        Drawing("standoffs", _standoffs(layout), solids.STEEL),
        heading_arrow(body, (layout.middle - 2.0 * m, 0.0, top), m),
    ]


def _module_battery(layout: Layout) -> list[Drawing]:
    """Draw the battery between the servos, as large as possible."""
    radius = min(layout.core - 1.5, 0.5 * math.hypot(_MODULE_PACK[0], _MODULE_PACK[1]))
    shape = math.radians(26.0)
    x, y = radius * math.cos(shape), radius * math.sin(shape)
    low = layout.deck + 0.3
    high = low + min(_MODULE_PACK[2], 0.86 * (layout.roof - layout.deck))
    across = (-0.14 * x, 0.14 * x)
    strap = box(across, (-y - 1.2, y + 1.2), (low, high + 1.2))
    strap -= box(across, (-y, y), (low - 1.0, high))
    plug = box((x, x + 0.2 * y), (-0.3 * y, 0.3 * y), (high - 0.4 * y, high - 0.1 * y))
    return _battery(x, y, (low, high), straps=strap, plug=plug, top_label=None)


def _controllers(layout: Layout) -> list[Drawing]:
    """Draw a speed controller with wires on each lobe of the upper deck."""
    case = rectangle((-13.0, 13.0), (-24.0, 24.0), 3.0)
    ends = [(side * 9.0, -23.0, 5.0) for side in (-1.0, 1.0)]
    pair = [wire([end, (end[0], -31.0, 5.0), (0.8 * end[0], -35.0, -9.0)], 1.4) for end in ends]
    phases = union(
        wire([(x, 23.0, 5.0), (x, 30.0, 5.0), (0.8 * x, 34.0, -9.0)], 1.2) for x in (-7.0, 0.0, 7.0)
    )
    controller = [
        Drawing("controllers", union([slab(case, (0.2, 9.0)), pair[0]]), solids.BLACK),
        Drawing("labels", slab(rectangle((-9.0, 9.0), (-14.0, 14.0)), (9.0, 9.3)), solids.WHITE),
        Drawing("supply", pair[1], solids.RED),
        Drawing("phases", phases, solids.BLUE),
    ]
    return copies(controller, list(_controller_places(layout)), layout.top)


def _controller_places(layout: Layout) -> Iterator[Place]:
    """Yield a place for a controller on each lobe that is large enough."""
    outline = rectangle((-14.0, 14.0), (-36.0, 36.0))
    for lobe in layout.lobes_deg:
        x = 0.5 * (0.7 * layout.middle + layout.reach(lobe, 12.0 * layout.scale))
        for fit in (1.0, 0.8, 0.6, 0.45):
            place = Place(lobe, x, fit * layout.scale)
            if layout.carries(place.footprint(outline)):
                yield place
                break


def _standoffs(layout: Layout) -> Manifold:
    """Draw the spacers near the ends of the lobes."""
    m = layout.scale
    one = spacer(layout, 3.2, 2.9, 2.2)
    ends = [(lobe, layout.reach(lobe, 12.0 * m) - 10.0 * m) for lobe in layout.lobes_deg]
    seats = [(lobe, x, y) for lobe, x in ends for y in (-44.0 * m, 44.0 * m)]
    return union(
        one.translate((x, y, 0.0)).rotate((0.0, 0.0, lobe))
        for lobe, x, y in seats
        if layout.carries(circle(5.0 * m, (x, y)).rotate(lobe))
    )


_PACK = (0.5, 0.98, 0.44)
"""Length, width and height of the battery, relative to the free radius of the deck."""


def platform_equipment_drawings(layout: PlatformLayout, body: Body) -> list[Drawing]:
    """Draw the equipment of a platform on omni wheels."""
    room, m = layout.middle, layout.scale
    tip = (layout.reach(0.0) - 8.0 * m, 0.0, layout.top)
    radio = _radio((14.0, 10.0), (8.0, 2.0), (12.5, 87.0, 93.0), (3.6, 2.6, 1.9, 3.2, 2.4))
    radio = radio.scale([m] * 3).translate((-0.36 * room, 0.68 * room, layout.top))
    return [
        *_platform_battery(layout, -0.36 * room),
        *board_drawings(layout.top, 0.56 * room, 0.3 * room),
        *copies(_driver(), list(_driver_places(layout)), layout.top),
        Drawing("radio", radio, solids.BLACK),
        heading_arrow(body, tip, m),
    ]


def _platform_battery(layout: PlatformLayout, at_x: float) -> list[Drawing]:
    """Draw the battery across the back of the deck."""
    x, y, tall = (0.5 * share * layout.middle for share in _PACK)
    low, high = layout.top + 0.3, layout.top + 0.3 + tall
    straps = [
        box((-x - 1.2, x + 1.2), (at - 0.09 * y, at + 0.09 * y), (low, high + 1.2))
        - box((-x, x), (-y, y), (low - 1.0, high))
        for at in (-0.5 * y, 0.5 * y)
    ]
    plug = box((-0.3 * x, 0.3 * x), (y + 0.3, 1.16 * y), (low + 0.5 * tall, high - 2.0))
    face = slab(rectangle((-0.5 * x, 0.5 * x), (-0.3 * y, 0.3 * y)), (high, high + 0.3))
    drawings = _battery(x, y, (low, high), straps=union(straps), plug=plug, top_label=face)
    return [d._replace(solid=d.solid.translate((at_x, 0.0, 0.0))) for d in drawings]


def _driver() -> list[Drawing]:
    """Draw the parts of a motor driver: case, label, and motor wires."""
    strip = box((-14.0, 14.0), (-28.0, -23.0), (0.3, 9.0))
    wires = [
        wire([(x, -27.0, 5.0), (x, -31.0, 4.0), (0.6 * x + 18.0, -33.0, -6.0)], 1.5)
        for x in (-9.0, -3.0, 3.0)
    ]
    label = slab(rectangle((-3.5, 3.5), (-14.0, 14.0)), (16.0, 16.3))
    return [
        Drawing("drivers", union([driver_case(18.0, 24.0, 16.0), strip]), solids.ANODISED),
        Drawing("labels", label, solids.WHITE),
        Drawing("supply", wires[0], solids.RED),
        Drawing("phases", union(wires[1:]), solids.BLUE),
    ]


def _driver_places(layout: PlatformLayout) -> Iterator[Place]:
    """Yield a place for a motor driver near each wheel, if there is room."""
    room = layout.middle
    outline = rectangle((-20.0, 20.0), (-28.0, 28.0), 3.0)
    taken = CrossSection.batch_boolean(
        [
            rectangle((-0.66 * room, -0.08 * room), (-0.62 * room, 0.8 * room)),
            rectangle((-0.02 * room, 0.66 * room), (-0.4 * room, 0.4 * room)),
            rectangle((0.7 * room, 1.1 * room), (-0.2 * room, 0.2 * room)),
        ],
        OpType.Add,
    )
    for mount in layout.mounts:
        for place in _candidates(layout, math.degrees(math.atan2(mount.y, mount.x))):
            footprint = place.footprint(outline)
            off_deck, overlap = footprint - layout.outline, footprint ^ taken
            if off_deck.area() < 1e-6 and overlap.area() < 1e-6:
                taken += footprint
                yield place
                break


def _candidates(layout: PlatformLayout, direction_deg: float) -> Iterable[Place]:
    """Return candidate places for a driver around a direction, best first."""
    return (
        Place(direction_deg + aside, share * layout.middle, fit * layout.scale)
        for fit in (1.0, 0.8, 0.6, 0.45)
        for aside in (0.0, 12.0, -12.0, 25.0, -25.0, 40.0, -40.0, 55.0, -55.0)
        for share in (0.8, 0.72, 0.9, 1.0, 1.1)
    )
