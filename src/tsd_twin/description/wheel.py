"""The wheel: a spinning hemisphere on struts, and the bell of the motor on the same shaft.

Drawn for a wheel radius of 40 mm, axle along Z, gimbal centre at the origin, open side up.
"""

from __future__ import annotations

import math

from manifold3d import CrossSection, Manifold

from tsd_twin.description import paint
from tsd_twin.description.layout import NOMINAL_WHEEL
from tsd_twin.description.part import Drawing
from tsd_twin.description.solids import (
    around,
    circle,
    grown,
    polygon,
    rectangle,
    rod,
    slab,
    standing,
    tube,
    union,
)
from tsd_twin.robots.robot import Body

_INSIDE = 37.0
"""Inner radius of the shell."""
_STRUTS = 6
_STRIPES = 3
_STRIPE_RAD = math.radians(9.0)
"""Half the angle of a stripe."""
_POLE = 7.0
"""Radius about the axle that the stripes leave free."""
_SEGMENTS = 48
"""Of a full turn of the shell."""
_BELL = (13.0, 26.0)
"""Heights between which the bell of the motor turns."""


def drawings(body: Body) -> list[Drawing]:
    """Return the wheel."""
    plain, stripes = _shell()
    return [
        Drawing("shell", plain, paint.shell(body)),
        Drawing("stripes", stripes, paint.RUBBER),
        Drawing("spider", _spider(), paint.WHITE),
        Drawing("shaft", _shaft(), paint.STEEL),
        Drawing("bell", _bell(), paint.ANODISED),
        Drawing("mark", _mark(), paint.shell(body)),
    ]


def _shell() -> tuple[Manifold, Manifold]:
    """Return the shell without its stripes, and the stripes: the two fill the hemisphere."""
    wall = CrossSection.circle(NOMINAL_WHEEL, 40) - CrossSection.circle(_INSIDE, 20)
    lip = rectangle((34.5, 38.0), (-2.4, 0.0))
    whole = ((wall + lip) ^ rectangle((0.0, 50.0), (-50.0, 0.0))).revolve(_SEGMENTS)
    # The pole stays whole: sectors that met there would share an edge, which no solid may.
    c, s = math.cos(_STRIPE_RAD), math.sin(_STRIPE_RAD)
    sector = polygon(
        [
            (_POLE * c, -_POLE * s),
            (60.0 * c, -60.0 * s),
            (60.0 * c, 60.0 * s),
            (_POLE * c, _POLE * s),
        ]
    )
    stripes = around(slab(sector, (-50.0, 1.0)), _STRIPES)
    return whole - stripes, whole ^ stripes


def _spider() -> Manifold:
    """Return the hub, and the struts that hold the shell."""
    web = rectangle((0.0, _INSIDE), (-31.0, -5.0)) ^ circle(_INSIDE - 0.05)
    window = grown(polygon([(29.0, -11.0), (14.0, -11.0), (14.0, -22.0), (24.0, -18.0)]), 2.0)
    struts = around(standing(web - window, (-1.2, 1.2)), _STRUTS, 30.0)
    foot = rod(11.0, (-31.0, -27.0), tip=8.0)
    return union([struts, foot, rod(8.0, (-27.5, -3.0))])


def _shaft() -> Manifold:
    """Return the shaft, with the nut that holds the bell."""
    return union(
        [rod(2.0, (-6.0, _BELL[1] + 4.0)), rod(4.0, (_BELL[1] + 0.02, _BELL[1] + 2.6), corners=6)]
    )


def _bell() -> Manifold:
    """Return the bell of the motor, slots in its face."""
    low, high = _BELL
    slot = grown(polygon([(8.5, -0.8), (11.8, -1.8), (11.8, 1.8), (8.5, 0.8)]), 1.0)
    slots = CrossSection.compose([slot.rotate(60.0 * turn) for turn in range(6)])
    face = circle(17.0) - circle(2.1) - slots
    return union([tube(15.6, 17.0, (low, high - 2.0)), slab(face, (high - 2.0, high))])


def _mark() -> Manifold:
    """Return a painted sector on the bell, by which the turning is seen."""
    sector = polygon([(4.6, -0.5), (16.2, -3.4), (16.2, 3.4), (4.6, 0.5)]).rotate(30.0)
    return slab(sector, (_BELL[1], _BELL[1] + 0.3))
