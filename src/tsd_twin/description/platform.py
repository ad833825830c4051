"""The chassis of a platform on omni wheels: two decks, motors between them, equipment on top.

Millimetres in `base_link`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from manifold3d import CrossSection, Manifold, OpType

from tsd_twin.description import omni_wheel, paint
from tsd_twin.description.bay import MOTOR, Bay, Mount
from tsd_twin.description.gear_motor import gear_motor
from tsd_twin.description.load import load_drawings
from tsd_twin.description.omni_wheel import WheelPlan
from tsd_twin.description.part import Drawing
from tsd_twin.description.solids import box, circle, rectangle, rod, slab, standing, union
from tsd_twin.robots.robot import Body


class Tracker(NamedTuple):
    """A wheel that is not driven and only measures: millimetres and degrees in `base_link`."""

    x: float
    y: float
    turn_deg: float
    """Direction that it measures along."""
    radius: float


def drawings(bay: Bay, body: Body, trackers: Sequence[Tracker] = ()) -> list[Drawing]:
    """Return the chassis and all that is fixed to it.

    Args:
        bay: where things go.
        body: colours.
        trackers: the wheels that only measure, below the lower deck.
    """
    one = gear_motor(MOTOR * bay.scale, bay.train)
    decks = [
        slab(bay.outline - _holes(bay, trackers), (bay.deck - bay.plate, bay.deck)),
        slab(bay.outline, (bay.roof, bay.top)),
    ]
    parts = [
        Drawing("decks", union(decks), paint.acrylic(body)),
        Drawing("motors", _each(bay, one.motor), paint.BLACK),
        Drawing("gearboxes", _each(bay, one.gearbox), paint.STEEL),
        Drawing("encoders", _each(bay, one.encoder), paint.BLUE),
        Drawing(
            "brackets", union(m.in_base(_bracket(bay, m)) for m in bay.mounts), paint.frame(body)
        ),
        Drawing("standoffs", _standoffs(bay), paint.STEEL),
        *load_drawings(bay, body),
    ]
    return parts + (_trackers(bay, body, trackers) if trackers else [])


def _each(bay: Bay, solid: Manifold) -> Manifold:
    """Return a drawing of a motor behind the bracket of every wheel."""
    return union(m.in_base(solid.translate((0.0, bay.face(m), 0.0))) for m in bay.mounts)


def _holes(bay: Bay, trackers: Sequence[Tracker]) -> CrossSection:
    """Return what is cut out of the lower deck: for trackers, and in its middle to save weight."""
    reach = 0.16 * bay.middle
    hole = rectangle((-reach, reach), (-reach, reach), 0.3 * reach)
    slots: list[CrossSection] = []
    for one in trackers:
        wide = WheelPlan.usual(one.radius).half_width + 2.0
        slot = rectangle((-one.radius - 3.0, one.radius + 3.0), (-wide, wide), 2.0)
        slots.append(slot.rotate(one.turn_deg).translate((one.x, one.y)))
    return CrossSection.batch_boolean([hole, *slots], OpType.Add)


def _bracket(bay: Bay, mount: Mount) -> Manifold:
    """Return the plate between a wheel and its gearbox, with its feet and gussets on the deck."""
    m, face = bay.scale, bay.face(mount)
    half = 1.25 * MOTOR * m
    plate = rectangle((-half, half), (bay.deck + 0.3 * m, bay.roof), 4.0 * m)
    plate -= circle(0.4 * MOTOR * m)
    upright = standing(plate, (face, face + 6.0 * m))
    feet = union(
        box(
            _span(side * (half - 0.6 * m), side * (half - 6.0 * m)),
            (face - 26.0 * m, face + 2.3 * m),
            (bay.deck, bay.deck + 5.0 * m),
        )
        + _gusset(side, half, face, bay)
        for side in (-1.0, 1.0)
    )
    return upright + feet


def _span(a: float, b: float) -> tuple[float, float]:
    """Return the two in order."""
    return min(a, b), max(a, b)


def _gusset(side: float, half: float, face: float, bay: Bay) -> Manifold:
    """Return the triangle between a bracket and its foot."""
    m = bay.scale
    outline = CrossSection.batch_hull(
        [
            rectangle((face - 24.0 * m, face + 1.7 * m), (bay.deck + 0.6 * m, bay.deck + 4.0 * m)),
            rectangle((face - 3.0 * m, face + 1.7 * m), (bay.deck + 0.6 * m, bay.roof - 8.0 * m)),
        ]
    )
    x = _span(side * (half - 1.2 * m), side * (half - 4.6 * m))
    return slab(outline, x).rotate((90.0, 0.0, 90.0))


def _standoffs(bay: Bay) -> Manifold:
    """Return the hexagonal spacers between the decks, one at each corner, with their screws."""
    m = bay.scale
    spacer = union(
        [
            rod(4.0 * m, (bay.deck, bay.roof), corners=6),
            rod(4.2 * m, (bay.top, bay.top + 2.4 * m), corners=8),
        ]
    )
    spots: list[tuple[float, float]] = []
    for mount in bay.mounts:
        turn = math.radians(mount.axle_deg - 90.0)
        for side in (-1.0, 1.0):
            x, y = side * 0.66 * mount.plan.radius, bay.face(mount) - 8.0 * m
            spots.append(
                (
                    mount.x + x * math.cos(turn) - y * math.sin(turn),
                    mount.y + x * math.sin(turn) + y * math.cos(turn),
                )
            )
    there = [spot for spot in spots if (circle(6.0 * m, spot) - bay.outline).area() < 1e-6]
    return union(spacer.translate((x, y, 0.0)) for x, y in there)


def _trackers(bay: Bay, body: Body, trackers: Sequence[Tracker]) -> list[Drawing]:
    """Return small omni wheels below the lower deck, each on an arm, with its encoder."""
    every = [_tracker(bay, body, one) for one in trackers]
    return [
        same[0]._replace(solid=union(drawing.solid for drawing in same))
        for same in zip(*every, strict=True)
    ]


def _tracker(bay: Bay, body: Body, one: Tracker) -> list[Drawing]:
    """Return one of them, in its place."""
    r = one.radius
    plan = replace(WheelPlan.usual(r), rollers=6, sides=8)
    low, height = bay.deck - bay.plate, r - bay.floor
    side = plan.half_width + 3.0
    arm = CrossSection.batch_hull(
        [circle(0.36 * r, (0.0, height)), rectangle((-0.5 * r, 0.5 * r), (low - 2.0, low + 0.5))]
    )
    at = (0.0, 0.0, height)
    wheel = {d.name: d.solid.translate(at) for d in omni_wheel.drawings(plan, body)}
    wide = plan.half_width
    drawings = [
        Drawing("tracker_arms", standing(arm, (side, side + 3.0)), paint.frame(body)),
        Drawing("tracker_encoders", rod(0.5 * r, (side + 3.0, side + 13.0), "y", at), paint.BLUE),
        Drawing("tracker_hubs", rod(0.72 * r, (-wide, wide), "y", at), paint.WHITE),
        Drawing("tracker_rollers", wheel["rollers"], paint.RUBBER),
        Drawing("tracker_shafts", rod(0.1 * r, (-wide - 1.0, side + 1.0), "y", at), paint.STEEL),
    ]
    return [
        d._replace(solid=d.solid.rotate((0.0, 0.0, one.turn_deg)).translate((one.x, one.y, 0.0)))
        for d in drawings
    ]
