"""The outer gimbal frame: a square around the inner one, with the servo that turns that one.

Drawn for a wheel radius of 40 mm in the module frame at neutral tilt: X tangential, Y outward,
Z up, gimbal centre at the origin. It turns about Y, between the horn of a servo of the chassis,
inboard, and a bearing, outboard; a belt goes from its own servo to the inner frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from manifold3d import CrossSection, Manifold

from tsd_twin.description import paint, servo
from tsd_twin.description.inner import BELT, PULLEY
from tsd_twin.description.layout import HORN, RIB_IN, RIB_OUT, Layout
from tsd_twin.description.part import Drawing
from tsd_twin.description.solids import (
    Point,
    circle,
    grown,
    polygon,
    rectangle,
    rod,
    sideways,
    slab,
    tube,
    union,
)
from tsd_twin.robots.robot import Body

_INSIDE, _OUTSIDE = 49.5, 53.5
"""Half widths of the frame."""
_HUBS = (56.0, 57.0)
"""How far the hubs reach along Y, inboard and outboard."""
_SERVO_LOW = 33.0
"""Underside of the servo: the motor passes below it at full tilt."""


@dataclass(frozen=True, slots=True)
class _Seat:
    """Where the servo sits: behind the raised side of the frame, its shaft along X."""

    size: Point
    y: float
    """Of the shaft: the case is centred."""
    z: float

    @classmethod
    def of(cls, layout: Layout) -> _Seat:
        """Return the seat, in the units of this drawing."""
        width, length, depth = (side / layout.scale for side in layout.servo)
        return cls((width, length, depth), (HORN - 0.5) * length, _SERVO_LOW + 0.5 * width)

    def place(self, solid: Manifold) -> Manifold:
        """Return a drawing of the servo, in its place."""
        return solid.rotate((0.0, 90.0, 0.0)).translate((_INSIDE, self.y, self.z))


def drawings(layout: Layout, body: Body) -> list[Drawing]:
    """Return the outer frame and what it carries."""
    seat = _Seat.of(layout)
    return [
        Drawing("frame", _frame(seat), paint.frame(body)),
        Drawing("servo", seat.place(servo.case(seat.size)), paint.BLACK),
        Drawing("steel", _steel(seat, layout.plate / layout.scale), paint.STEEL),
        Drawing("belt", _belt(seat), paint.RUBBER),
    ]


def _frame(seat: _Seat) -> Manifold:
    """Return the square with its seats and hubs, and the side that carries the servo."""
    plan = rectangle((-_OUTSIDE, _OUTSIDE), (-_OUTSIDE, _OUTSIDE), 32.0)
    plan -= rectangle((-_INSIDE, _INSIDE), (-_INSIDE, _INSIDE), 28.0)
    crown, waist = seat.z + 0.5 * seat.size[0], 16.0
    side = polygon(
        [(-25.0, -5.0), (25.0, -5.0), (21.0, waist), (24.0, crown), (-24.0, crown), (-21.0, waist)]
    )
    side = grown(grown(side, -4.0), 4.0)
    side -= rectangle((-12.0, 12.0), (11.0, seat.z - 0.45 * seat.size[0]), 4.0)
    solid = union(
        [
            slab(plan, (-5.0, 5.0)),
            sideways(side, (_INSIDE, _OUTSIDE)),
            rod(8.0, (_INSIDE, _OUTSIDE + 0.6), "x"),
            rod(8.0, (-_OUTSIDE - 0.6, -_INSIDE), "x"),
            rod(10.0, (-_HUBS[0], -_INSIDE - 1.0), "y"),
            rod(9.0, (_INSIDE + 1.0, _HUBS[1]), "y"),
        ]
    )
    shaft = rod(0.29 * seat.size[0], (40.0, 60.0), "x", (0.0, seat.y, seat.z))
    return solid - union([rod(3.4, (-60.0, 60.0), "x"), shaft])


def _steel(seat: _Seat, plate: float) -> Manifold:
    """Return bearings, the axle outboard, the horn inboard, the driving pulley, and screws."""
    horn = 0.26 * seat.size[0]
    end = _OUTSIDE + 0.9
    pulley = [rod(PULLEY, (_INSIDE + 0.5, BELT[1]), "x"), rod(9.0, (BELT[1], BELT[1] + 0.8), "x")]
    angles = [math.radians(angle) for angle in (45, 135, 225, 315)]
    spots = [(0.8 * horn * math.cos(angle), 0.8 * horn * math.sin(angle)) for angle in angles]
    return union(
        [
            tube(3.4, 6.0, (end - 4.0, end), "x"),
            tube(3.4, 6.0, (-end, 4.0 - end), "x"),
            rod(4.0, (_HUBS[1] - 1.0, RIB_OUT + plate + 2.5), "y"),
            union(pulley).translate((0.0, seat.y, seat.z)),
            rod(horn, (0.6 - RIB_IN, -_HUBS[0]), "y"),
            rod(0.6 * horn, (0.3 - RIB_IN - plate, 1.0 - RIB_IN), "y"),
            *(rod(1.4, (-_HUBS[0], 1.0 - _HUBS[0]), "y", (x, 0.0, z), corners=6) for x, z in spots),
            seat.place(servo.fittings(seat.size)),
        ]
    )


def _belt(seat: _Seat) -> Manifold:
    """Return the toothed belt from the servo down to the inner frame."""
    ends = [circle(PULLEY + 1.4), circle(PULLEY + 0.3)]
    runs = [CrossSection.batch_hull([end, end.translate((seat.y, seat.z))]) for end in ends]
    return sideways(runs[0] - runs[1], (BELT[0] + 0.4, BELT[1] - 0.4))
