"""Model of a platform on omni or Mecanum wheels: decks, motors, parts, kinematic tree, masses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from manifold3d import CrossSection, Manifold, OpType

from tsd_twin.models import omni_wheel, solids
from tsd_twin.models.equipment import platform_equipment_drawings, spacer
from tsd_twin.models.links import (
    Cylinder,
    JointType,
    KinematicTree,
    Link,
    LinkGroup,
    about_z,
    chassis_mass_kg,
)
from tsd_twin.models.omni_wheel import MOTOR, Mount, PlatformLayout, WheelPlan, motor_drawings
from tsd_twin.models.solids import (
    Drawing,
    Parts,
    box,
    circle,
    drawn,
    rectangle,
    rod,
    sideways,
    slab,
    standing,
    union,
)
from tsd_twin.robots import OmniDescription
from tsd_twin.robots.description import Body


def platform_drawings(
    layout: PlatformLayout, body: Body, trackers: Sequence[Mount]
) -> list[Drawing]:
    """Draw the chassis and everything fixed to it; `trackers` are below the lower deck."""
    decks = [
        slab(layout.outline - _holes(layout, trackers), (layout.deck - layout.plate, layout.deck)),
        slab(layout.outline, (layout.roof, layout.top)),
    ]
    brackets = union(m.in_base(_bracket(layout, m)) for m in layout.mounts)
    return [
        Drawing("decks", union(decks), solids.acrylic_material(body)),
        *motor_drawings(MOTOR * layout.scale, layout.train, partial(_behind_brackets, layout)),
        Drawing("brackets", brackets, solids.frame_material(body)),
        Drawing("standoffs", _standoffs(layout), solids.STEEL),
        *platform_equipment_drawings(layout, body),
        *_trackers(layout, body, trackers),
    ]


def _behind_brackets(layout: PlatformLayout, solid: Manifold) -> Manifold:
    """Copy a motor to the bracket of every wheel."""
    return union(m.in_base(solid.translate((0.0, layout.face(m), 0.0))) for m in layout.mounts)


def _holes(layout: PlatformLayout, trackers: Sequence[Mount]) -> CrossSection:
    """Return the cutouts of the lower deck: for trackers, and in the middle to save weight."""
    reach = 0.16 * layout.middle
    hole = rectangle((-reach, reach), (-reach, reach), 0.3 * reach)
    slots: list[CrossSection] = []
    for one in trackers:
        r, wide = one.plan.radius, one.plan.half_width + 2.0
        slots.append(one.outline_in_base(rectangle((-r - 3.0, r + 3.0), (-wide, wide), 2.0)))
    return CrossSection.batch_boolean([hole, *slots], OpType.Add)


def _bracket(layout: PlatformLayout, mount: Mount) -> Manifold:
    """Draw the plate between a wheel and its gearbox, with feet and gussets on the deck."""
    m, face = layout.scale, layout.face(mount)
    half = 1.25 * MOTOR * m
    plate = rectangle((-half, half), (layout.deck + 0.3 * m, layout.roof), 4.0 * m)
    plate -= circle(0.4 * MOTOR * m)
    upright = standing(plate, (face, face + 6.0 * m))
    feet = union(
        box(
            _span(side * (half - 0.6 * m), side * (half - 6.0 * m)),
            (face - 26.0 * m, face + 2.3 * m),
            (layout.deck, layout.deck + 5.0 * m),
        )
        + _gusset(side, half, face, layout)
        for side in (-1.0, 1.0)
    )
    return upright + feet


def _span(a: float, b: float) -> tuple[float, float]:
    """Return two bounds in order."""
    return min(a, b), max(a, b)


def _gusset(side: float, half: float, face: float, layout: PlatformLayout) -> Manifold:
    """Draw the triangle between a bracket and its foot."""
    m = layout.scale
    outline = CrossSection.batch_hull(
        [
            rectangle(
                (face - 24.0 * m, face + 1.7 * m), (layout.deck + 0.6 * m, layout.deck + 4.0 * m)
            ),
            rectangle(
                (face - 3.0 * m, face + 1.7 * m), (layout.deck + 0.6 * m, layout.roof - 8.0 * m)
            ),
        ]
    )
    x = _span(side * (half - 1.2 * m), side * (half - 4.6 * m))
    return sideways(outline, x)


def _standoffs(layout: PlatformLayout) -> Manifold:
    """Draw hexagonal spacers between the decks, one per corner, with their screws."""
    m = layout.scale
    one = spacer(layout, 4.0, 4.2, 2.4)
    spots: list[tuple[float, float]] = []
    for mount in layout.mounts:
        turn = math.radians(mount.axle_deg - 90.0)
        for side in (-1.0, 1.0):
            x, y = side * 0.66 * mount.plan.radius, layout.face(mount) - 8.0 * m
            spots.append(
                (
                    mount.x + x * math.cos(turn) - y * math.sin(turn),
                    mount.y + x * math.sin(turn) + y * math.cos(turn),
                )
            )
    there = [spot for spot in spots if (circle(6.0 * m, spot) - layout.outline).area() < 1e-6]
    return union(one.translate((x, y, 0.0)) for x, y in there)


def _trackers(layout: PlatformLayout, body: Body, trackers: Sequence[Mount]) -> list[Drawing]:
    """Draw small omni wheels with encoders on arms below the lower deck."""
    if not trackers:
        return []
    plan = trackers[0].plan
    r = plan.radius
    low, height = layout.deck - layout.plate, r - layout.floor
    side = plan.half_width + 3.0
    arm = CrossSection.batch_hull(
        [circle(0.36 * r, (0.0, height)), rectangle((-0.5 * r, 0.5 * r), (low - 2.0, low + 0.5))]
    )
    at = (0.0, 0.0, height)
    wheel = {d.name: d.solid.translate(at) for d in omni_wheel.omni_wheel_drawings(plan, body)}
    wide = plan.half_width
    drawings = [
        Drawing("tracker_arms", standing(arm, (side, side + 3.0)), solids.frame_material(body)),
        Drawing("tracker_encoders", rod(0.5 * r, (side + 3.0, side + 13.0), "y", at), solids.BLUE),
        Drawing("tracker_hubs", rod(0.72 * r, (-wide, wide), "y", at), solids.WHITE),
        Drawing("tracker_rollers", wheel["rollers"], solids.RUBBER),
        Drawing("tracker_shafts", rod(0.1 * r, (-wide - 1.0, side + 1.0), "y", at), solids.STEEL),
    ]
    return [d._replace(solid=union(one.in_base(d.solid) for one in trackers)) for d in drawings]


def draw(robot: OmniDescription) -> Parts:
    """Draw the parts; wheels with equal roller angles share them."""
    layout = PlatformLayout.of(_mounts(robot), 1e3 * robot.body.plate_thickness_m)
    chassis = platform_drawings(layout, robot.body, _tracker_mounts(robot))
    parts: Parts = {"chassis": drawn("chassis", chassis)}
    for kind, rows in _kinds(robot).items():
        plan = layout.mounts[rows[0]].plan
        parts[kind] = drawn(kind, omni_wheel.omni_wheel_drawings(plan, robot.body))
    return parts


def tree(robot: OmniDescription) -> KinematicTree:
    """Return the wheels on the chassis: Y outboard along the axle, Z up.

    The forward axis of a wheel points left of its driving direction. Collision shapes are cylinders
    for the wheels, and one between them for the chassis.
    """
    mounts = _mounts(robot)
    radius_m = robot.drive.wheel_radius_m
    groups: list[LinkGroup] = []
    for kind, rows in _kinds(robot).items():
        own = [mounts[row] for row in rows]
        names = tuple(f"wheel{row + 1}" for row in rows)
        groups.append(
            LinkGroup(
                kind,
                tuple(f"{name}_link" for name in names),
                names,
                "chassis",
                np.array([[1e-3 * mount.x, 1e-3 * mount.y, 0.0] for mount in own]),
                about_z(np.radians([mount.axle_deg - 90.0 for mount in own])),
                JointType.SPIN,
                np.array([[0.0, _outboard(robot, row), 0.0] for row in rows]),
                collision=Cylinder(radius_m, 2e-3 * own[0].plan.half_width),
            )
        )
    inside = min(math.hypot(mount.x, mount.y) - mount.plan.half_width for mount in mounts)
    return KinematicTree(
        radius_m, tuple(groups), max(0.0, 1e-3 * 0.7 * (inside - mounts[0].plan.radius))
    )


def masses_kg(robot: OmniDescription) -> dict[Link, float]:
    """Return the mass of each kind of link; the chassis has the remainder."""
    mass, wheels_kg = robot.mass, len(robot.drive.wheels) * robot.mass.wheel_kg
    chassis_kg = chassis_mass_kg(
        robot, mass.total_kg, wheels_kg, "wheels", "mass.wheel_kg for each wheel"
    )
    return {"chassis": chassis_kg, **dict.fromkeys(_kinds(robot), mass.wheel_kg)}


def _kinds(robot: OmniDescription) -> dict[Link, list[int]]:
    """Return the kinds of wheels with their wheel indices: one kind per roller angle."""
    angles = list(dict.fromkeys(wheel.roller_deg for wheel in robot.drive.wheels))
    return {
        "wheel" if number == 0 else f"wheel_{chr(ord('a') + number)}": [
            i for i, wheel in enumerate(robot.drive.wheels) if wheel.roller_deg == angle
        ]
        for number, angle in enumerate(angles)
    }


def _outboard(robot: OmniDescription, row: int) -> float:
    """Return 1 if a wheel's forward axis points away from the centre, else -1."""
    wheel = robot.drive.wheels[row]
    left = math.radians(wheel.direction_deg + 90.0)
    away = wheel.x_m * math.cos(left) + wheel.y_m * math.sin(left)
    return 1.0 if away >= 0.0 else -1.0


def _tracker_mounts(robot: OmniDescription) -> list[Mount]:
    dead = robot.dead_wheels
    if dead is None:
        return []
    plan = replace(WheelPlan.usual(1e3 * dead.radius_m), rollers=6, sides=8)
    return [
        Mount(1e3 * wheel.x_m, 1e3 * wheel.y_m, wheel.direction_deg + 90.0, plan)
        for wheel in dead.wheels
    ]


def _mounts(robot: OmniDescription) -> list[Mount]:
    return [
        Mount(
            1e3 * wheel.x_m,
            1e3 * wheel.y_m,
            wheel.direction_deg + 90.0 * _outboard(robot, row),
            WheelPlan.usual(1e3 * robot.drive.wheel_radius_m, math.radians(wheel.roller_deg)),
        )
        for row, wheel in enumerate(robot.drive.wheels)
    ]
