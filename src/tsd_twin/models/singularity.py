"""Model of a singularity drive: chassis (decks, ribs, servos, equipment), tree, masses."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import fmean

import numpy as np
from manifold3d import CrossSection, Manifold

from tsd_twin.lie import SO3
from tsd_twin.models import equipment, singularity_gimbals, solids
from tsd_twin.models.links import (
    JointLimits,
    JointType,
    KinematicTree,
    Link,
    LinkGroup,
    Sphere,
    about_z,
    alike,
    chassis_mass_kg,
)
from tsd_twin.models.singularity_layout import (
    HORN,
    RIB_IN,
    RIB_OUT,
    RIM,
    Layout,
    half_gap_deg,
    servo_case,
    servo_fittings,
)
from tsd_twin.models.solids import (
    Drawing,
    Parts,
    circle,
    drawn,
    polygon,
    rectangle,
    slab,
    standing,
    tube,
    union,
)
from tsd_twin.robots import RPM, SingularityDescription
from tsd_twin.robots.description import Body

_TAB_HEIGHT = 0.8
"""Height of tabs above the upper deck."""


@dataclass(frozen=True, slots=True)
class Rib:
    """Sheet part with tabs that cut their own slots, so that they always fit."""

    face: CrossSection
    """Outline between the decks: X along the rib, Y up."""
    low: tuple[float, ...]
    """Positions of the lower tabs along X."""
    high: tuple[float, ...]
    """Positions of the upper tabs along X."""
    tab: float
    """Width of a tab."""
    x: float
    y: float
    turn_deg: float
    """Position of the origin in `base_link`, and rotation of X; the sheet is on its right side."""

    def solid(self, layout: Layout) -> Manifold:
        """Return the rib with its tabs, in `base_link`."""
        face = self.face
        for at in self.low:
            face += self._tab(at, (layout.floor, layout.deck + 0.5))
        for at in self.high:
            face += self._tab(at, (layout.roof - 0.5, layout.top + _TAB_HEIGHT))
        sheet = standing(face, (-layout.plate, 0.0)).rotate((0.0, 0.0, self.turn_deg))
        return sheet.translate((self.x, self.y, 0.0))

    def slots(self, layout: Layout, tabs: tuple[float, ...]) -> CrossSection:
        """Return the slots that `tabs` cut into a deck, in `base_link`."""
        cuts = [self._tab(at, (-layout.plate, 0.0)) for at in tabs]
        return CrossSection.compose(cuts).rotate(self.turn_deg).translate((self.x, self.y))

    def _tab(self, at: float, across: tuple[float, float]) -> CrossSection:
        return rectangle((at - 0.5 * self.tab, at + 0.5 * self.tab), across)


def ribs(layout: Layout) -> list[Rib]:
    """Return all ribs: four at each module, and one on each lobe between modules."""
    standing_ribs: list[Rib] = []
    for azimuth in layout.azimuths_deg:
        standing_ribs += [_inboard(layout, azimuth), *_outboard(layout, azimuth)]
    return standing_ribs + [rib for a in layout.lobes_deg for rib in _lobe(layout, a)]


def _at_module(layout: Layout, azimuth_deg: float, x: float, y: float) -> tuple[float, float]:
    """Convert a point from a module frame to `base_link`."""
    c, s = math.cos(math.radians(azimuth_deg)), math.sin(math.radians(azimuth_deg))
    return (layout.pivot + y) * c + x * s, (layout.pivot + y) * s - x * c


def _inboard(layout: Layout, azimuth_deg: float) -> Rib:
    """Return the rib for a servo, as long as its neighbours allow."""
    m, t = layout.scale, layout.plate
    inner = layout.pivot - RIB_IN * m - t
    reach = min(62.0 * m, 0.92 * inner * math.tan(math.radians(half_gap_deg(layout.azimuths_deg))))
    width, length, _ = layout.servo
    face = rectangle((-reach, reach), (layout.deck, layout.roof)) - circle(0.3 * width)
    # Add windows where the case leaves room; its long end is at negative X.
    for near, side in (((1.0 - HORN) * length, -1.0), (HORN * length, 1.0)):
        if reach - near > 14.0 * m:
            span = sorted((side * (near + 3.0 * m), side * (reach - 5.0 * m)))
            window = (0.7 * layout.deck, 0.7 * layout.roof)
            face -= rectangle((span[0], span[1]), window, 3.0 * m)
    tabs = (-0.72 * reach, 0.72 * reach)
    x, y = _at_module(layout, azimuth_deg, 0.0, -RIB_IN * m)
    return Rib(face, tabs, tabs, 0.3 * reach, x, y, azimuth_deg - 90.0)


def _outboard(layout: Layout, azimuth_deg: float) -> list[Rib]:
    """Return the bearing block and its two gussets."""
    m, t, low = layout.scale, layout.plate, layout.deck
    foot = 34.0 * m
    block = CrossSection.batch_hull(
        [circle(13.0 * m), rectangle((-foot, foot), (low, low + 3.0 * m))]
    )
    x, y = _at_module(layout, azimuth_deg, 0.0, RIB_OUT * m + t)
    bearing = circle(8.0 * m)
    tabs = (-0.72 * foot, 0.72 * foot)
    pieces = [Rib(block - bearing, tabs, (), 0.36 * foot, x, y, azimuth_deg - 90.0)]
    edge = (15.0 * m, low + 3.0 * m)
    # Overlap the block by half, because sheets that only touch do not form one solid.
    gusset = polygon(
        [(-0.5 * t, low), (edge[0], low), edge, (4.0 * m, -3.0 * m), (-0.5 * t, -3.0 * m)]
    )
    for side in (-1.0, 1.0):
        x, y = _at_module(layout, azimuth_deg, side * 13.0 * m - 0.5 * t, RIB_OUT * m + t)
        pieces.append(Rib(gusset, (8.0 * m,), (), 7.0 * m, x, y, azimuth_deg))
    return pieces


def _lobe(layout: Layout, lobe_deg: float) -> list[Rib]:
    """Return the rib along the middle of a lobe, from behind the servos to near its end."""
    m, t = layout.scale, layout.plate
    start = math.hypot(layout.core, (1.0 - HORN) * layout.servo[1]) + t
    span = layout.reach(lobe_deg, 12.0 * m + t) - 14.0 * m - start
    if span < 30.0 * m:
        return []
    window = rectangle((0.0, 0.22 * span), (0.6 * layout.deck, 0.6 * layout.roof), 4.0 * m)
    face = rectangle((0.0, span), (layout.deck, layout.roof))
    face -= window.translate((0.2 * span, 0.0)) + window.translate((0.58 * span, 0.0))
    c, s = math.cos(math.radians(lobe_deg)), math.sin(math.radians(lobe_deg))
    x, y = start * c - 0.5 * t * s, start * s + 0.5 * t * c
    tabs = (0.12 * span, 0.88 * span)
    return [Rib(face, tabs, tabs, 0.14 * span, x, y, lobe_deg)]


def chassis_drawings(layout: Layout, body: Body) -> list[Drawing]:
    """Draw the chassis and everything fixed to it."""
    standing = ribs(layout)
    lower, upper = layout.lower_deck, layout.upper_deck
    for rib in standing:
        lower -= rib.slots(layout, rib.low)
        upper -= rib.slots(layout, rib.high)
    floor, roof = (layout.floor, layout.deck), (layout.roof, layout.top)
    sheet = solids.acrylic_material(body)
    return [
        Drawing("decks", union([slab(lower, floor), slab(upper, roof)]), sheet),
        Drawing("ribs", union(rib.solid(layout) for rib in standing), sheet),
        *_joint_drawings(layout),
        *equipment.module_equipment_drawings(layout, body),
    ]


def _joint_drawings(layout: Layout) -> list[Drawing]:
    """Draw the bearings in the outboard ribs, and the servos behind the inboard ribs."""
    m = layout.scale
    along = (RIB_OUT * m - 0.6, RIB_OUT * m + layout.plate + 0.6)
    bearing = tube(4.3 * m, 8.0 * m, along, "y")
    # Shafts point outward, and the long end of the cases to -X of the module.
    case, fittings = (
        solid.rotate((0.0, 0.0, 90.0))
        .rotate((-90.0, 0.0, 0.0))
        .translate((0.0, -RIB_IN * m - layout.plate, 0.0))
        for solid in (servo_case(layout.servo), servo_fittings(layout.servo))
    )
    return [
        Drawing("bearings", layout.at_modules(bearing), solids.STEEL),
        Drawing("servos", layout.at_modules(case), solids.BLACK),
        Drawing("fittings", layout.at_modules(fittings), solids.STEEL),
    ]


_FOOT, _BELOW = 22.0, 14.0
"""Nominal half width of a hanger, and its reach below the gimbal axis."""


def hanging_chassis_drawings(robot: SingularityDescription, layout: Layout) -> list[Drawing]:
    """Draw a chassis for pivots at any positions: a deck above the modules, with hangers."""
    m, t, top = layout.scale, layout.plate, layout.top
    pivots = [(1e3 * p.x_m, 1e3 * p.y_m) for p in robot.drive.positions]
    outline = CrossSection.batch_hull([circle(RIM * m, at) for at in pivots])
    hanger = rectangle((-_FOOT * m, _FOOT * m), (-_BELOW * m, layout.roof + 0.5))
    inboard = standing(hanger - circle(0.3 * layout.servo[0]), (-RIB_IN * m - t, -RIB_IN * m))
    outboard = standing(hanger - circle(8.0 * m), (RIB_OUT * m, RIB_OUT * m + t))
    sheet = solids.acrylic_material(robot.body)
    x, y = fmean(x for x, _ in pivots), fmean(y for _, y in pivots)
    battery = solids.box(
        (x - 50.0 * m, x + 10.0 * m), (y - 20.0 * m, y + 20.0 * m), (top, top + 25.0 * m)
    )
    return [
        Drawing("decks", slab(outline, (layout.roof, top)), sheet),
        Drawing("ribs", layout.at_modules(inboard + outboard), sheet),
        *_joint_drawings(layout),
        Drawing("battery", battery, solids.BLUE),
        equipment.heading_arrow(robot.body, (x + 60.0 * m, y, top), m),
    ]


_AXES = {"beta": (0.0, 1.0, 0.0), "alpha": (-1.0, 0.0, 0.0), "wheel": (0.0, 0.0, 1.0)}
_REACH = 1.6
"""Inboard reach of a module from its pivot, in wheel radii, observed by the drawings."""


def check_room(robot: SingularityDescription) -> None:
    """Check that the modules fit.

    Raises:
        RobotFileError: If there is no room for the modules.
    """
    Layout.of(robot)


def draw(robot: SingularityDescription) -> Parts:
    """Draw the parts; all modules share `outer`, `inner` and `wheel`."""
    body, layout = robot.body, Layout.of(robot)
    if robot.drive.positions:
        chassis = hanging_chassis_drawings(robot, layout)
    else:
        chassis = chassis_drawings(layout, body)
    modules: dict[Link, list[Drawing]] = {
        "outer": singularity_gimbals.outer_gimbal_drawings(layout, body),
        "inner": singularity_gimbals.inner_gimbal_drawings(body),
        "wheel": singularity_gimbals.wheel_drawings(body),
    }
    parts: Parts = {"chassis": drawn("chassis", chassis)}
    m = layout.scale
    for link, drawings in modules.items():
        scaled = [drawing._replace(solid=drawing.solid.scale([m, m, m])) for drawing in drawings]
        parts[link] = drawn(link, scaled)
    return parts


def tree(robot: SingularityDescription) -> KinematicTree:
    """Return gimbals in the pivots: Y outward, X tangential, Z up at neutral tilt.

    l = Ry(beta) Rx(-alpha) z: Eq. 24 and 25 of the thesis. Wheels collide as spheres, their exact
    shape at the contact; frames do not collide.
    """
    g = robot.drive
    azimuths, k = np.radians(g.directions_deg), g.modules
    pivots = np.column_stack([g.pivots_m, np.zeros(k)])
    tilt = JointLimits(
        float(np.radians(g.max_tilt_deg)),
        robot.servo.no_load_speed_rpm * RPM,
        robot.servo.stall_torque_nm,
    )

    def group(kind: Link, joint: str, parent: Link, hinge: JointType) -> LinkGroup:
        own = parent == "chassis"
        return LinkGroup(
            kind,
            tuple(f"module{i + 1}_{kind}" for i in range(k)),
            tuple(f"module{i + 1}_{joint}" for i in range(k)),
            parent,
            pivots if own else np.zeros((k, 3)),
            about_z(azimuths - 0.5 * np.pi) if own else SO3.identity((k,)),
            hinge,
            alike(_AXES[joint], k),
            tilt if hinge is JointType.ANGLE else None,
            Sphere(g.wheel_radius_m) if kind == "wheel" else None,
        )

    inside = float(np.min(g.pivot_radii_m)) - _REACH * g.wheel_radius_m
    return KinematicTree(
        g.wheel_radius_m,
        (
            group("outer", "beta", "chassis", JointType.ANGLE),
            group("inner", "alpha", "outer", JointType.ANGLE),
            group("wheel", "wheel", "inner", JointType.SPIN),
        ),
        max(0.0, inside),
    )


def masses_kg(robot: SingularityDescription) -> dict[Link, float]:
    """Return the mass of each kind of link; the chassis has the remainder."""
    mass = robot.mass
    modules = robot.drive.modules * (mass.wheel_kg + 2.0 * mass.gimbal_kg)
    needed = "mass.wheel_kg and twice mass.gimbal_kg for each wheel"
    return {
        "chassis": chassis_mass_kg(robot, mass.total_kg, modules, "modules", needed),
        "outer": mass.gimbal_kg,
        "inner": mass.gimbal_kg,
        "wheel": mass.wheel_kg,
    }
