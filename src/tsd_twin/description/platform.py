"""The chassis of a platform on omni wheels: two decks, motors between them, equipment on top.

Millimetres in `base_link`.
"""

from __future__ import annotations

import math
from dataclasses import replace

from manifold3d import CrossSection, Manifold

from tsd_twin.description import paint
from tsd_twin.description.bay import MOTOR, Bay, Mount
from tsd_twin.description.gear_motor import gear_motor
from tsd_twin.description.load import load_drawings
from tsd_twin.description.omni_wheel import WheelPlan
from tsd_twin.description.omni_wheel import drawings as wheel_drawings
from tsd_twin.description.part import Drawing
from tsd_twin.description.solids import Point, box, circle, rectangle, rod, slab, standing, union
from tsd_twin.robots.robot import Body

DEAD_WHEEL = 0.28
"""Radius of the wheels that only measure, as a share of that of the others."""


def drawings(bay: Bay, body: Body, dead_wheels: tuple[Point, ...] = ()) -> list[Drawing]:
    """Return the chassis and all that is fixed to it.

    Args:
        bay: where things go.
        body: colours.
        dead_wheels: x and y of each wheel that only measures, millimetres, and the direction in
            degrees that it measures along.
    """
    one = gear_motor(MOTOR * bay.scale, bay.train)
    decks = [
        slab(bay.outline - _holes(bay), (bay.deck - bay.plate, bay.deck)),
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
    return parts + (_dead_wheels(bay, body, dead_wheels) if dead_wheels else [])


def _each(bay: Bay, solid: Manifold) -> Manifold:
    """Return a drawing of a motor behind the bracket of every wheel."""
    return union(m.in_base(solid.translate((0.0, bay.face(m), 0.0))) for m in bay.mounts)


def _holes(bay: Bay) -> CrossSection:
    """Return what is cut out of the lower deck to save weight, in its middle."""
    reach = 0.24 * bay.middle
    hole = rectangle((-0.5 * reach, 0.5 * reach), (-0.5 * reach, 0.5 * reach), 0.2 * reach)
    return CrossSection.compose(
        [
            hole.translate((x, y))
            for x in (-0.9 * reach, 0.9 * reach)
            for y in (-0.9 * reach, 0.9 * reach)
        ]
    )


def _bracket(bay: Bay, mount: Mount) -> Manifold:
    """Return the plate between a wheel and its gearbox, with its feet and gussets on the deck."""
    m, face = bay.scale, bay.face(mount)
    half = 1.25 * MOTOR * m
    plate = rectangle((-half, half), (bay.deck, bay.roof), 4.0 * m) - circle(0.4 * MOTOR * m)
    upright = standing(plate, (face, face + 6.0 * m))
    feet = union(
        box(
            sorted_span(side * half, side * (half - 6.0 * m)),
            (face - 26.0 * m, face + 1.0),
            (bay.deck, bay.deck + 5.0 * m),
        )
        + gusset(side, half, face, bay)
        for side in (-1.0, 1.0)
    )
    return upright + feet


def sorted_span(a: float, b: float) -> tuple[float, float]:
    """Return the two in order."""
    return min(a, b), max(a, b)


def gusset(side: float, half: float, face: float, bay: Bay) -> Manifold:
    """Return the triangle between a bracket and its foot."""
    m = bay.scale
    outline = CrossSection.batch_hull(
        [
            rectangle((face - 24.0 * m, face + 1.0), (bay.deck, bay.deck + 4.0 * m)),
            rectangle((face - 3.0 * m, face + 1.0), (bay.deck, bay.roof - 8.0 * m)),
        ]
    )
    x = sorted_span(side * half, side * (half - 3.5 * m))
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


def _dead_wheels(bay: Bay, body: Body, dead_wheels: tuple[Point, ...]) -> list[Drawing]:
    """Return small omni wheels below the lower deck, each on an arm, with its encoder."""
    radius = DEAD_WHEEL * bay.floor
    plan = replace(WheelPlan.usual(radius), rollers=6, sides=8)
    low = bay.deck - bay.plate
    arm_y = (plan.half_width + 1.0, plan.half_width + 4.0)
    height = -bay.floor + radius
    arm = CrossSection.batch_hull(
        [
            circle(0.36 * radius, (0.0, height)),
            rectangle((-0.5 * radius, 0.5 * radius), (low - 2.0, low + 0.5)),
        ]
    )
    arms = standing(arm, arm_y)
    at = (0.0, 0.0, height)
    encoder = rod(0.5 * radius, (arm_y[1], arm_y[1] + 0.7 * radius), "y", at)
    wheel = {d.name: d.solid.translate(at) for d in wheel_drawings(plan, body)}
    solids = {
        "tracker_arms": (arms, paint.frame(body)),
        "tracker_encoders": (encoder, paint.BLUE),
        "tracker_hubs": (
            rod(0.72 * radius, (-plan.half_width, plan.half_width), "y", at),
            paint.WHITE,
        ),
        "tracker_rollers": (wheel["rollers"], paint.RUBBER),
        "tracker_shafts": (wheel["shaft"], paint.STEEL),
    }
    return [
        Drawing(
            name,
            union(
                solid.rotate((0.0, 0.0, turn)).translate((x, y, 0.0)) for x, y, turn in dead_wheels
            ),
            material,
        )
        for name, (solid, material) in solids.items()
    ]
