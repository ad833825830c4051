"""Omni or Mecanum wheels with rollers, their gear motors, and the layout of a platform."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from manifold3d import CrossSection, Manifold

from tsd_twin.lie import Array
from tsd_twin.models import solids
from tsd_twin.models.solids import (
    Drawing,
    around,
    circle,
    polygon,
    rectangle,
    rod,
    slab,
    softened,
    strip_reach,
    tube,
    union,
)
from tsd_twin.robots.description import Body

_STRAIGHT_RAD = math.radians(20.0)
"""Rollers with smaller angles leave gaps that a second row must close."""
_GAP = 0.06
"""Air around a roller, relative to its radius."""


@dataclass(frozen=True, slots=True)
class WheelPlan:
    """Dimensions of an omni wheel, millimetres and radians."""

    radius: float
    """Distance from the axle to the floor."""
    roller_angle: float
    """Angle from the driving direction to the roller axis at the contact."""
    rollers: int
    """Number of rollers per row."""
    roller_radius: float
    """Maximum radius of a roller."""
    rows: tuple[float, ...]
    """Positions of the rows along the axle; with two, each closes the gaps of the other."""
    sides: int = 12
    """Number of sides of a roller; a multiple of four, so that a corner is on the rim."""

    @classmethod
    def usual(cls, radius: float, roller_angle: float = 0.0) -> WheelPlan:
        """Return a commercial wheel, whose rollers cover the whole rim."""
        if abs(roller_angle) < _STRAIGHT_RAD:
            thick = 0.135 * radius
            return cls(radius, roller_angle, 8, thick, (-1.15 * thick, 1.15 * thick))
        return cls(radius, roller_angle, 12, 0.135 * radius, (0.0,))

    @property
    def ring(self) -> float:
        """Radius of the circle through the roller centres."""
        return self.radius - self.roller_radius

    @property
    def half_angle(self) -> float:
        """Half angle about the axle that a roller covers."""
        return math.pi / self.rollers * (1.04 if len(self.rows) == 1 else 0.66)

    @property
    def half_width(self) -> float:
        """Half width of the wheel along its axle."""
        if len(self.rows) == 1:
            return self.slant + 0.055 * self.radius
        return max(self.rows) + 1.02 * self.roller_radius

    @property
    def half_length(self) -> float:
        """Half length of a roller axis."""
        return self.ring * math.tan(self.half_angle) / math.cos(self.roller_angle)

    @property
    def slant(self) -> float:
        """Half extent of a roller axis along the wheel's axle."""
        return self.half_length * abs(math.sin(self.roller_angle)) + 0.25 * self.roller_radius


def omni_wheel_drawings(plan: WheelPlan, body: Body) -> list[Drawing]:
    """Draw the wheel."""
    hub = _straight_hub(plan) if len(plan.rows) > 1 else _slanting_hub(plan)
    wide = plan.half_width
    bore = rod(0.09 * plan.radius, (-2.0 * wide, 2.0 * wide))
    boss = rod(0.2 * plan.radius, (-wide - 0.01 * plan.radius, wide + 0.02 * plan.radius))
    roller = _roller(plan, 0.0, plan.sides // 2 + 1)
    drawn_solids = [
        Drawing("hub", (hub + boss) - bore, solids.shell_material(body)),
        Drawing("rollers", _at_rollers(plan, roller), solids.RUBBER),
        Drawing("pins", _pins(plan), solids.STEEL),
        Drawing("shaft", _shaft(plan), solids.STEEL),
        Drawing("mark", _mark(plan), solids.WHITE),
    ]
    return [d._replace(solid=d.solid.rotate((-90.0, 0.0, 0.0))) for d in drawn_solids]


def roller_profile(plan: WheelPlan, stations: int) -> Array:
    """Return (stations, 2): radius of a roller, and position along its axis.

    The rim is a cylinder about the axle. A line normal to both rim and roller intersects both axes:
    it runs from a point on the roller axis, perpendicular to the axle, out to the rim.
    """
    along = np.linspace(-plan.half_length, plan.half_length, stations)
    c, s, h = math.cos(plan.roller_angle), math.sin(plan.roller_angle), plan.ring
    reach = np.hypot(along * c, h)
    x, y, z = plan.radius * along * c / reach, along * s, plan.radius * h / reach
    place = x * c + y * s
    return np.stack([np.hypot(np.hypot(x - place * c, y - place * s), z - h), place], axis=-1)


def _roller(plan: WheelPlan, grown: float, stations: int) -> Manifold:
    """Draw a roller along Z, with its surface offset outward by `grown`."""
    surface = roller_profile(plan, stations)
    surface[:, 0] += grown
    surface[[0, -1], 1] += (-grown, grown)
    low, high = surface[0, 1], surface[-1, 1]
    outline = polygon([(0.0, low), *((r, t) for r, t in surface.tolist()), (0.0, high)])
    return outline.revolve(plan.sides)


def _at_rollers(plan: WheelPlan, roller: Manifold) -> Manifold:
    """Copy a drawing along Z to the centre of every roller of every row."""
    tilted = roller.rotate((0.0, 90.0 - math.degrees(plan.roller_angle), 0.0))
    placed = tilted.translate((0.0, plan.ring, 0.0))
    step = 180.0 / plan.rollers
    return union(
        around(placed.translate((0.0, 0.0, z)), plan.rollers, step * row)
        for row, z in enumerate(plan.rows)
    )


def _pins(plan: WheelPlan) -> Manifold:
    """Draw the visible ends of the roller pins."""
    thin, end = 0.26 * plan.roller_radius, float(roller_profile(plan, 3)[-1, 1])
    ends = [
        rod(thin, (end, end + 0.5 * plan.roller_radius)),
        rod(thin, (-end - 0.5 * plan.roller_radius, -end)),
    ]
    return _at_rollers(plan, union(ends))


def _straight_hub(plan: WheelPlan) -> Manifold:
    """Draw a disc per row, with pockets for the rollers, and spokes."""
    gap = _GAP * plan.roller_radius
    pocket = _roller(plan, 2.0 * gap, 3)
    thick = 0.62 * plan.roller_radius
    disc = circle(plan.ring + 0.42 * plan.roller_radius)
    disc -= _windows(plan)
    discs = union(slab(disc, (z - thick, z + thick)) for z in plan.rows)
    core = rod(0.3 * plan.radius, (min(plan.rows), max(plan.rows)))
    return (discs + core) - _at_rollers(plan, pocket)


def _slanting_hub(plan: WheelPlan) -> Manifold:
    """Draw the two plates that hold the roller ends, and the drum between them."""
    inside, outside = plan.slant, plan.half_width
    ends = plan.ring / math.cos(plan.half_angle)
    plate = circle(ends + 0.02 * plan.roller_radius)
    plate -= _windows(plan)
    plates = [slab(plate, (inside, outside)), slab(plate, (-outside, -inside))]
    drum = rod(0.28 * plan.radius, (-inside - 0.5, inside + 0.5))
    pocket = _roller(plan, _GAP * plan.roller_radius, 5)
    return union([*plates, drum]) - _at_rollers(plan, pocket)


def _windows(plan: WheelPlan) -> CrossSection:
    """Return the lightening holes of a disc."""
    window = circle(0.13 * plan.radius, (0.0, 0.45 * plan.radius))
    return CrossSection.compose([window.rotate(60.0 * i) for i in range(6)])


def _shaft(plan: WheelPlan) -> Manifold:
    """Draw the shaft, which extends inboard to the gearbox, and the outboard nut."""
    wide, thin = plan.half_width, 0.085 * plan.radius
    nut = rod(1.9 * thin, (wide + 0.025 * plan.radius, wide + 0.1 * plan.radius), corners=6)
    return union([rod(thin, (-wide - 0.16 * plan.radius, wide + 0.06 * plan.radius)), nut])


def _mark(plan: WheelPlan) -> Manifold:
    """Draw a painted sector on the outboard face that makes rotation visible."""
    r = plan.radius
    face = plan.half_width if len(plan.rows) == 1 else max(plan.rows) + 0.62 * plan.roller_radius
    near, far = (0.32 * r, -0.04 * r), (0.72 * r, -0.09 * r)
    sector = polygon([near, far, (far[0], -far[1]), (near[0], -near[1])])
    return slab(sector, (face, face + 0.008 * r))


def motor_drawings(
    radius: float, length: float, at_wheels: Callable[[Manifold], Manifold]
) -> list[Drawing]:
    """Draw motors with gearbox and encoder, one per wheel.

    Args:
        radius: Radius of a motor.
        length: Total length of its parts.
        at_wheels: Copies a solid to its place at each wheel.
    """
    gearbox, motor = 0.3 * length, 0.58 * length
    square = 0.92 * radius
    face = rectangle((-square, square), (-square, square), 0.3 * radius)
    bolts = around(
        rod(0.09 * radius, (-0.6, 0.05 * radius), at=(0.72 * radius, 0.72 * radius, 0.0)), 4
    )
    box = slab(face, (-0.35 * gearbox, 0.0)) + rod(0.9 * radius, (-gearbox, -0.3 * gearbox))
    rim = tube(0.84 * radius, 1.2 * radius, (-0.72 * gearbox, -0.64 * gearbox))
    can = rod(radius, (-gearbox - motor, -gearbox))
    fins = union(
        tube(0.94 * radius, 1.1 * radius, (z, z + 0.06 * motor))
        for z in (-gearbox - share * motor for share in (0.34, 0.5, 0.66))
    )
    box_end = slab(
        rectangle((0.55 * radius, 1.06 * radius), (-0.3 * radius, 0.3 * radius), 1.0),
        (-gearbox - motor, -gearbox - 0.8 * motor),
    )
    cap = rod(0.72 * radius, (-length, -gearbox - motor + 0.5)) - rod(
        0.2 * radius, (-length - 1.0, -length + 1.0)
    )
    return [
        Drawing(name, at_wheels(solid.rotate((-90.0, 0.0, 0.0))), material)
        for name, solid, material in (
            ("motors", union([can - fins, box_end]), solids.BLACK),
            ("gearboxes", union([box - rim, bolts]), solids.STEEL),
            ("encoders", cap, solids.BLUE),
        )
    ]


NOMINAL_WHEEL = 76.2
"""Wheel radius of the motor drawings (6 inch wheels); other sizes are scaled."""
MOTOR = 29.0
"""Nominal radius of a 200 W motor."""
_TRAIN = 176.0
"""Nominal extent of motor, gearbox and encoder inboard of the bracket."""
_BRACKET = 14.0
"""Nominal distance between a wheel's inboard face and the far side of the bracket that holds the
gearbox."""


@dataclass(frozen=True, slots=True)
class Mount:
    """Pose of a wheel in `base_link`, millimetres and degrees."""

    x: float
    y: float
    axle_deg: float
    """Direction of the axle, outward."""
    plan: WheelPlan

    def in_base(self, solid: Manifold) -> Manifold:
        """Move a solid from the wheel frame (Y outboard along the axle, Z up) to the base."""
        return solid.rotate((0.0, 0.0, self.axle_deg - 90.0)).translate((self.x, self.y, 0.0))

    def outline_in_base(self, outline: CrossSection) -> CrossSection:
        """Move an outline from X and Y of the wheel frame to the base."""
        return outline.rotate(self.axle_deg - 90.0).translate((self.x, self.y))


@dataclass(frozen=True, slots=True)
class PlatformLayout:
    """Dimensions of a platform, millimetres in `base_link`, whose origin is at axle height."""

    mounts: tuple[Mount, ...]
    scale: float
    """Scale of motors and the parts bolted to them."""
    train: float
    """Length of motor, gearbox and encoder, shortened if motors would collide."""
    plate: float
    """Thickness of the decks."""
    outline: CrossSection
    """Outline of both decks."""

    @classmethod
    def of(cls, mounts: Sequence[Mount], plate: float) -> PlatformLayout:
        """Lay out a platform."""
        scale = min(mount.plan.radius for mount in mounts) / NOMINAL_WHEEL
        train = next(
            (
                share * _TRAIN * scale
                for share in (1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4)
                if _motors_fit(mounts, scale, share * _TRAIN * scale)
            ),
            0.3 * _TRAIN * scale,
        )
        return cls(tuple(mounts), scale, train, plate, _outline(mounts, scale))

    @property
    def floor(self) -> float:
        """Distance of the floor below the origin."""
        return self.mounts[0].plan.radius

    @property
    def deck(self) -> float:
        """Height of the lower deck's top, which supports the motors."""
        return -(MOTOR + 3.0) * self.scale

    @property
    def roof(self) -> float:
        """Height of the underside of the upper deck."""
        return (MOTOR + 7.0) * self.scale

    @property
    def top(self) -> float:
        """Height of the top of the upper deck."""
        return self.roof + self.plate

    def face(self, mount: Mount) -> float:
        """Return the inboard end of a wheel's bracket, along Y of the wheel."""
        return -mount.plan.half_width - _BRACKET * self.scale

    @property
    def middle(self) -> float:
        """Minimum radius of the decks."""
        return min(self.reach(10.0 * i) for i in range(36))

    def reach(self, direction_deg: float, width: float = 8.0) -> float:
        """Return the distance from the centre up to which a straight strip is on the decks."""
        return strip_reach(self.outline, direction_deg, width)


def _outline(mounts: Sequence[Mount], scale: float) -> CrossSection:
    """Return a polygon along the inboard faces of the wheels, which are outside or in a notch."""
    corners: list[CrossSection] = []
    notches: list[CrossSection] = []
    corner = circle(9.0 * scale)
    for mount in mounts:
        half = 0.72 * mount.plan.radius
        near = -mount.plan.half_width - 15.0 * scale
        corners += [
            mount.outline_in_base(corner.translate((side * half, near))) for side in (-1.0, 1.0)
        ]
        wide = mount.plan.half_width + 6.0 * scale
        long = mount.plan.radius + 8.0 * scale
        notches.append(mount.outline_in_base(rectangle((-long, long), (-wide, 9.0 * wide))))
    outline = CrossSection.batch_hull(corners)
    for notch in notches:
        outline -= notch
    pieces: list[Any] = softened(outline, 5.0 * scale).decompose()
    return max(pieces, key=lambda piece: piece.area())


def _motors_fit(mounts: Sequence[Mount], scale: float, train: float) -> bool:
    """Return whether motors of a length do not overlap."""
    prints: list[CrossSection] = []
    half = (MOTOR + 2.0) * scale
    for mount in mounts:
        near = -mount.plan.half_width - _BRACKET * scale
        prints.append(mount.outline_in_base(rectangle((-half, half), (near - train, near))))
    return all((a ^ b).area() < 1e-6 for a, b in itertools.combinations(prints, 2))
