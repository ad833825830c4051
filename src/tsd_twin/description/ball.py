"""The sphere of a spherical platform, painted so that every turn of it can be seen.

Eight fields between three great circles, in two colours that alternate, and a round mark at each
end of its axes: those of +X and +Z have colours of their own. Millimetres, about its centre.
"""

from __future__ import annotations

from manifold3d import Manifold

from tsd_twin.description import paint
from tsd_twin.description.part import Drawing
from tsd_twin.description.solids import box, rod, union
from tsd_twin.robots.robot import Body

_SEGMENTS = 64
_BAND = 0.035
"""Half the width of the great circles, as a share of the radius."""
_MARK = 0.17
"""Radius of the marks."""
_THICK = 0.06
"""Of the shell."""


def drawings(radius: float, body: Body) -> list[Drawing]:
    """Return the shell of a sphere, in pieces that fill it."""
    shell = Manifold.sphere(radius, _SEGMENTS) - Manifold.sphere((1.0 - _THICK) * radius, 24)
    far, thin = 2.0 * radius, _BAND * radius
    bands = union(
        [
            box((-thin, thin), (-far, far), (-far, far)),
            box((-far, far), (-thin, thin), (-far, far)),
            box((-far, far), (-far, far), (-thin, thin)),
        ]
    )
    marks = {
        (axis, side): rod(_MARK * radius, (0.0, far) if side > 0 else (-far, 0.0), axis)
        for axis in ("x", "y", "z")
        for side in (1, -1)
    }
    everywhere = union(marks.values())
    front, up = marks.pop(("x", 1)), marks.pop(("z", 1))
    fields = shell - (bands + everywhere)
    light = union(_octant(x, y, x * y, far) for x in (1, -1) for y in (1, -1))
    return [
        Drawing("fields", fields ^ light, paint.WHITE),
        Drawing("others", fields - light, paint.shell(body)),
        Drawing("bands", (shell ^ bands) - everywhere, paint.BLACK),
        Drawing("marks", shell ^ union(marks.values()), paint.BLUE),
        Drawing("front", shell ^ front, paint.front(body)),
        Drawing("up", shell ^ up, paint.YELLOW),
    ]


def _octant(x: int, y: int, z: int, far: float) -> Manifold:
    """Return the octant on the sides of the axes that have the signs."""
    spans = [(0.0, far) if side > 0 else (-far, 0.0) for side in (x, y, z)]
    return box(spans[0], spans[1], spans[2])
