"""The stand of a spherical platform: a round plate on feet, and a leaning motor for each wheel.

Millimetres in `base_link`, whose origin is the centre of the sphere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from manifold3d import Manifold

from tsd_twin.description import board, paint
from tsd_twin.description.gear_motor import gear_motor
from tsd_twin.description.omni_wheel import WheelPlan
from tsd_twin.description.part import Drawing
from tsd_twin.description.solids import (
    around,
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
from tsd_twin.lie import Array
from tsd_twin.robots.robot import Body

_MOTOR = 0.62
"""Radius of the motors, as a share of that of the wheels."""
_TRAIN = 3.4
"""Length of motor, gearbox and encoder, in radii of the wheels."""
_FOOT = 9.0


@dataclass(frozen=True, slots=True, eq=False)
class Lean:
    """A wheel on the sphere: where it is, and the turn from its frame to `base_link`."""

    at: Array
    """(3,): centre, millimetres."""
    turn: Array
    """(3, 3): its columns are X, the axle Y, and Z, which points away from the sphere."""

    def in_base(self, solid: Manifold) -> Manifold:
        """Return what is drawn in the frame of the wheel."""
        return solid.transform(np.hstack([self.turn, self.at[:, None]]))

    @property
    def side(self) -> float:
        """The sign along the axle on which the motor is: the lower one, so that it stands low."""
        return -1.0 if self.turn[2, 1] >= 0.0 else 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Stand:
    """Where the parts of a stand go."""

    plan: WheelPlan
    leans: tuple[Lean, ...]

    @property
    def train(self) -> float:
        """Length of motor, gearbox and encoder."""
        return _TRAIN * self.plan.radius

    @property
    def bracket(self) -> float:
        """Distance of the bracket from the middle of a wheel, along its axle."""
        return self.plan.half_width + 0.18 * self.plan.radius

    @property
    def thick(self) -> float:
        """Thickness of the brackets."""
        return 0.16 * self.plan.radius

    @property
    def deck(self) -> float:
        """Height of the top of the plate: below all motors and wheels."""
        lowest = 0.0
        for lean in self.leans:
            end = lean.at + lean.side * (self.bracket + self.thick + self.train) * lean.turn[:, 1]
            tall = _MOTOR * 1.2 * self.plan.radius * math.hypot(lean.turn[2, 0], lean.turn[2, 2])
            rim = self.plan.radius * math.hypot(lean.turn[2, 0], lean.turn[2, 2])
            lowest = min(lowest, end[2] - tall, lean.at[2] - rim - self.plan.half_width)
        return lowest - 0.2 * self.plan.radius

    @property
    def floor(self) -> float:
        """How far below the origin the floor is."""
        return -self.deck + 6.0 + _FOOT

    @property
    def reach(self) -> float:
        """Radius of the plate."""
        return (
            max(math.hypot(lean.at[0], lean.at[1]) for lean in self.leans) + 2.2 * self.plan.radius
        )


def drawings(stand: Stand, body: Body) -> list[Drawing]:
    """Return the stand and all that is fixed to it."""
    radius, deck, reach = stand.plan.radius, stand.deck, stand.reach
    one = gear_motor(_MOTOR * radius, stand.train)
    hole = circle(0.3 * reach) - rectangle((-reach, reach), (-0.1 * reach, 0.1 * reach))
    plate = slab(circle(reach) - hole, (deck - 6.0, deck))
    lip = slab(circle(reach) - circle(reach - 4.0), (deck - 6.0, deck + 5.0))
    feet = around(rod(12.0, (deck - 6.0 - _FOOT, deck - 6.0), at=(0.86 * reach, 0.0, 0.0)), 3, 60.0)
    return [
        Drawing("plate", plate + lip, paint.acrylic(body)),
        Drawing("feet", feet, paint.RUBBER),
        Drawing(
            "brackets", union(_bracket(stand, lean) for lean in stand.leans), paint.frame(body)
        ),
        Drawing("motors", _each(stand, one.motor), paint.BLACK),
        Drawing("gearboxes", _each(stand, one.gearbox), paint.STEEL),
        Drawing("encoders", _each(stand, one.encoder), paint.BLUE),
        *_electronics(stand),
        Drawing("arrow", _arrow(stand), paint.front(body)),
    ]


def _each(stand: Stand, solid: Manifold) -> Manifold:
    """Return a drawing of a motor behind every bracket."""
    behind = stand.bracket + stand.thick
    placed: list[Manifold] = []
    for lean in stand.leans:
        turned = solid if lean.side < 0.0 else solid.rotate((0.0, 0.0, 180.0))
        placed.append(lean.in_base(turned.translate((0.0, lean.side * behind, 0.0))))
    return union(placed)


def _bracket(stand: Stand, lean: Lean) -> Manifold:
    """Return the plate that the gearbox is bolted to, and its legs straight down to the stand."""
    m, thick = _MOTOR * stand.plan.radius, stand.thick
    near = stand.bracket if lean.side > 0.0 else -stand.bracket - thick
    y = (near, near + thick)
    face = rectangle((-1.32 * m, 1.32 * m), (-m, m), 0.3 * m) - circle(0.4 * m)
    pieces = [lean.in_base(slab(face, (-y[1], -y[0])).rotate((90.0, 0.0, 0.0)))]
    for x in ((-1.3 * m, -1.07 * m), (1.07 * m, 1.3 * m)):
        inside = (y[0] + 0.1 * thick, y[1] - 0.1 * thick)
        shoulder = lean.in_base(box(x, inside, (-0.5 * m, 0.5 * m)))
        shade = shoulder.project()
        foot = slab(shade, (stand.deck + 0.4, stand.deck + 1.4))
        pieces.append(Manifold.batch_hull([shoulder, foot]))
        pieces.append(slab(grown(shade, 0.25 * m), (stand.deck, stand.deck + 3.0)))
    return union(pieces)


def _electronics(stand: Stand) -> list[Drawing]:
    """Return the board in the middle of the plate, and a driver between every two wheels."""
    deck, reach, m = stand.deck, stand.reach, stand.reach / 150.0
    directions = sorted(math.degrees(math.atan2(lean.at[1], lean.at[0])) for lean in stand.leans)
    gaps = [
        b - a for a, b in zip(directions, [*directions[1:], directions[0] + 360.0], strict=True)
    ]
    lobes = [a + 0.5 * gap for a, gap in zip(directions, gaps, strict=True)]
    case = slab(rectangle((-16.0, 16.0), (-26.0, 26.0), 3.0), (0.3, 15.0))
    fins = union(
        slab(rectangle((x, x + 2.0), (-25.0, 25.0)), (10.0, 16.0)) for x in (-11.0, -5.0, 3.0, 9.0)
    )
    wires = [
        wire([(-9.0, y, 0.4), (-18.0, y, 7.0), (-15.0, y, 8.0)], 1.4) for y in (-16.0, -10.0, -4.0)
    ]
    one = {
        "drivers": (case - fins, paint.ANODISED),
        "supply": (union(wires[:1]), paint.RED),
        "phases": (union(wires[1:]), paint.BLUE),
    }
    place = (0.7 * reach, 0.0, deck)
    parts = [
        Drawing(
            name,
            union(solid.scale([m] * 3).translate(place).rotate((0.0, 0.0, lobe)) for lobe in lobes),
            material,
        )
        for name, (solid, material) in one.items()
    ]
    return [*board.drawings(deck, 0.3 * reach), *parts]


def _arrow(stand: Stand) -> Manifold:
    """Return the arrow on the rim of the plate that points along X."""
    m = stand.reach / 150.0
    shape = polygon([(-24.0, -15.0), (0.0, 0.0), (-24.0, 15.0), (-17.0, 0.0)])
    tip = (stand.reach - 6.0, 0.0, stand.deck)
    return slab(shape, (0.1, 3.0)).scale([m] * 3).translate(tip)
