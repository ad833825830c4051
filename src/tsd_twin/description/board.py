"""The controller board on the upper deck, drawn after an Arduino Mega 2560.

Millimetres; the origin of the drawing is the corner of the board next to the power jack.
"""

from __future__ import annotations

from manifold3d import Manifold

from tsd_twin.description import paint
from tsd_twin.description.part import Drawing
from tsd_twin.description.solids import box, rectangle, rod, slab, union

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


def drawings(deck: float, room: float, x: float = 0.0) -> list[Drawing]:
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
        Drawing("board", placed(sheet), paint.BOARD),
        Drawing("chips", placed(_chips()), paint.BLACK),
        Drawing("sockets", placed(_sockets()), paint.STEEL),
    ]


def _chips() -> Manifold:
    """Return what is black: headers, the power jack, the processor and smaller chips."""
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
    """Return what is bright: the USB socket, capacitors, reset button, screws and standoffs."""
    low = _THICKNESS
    cans = [rod(3.0, (low, low + 5.4), at=(17.5, y, 0.0)) for y in (8.0, 16.0)]
    screws = [rod(2.8, (low, low + 1.2), at=(x, y, 0.0), corners=8) for x, y in _HOLES]
    legs = [rod(2.8, (-8.0, 0.0), at=(x, y, 0.0), corners=6) for x, y in _HOLES]
    socket = box((-6.2, 10.0), (31.5, 43.5), (low, low + 10.9))
    plug = box((-7.0, -2.0), (33.5, 41.5), (low + 2.0, low + 8.5))
    button = rod(2.2, (low, low + 3.4), at=(28.0, 42.0, 0.0))
    return union([socket - plug, button, *cans, *screws, *legs])
