"""The inner gimbal frame: a ring around the wheel, with the arms that carry the motor.

Drawn for a wheel radius of 40 mm in the module frame at neutral tilt: X tangential, Y outward,
Z up, gimbal centre at the origin. It turns about X; a belt drives the pulley on its pin.
"""

from __future__ import annotations

import math

from manifold3d import CrossSection, Manifold

from tsd_twin.description import paint
from tsd_twin.description.part import Drawing
from tsd_twin.description.solids import (
    Span,
    around,
    circle,
    grown,
    polygon,
    rectangle,
    rod,
    slab,
    union,
)
from tsd_twin.robots.robot import Body

BELT: Span = (54.6, 58.6)
"""Bounds of the pulleys and of their belt along X."""
PULLEY = 7.0
"""Radius of the pulleys: belt and servo turn the frame one to one."""
_RING = (42.5, 46.0)
"""Inner and outer radius: the wheel's is 40."""
_ARMS: Span = (3.5, 8.5)
"""Bounds of the arms along Z: above the rim of the wheel."""


def drawings(body: Body) -> list[Drawing]:
    """Return the inner frame, and what of the motor does not spin."""
    return [
        Drawing("frame", _frame(), paint.frame(body)),
        Drawing("pins", _pins(), paint.STEEL),
        Drawing("stator", _stator(), paint.ANODISED),
        Drawing("windings", _windings(), paint.COPPER),
    ]


def _frame() -> Manifold:
    ring = circle(_RING[1]) - circle(_RING[0])
    arm = polygon([(8.0, -7.5), (44.0, -4.2), (44.0, 4.2), (8.0, 7.5)])
    window = rectangle((17.0, 36.0), (-2.0, 2.0), 1.9)
    turns = (0.0, 90.0, 180.0, 270.0)
    plan = CrossSection.compose([circle(15.0), *(arm.rotate(turn) for turn in turns)])
    plan = grown(grown(plan, 5.0), -5.0) ^ circle(44.0)  # Fillets between arms and hub.
    plan -= CrossSection.compose([circle(4.0), *(window.rotate(turn) for turn in turns)])
    bosses = union([rod(6.0, (44.6, 48.4), "x"), rod(6.0, (-48.4, -44.6), "x")])
    return union(
        [slab(ring, (-4.5, 4.5)), slab(plan, _ARMS), bosses - rod(_RING[0] + 0.5, (-9.0, 9.0))]
    )


def _pins() -> Manifold:
    """Return the pins with cap and nut, the driven pulley, and the screws of the motor."""
    spots = [
        (4.9 * math.cos(0.5 * math.pi * i), 4.9 * math.sin(0.5 * math.pi * i)) for i in range(4)
    ]
    holes = union(rod(1.3, (50.0, 60.0), "x", (0.0, y, z)) for y, z in spots)
    return union(
        [
            rod(3.0, (46.5, 61.0), "x"),
            rod(3.0, (-57.0, -46.5), "x"),
            rod(PULLEY, BELT, "x") - holes,
            rod(5.0, (-57.0, -55.0), "x"),
            rod(4.2, (BELT[1] + 0.6, 61.0), "x", corners=6),
            around(rod(1.5, (_ARMS[1], _ARMS[1] + 1.2), at=(9.0, 9.0, 0.0), corners=6), 4),
        ]
    )


def _stator() -> Manifold:
    """Return the base of the motor, below the bell."""
    foot = around(slab(rectangle((-3.0, 12.5), (-3.0, 3.0), 2.5), (_ARMS[1], 10.0)), 4)
    return union([foot, rod(8.0, (_ARMS[1], 12.2))]) - rod(2.4, (0.0, 20.0))


def _windings() -> Manifold:
    """Return the copper, which is seen through the slots of the bell and below it."""
    tooth = rectangle((6.0, 15.0), (-2.2, 2.2), 1.0)
    plan = CrossSection.compose([circle(9.0), *(tooth.rotate(40.0 * turn) for turn in range(9))])
    return slab(plan - circle(2.4), (12.2, 23.0))
