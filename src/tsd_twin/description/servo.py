"""A servo in its case: the shaft along Z, the front at Z = 0, the length along Y."""

from __future__ import annotations

from manifold3d import Manifold

from tsd_twin.description.layout import HORN
from tsd_twin.description.solids import Point, Span, box, rectangle, rod, slab, union


def case(size: Point) -> Manifold:
    """Return the case, millimetres; its near end is at negative Y.

    Args:
        size: width, length, and depth along the shaft.
    """
    width, length, depth = size
    x, y = _plan(size)
    corner = 0.05 * width
    body = slab(rectangle(x, y, corner), (-depth, 0.0))
    # Seams between the front, the middle and the back of the case.
    waist = rectangle((x[0] + 0.6, x[1] - 0.6), (y[0] + 0.6, y[1] - 0.6), corner)
    seam = slab(rectangle((-width, width), (-length, length)) - waist, (-0.5, 0.5))
    seams = [seam.translate((0.0, 0.0, -share * depth)) for share in (0.22, 0.78)]
    socket = box(
        (-0.25 * width, 0.25 * width), (y[1] - 2.5, y[1] + 1.0), (-0.7 * depth, -0.42 * depth)
    )
    return body - union([*seams, socket])


def fittings(size: Point) -> Manifold:
    """Return the bright parts on the back of a case of `size`: screws, and the idler's bearing."""
    width, _, depth = size
    x, y = _plan(size)
    back = (-depth - 0.6, -depth + 1.0)
    screws = [
        rod(0.04 * width, back, at=(column, row, 0.0), corners=6)
        for column in (0.82 * x[0], 0.82 * x[1])
        for row in (y[0] + 0.09 * width, y[1] - 0.09 * width)
    ]
    return union([*screws, rod(0.2 * width, (-depth - 1.2, -depth + 1.0))])


def _plan(size: Point) -> tuple[Span, Span]:
    """Return the bounds of the case along X and Y."""
    width, length, _ = size
    return (-0.5 * width, 0.5 * width), (-HORN * length, (1.0 - HORN) * length)
