"""Module of a singularity drive: hemispherical wheel with motor bell, and both gimbals."""

from __future__ import annotations

import math

from manifold3d import CrossSection, Manifold

from tsd_twin.models import singularity_layout, solids
from tsd_twin.models.singularity_layout import HORN, NOMINAL_WHEEL, RIB_IN, RIB_OUT, Layout
from tsd_twin.models.solids import (
    Drawing,
    Point,
    Span,
    around,
    circle,
    grown,
    polygon,
    rectangle,
    rod,
    sideways,
    slab,
    standing,
    tube,
    union,
)
from tsd_twin.robots.description import Body

_WHEEL_INSIDE = 37.0
"""Inner radius of the shell."""
_STRUTS = 6
_STRIPES = 3
_STRIPE_RAD = math.radians(9.0)
"""Half angle of a stripe."""
_POLE = 7.0
"""Radius about the axle without stripes."""
_SEGMENTS = 48
"""Segments per turn of the shell."""
_BELL = (13.0, 26.0)
"""Lower and upper end of the motor bell."""


def wheel_drawings(body: Body) -> list[Drawing]:
    """Draw the wheel."""
    plain, stripes = _shell()
    return [
        Drawing("shell", plain, solids.shell_material(body)),
        Drawing("stripes", stripes, solids.RUBBER),
        Drawing("spider", _spider(), solids.WHITE),
        Drawing("shaft", _shaft(), solids.STEEL),
        Drawing("bell", _bell(), solids.ANODISED),
        Drawing("mark", _mark(), solids.shell_material(body)),
    ]


def _shell() -> tuple[Manifold, Manifold]:
    """Draw the shell without its stripes, and the stripes; together they fill the hemisphere."""
    wall = CrossSection.circle(NOMINAL_WHEEL, 40) - CrossSection.circle(_WHEEL_INSIDE, 20)
    lip = rectangle((34.5, 38.0), (-2.4, 0.0))
    whole = ((wall + lip) ^ rectangle((0.0, 50.0), (-50.0, 0.0))).revolve(_SEGMENTS)
    # Leave out the pole, where sectors would share an edge, which solids do not allow.
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
    """Draw the hub, and the struts that hold the shell."""
    web = rectangle((0.0, _WHEEL_INSIDE), (-31.0, -5.0)) ^ circle(_WHEEL_INSIDE - 0.05)
    window = grown(polygon([(29.0, -11.0), (14.0, -11.0), (14.0, -22.0), (24.0, -18.0)]), 2.0)
    struts = around(standing(web - window, (-1.2, 1.2)), _STRUTS, 30.0)
    foot = rod(11.0, (-31.0, -27.0), tip=8.0)
    return union([struts, foot, rod(8.0, (-27.5, -3.0))])


def _shaft() -> Manifold:
    """Draw the shaft, with the nut that holds the bell."""
    return union(
        [rod(2.0, (-6.0, _BELL[1] + 4.0)), rod(4.0, (_BELL[1] + 0.02, _BELL[1] + 2.6), corners=6)]
    )


def _bell() -> Manifold:
    """Draw the motor bell, with slots in its face."""
    low, high = _BELL
    slot = grown(polygon([(8.5, -0.8), (11.8, -1.8), (11.8, 1.8), (8.5, 0.8)]), 1.0)
    slots = CrossSection.compose([slot.rotate(60.0 * turn) for turn in range(6)])
    face = circle(17.0) - circle(2.1) - slots
    return union([tube(15.6, 17.0, (low, high - 2.0)), slab(face, (high - 2.0, high))])


def _mark() -> Manifold:
    """Draw a painted sector on the bell that makes rotation visible."""
    sector = polygon([(4.6, -0.5), (16.2, -3.4), (16.2, 3.4), (4.6, 0.5)]).rotate(30.0)
    return slab(sector, (_BELL[1], _BELL[1] + 0.3))


BELT: Span = (54.6, 58.6)
"""Bounds of pulleys and belt along X."""
PULLEY = 7.0
"""Radius of the pulleys; the ratio between servo and frame is 1:1."""
_RING = (42.5, 46.0)
"""Inner and outer radius; the wheel's radius is 40."""
_ARMS: Span = (3.5, 8.5)
"""Bounds of the arms along Z, above the rim of the wheel."""


def inner_gimbal_drawings(body: Body) -> list[Drawing]:
    """Draw the inner frame and the stationary parts of the motor."""
    return [
        Drawing("frame", _inner_frame(), solids.frame_material(body)),
        Drawing("pins", _pins(), solids.STEEL),
        Drawing("stator", _stator(), solids.ANODISED),
        Drawing("windings", _windings(), solids.COPPER),
    ]


def _inner_frame() -> Manifold:
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
    """Draw pins with cap and nut, the driven pulley, and the screws of the motor."""
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
    """Draw the base of the motor, below the bell."""
    foot = around(slab(rectangle((-3.0, 12.5), (-3.0, 3.0), 2.5), (_ARMS[1], 10.0)), 4)
    return union([foot, rod(8.0, (_ARMS[1], 12.2))]) - rod(2.4, (0.0, 20.0))


def _windings() -> Manifold:
    """Draw the windings, visible through and below the slots of the bell."""
    tooth = rectangle((6.0, 15.0), (-2.2, 2.2), 1.0)
    plan = CrossSection.compose([circle(9.0), *(tooth.rotate(40.0 * turn) for turn in range(9))])
    return slab(plan - circle(2.4), (12.2, 23.0))


_INSIDE, _OUTSIDE = 49.5, 53.5
"""Half widths of the frame."""
_HUBS = (56.0, 57.0)
"""Extents of the hubs along Y, inboard and outboard."""
_SERVO_LOW = 33.0
"""Underside of the servo, which clears the motor at full tilt."""


def _shaft_of(servo: Point) -> tuple[float, float]:
    """Return Y and Z of the shaft of a servo of this size, whose case is centred."""
    return (HORN - 0.5) * servo[1], _SERVO_LOW + 0.5 * servo[0]


def _in_seat(solid: Manifold, servo: Point) -> Manifold:
    """Move a drawing of the servo behind the raised side of the frame, its shaft along X."""
    return solid.rotate((0.0, 90.0, 0.0)).translate((_INSIDE, *_shaft_of(servo)))


def outer_gimbal_drawings(layout: Layout, body: Body) -> list[Drawing]:
    """Draw the outer frame and the parts it carries."""
    width, length, depth = (side / layout.scale for side in layout.servo)
    servo = (width, length, depth)
    return [
        Drawing("frame", _outer_frame(servo), solids.frame_material(body)),
        Drawing("servo", _in_seat(singularity_layout.servo_case(servo), servo), solids.BLACK),
        Drawing("steel", _steel(servo, layout.plate / layout.scale), solids.STEEL),
        Drawing("belt", _belt(servo), solids.RUBBER),
    ]


def _outer_frame(servo: Point) -> Manifold:
    """Draw the square with seats and hubs, and the side that carries the servo."""
    plan = rectangle((-_OUTSIDE, _OUTSIDE), (-_OUTSIDE, _OUTSIDE), 32.0)
    plan -= rectangle((-_INSIDE, _INSIDE), (-_INSIDE, _INSIDE), 28.0)
    width, (y, z), waist = servo[0], _shaft_of(servo), 16.0
    crown = z + 0.5 * width
    side = polygon(
        [(-25.0, -5.0), (25.0, -5.0), (21.0, waist), (24.0, crown), (-24.0, crown), (-21.0, waist)]
    )
    side = grown(grown(side, -4.0), 4.0)
    side -= rectangle((-12.0, 12.0), (11.0, z - 0.45 * width), 4.0)
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
    shaft = rod(0.29 * width, (40.0, 60.0), "x", (0.0, y, z))
    return solid - union([rod(3.4, (-60.0, 60.0), "x"), shaft])


def _steel(servo: Point, plate: float) -> Manifold:
    """Draw bearings, the outboard axle, the inboard horn, the driving pulley, and screws."""
    horn = 0.26 * servo[0]
    end = _OUTSIDE + 0.9
    pulley = [rod(PULLEY, (_INSIDE + 0.5, BELT[1]), "x"), rod(9.0, (BELT[1], BELT[1] + 0.8), "x")]
    angles = [math.radians(angle) for angle in (45, 135, 225, 315)]
    spots = [(0.8 * horn * math.cos(angle), 0.8 * horn * math.sin(angle)) for angle in angles]
    return union(
        [
            tube(3.4, 6.0, (end - 4.0, end), "x"),
            tube(3.4, 6.0, (-end, 4.0 - end), "x"),
            rod(4.0, (_HUBS[1] - 1.0, RIB_OUT + plate + 2.5), "y"),
            union(pulley).translate((0.0, *_shaft_of(servo))),
            rod(horn, (0.6 - RIB_IN, -_HUBS[0]), "y"),
            rod(0.6 * horn, (0.3 - RIB_IN - plate, 1.0 - RIB_IN), "y"),
            *(rod(1.4, (-_HUBS[0], 1.0 - _HUBS[0]), "y", (x, 0.0, z), corners=6) for x, z in spots),
            _in_seat(singularity_layout.servo_fittings(servo), servo),
        ]
    )


def _belt(servo: Point) -> Manifold:
    """Draw the toothed belt from the servo to the inner frame."""
    ends = [circle(PULLEY + 1.4), circle(PULLEY + 0.3)]
    runs = [CrossSection.batch_hull([end, end.translate(_shaft_of(servo))]) for end in ends]
    return sideways(runs[0] - runs[1], (BELT[0] + 0.4, BELT[1] - 0.4))
