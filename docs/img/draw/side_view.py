"""One module from two sides: gimbal, tilted hemisphere, contact with the floor."""

from __future__ import annotations

import math
from dataclasses import dataclass

from svg import AMBER, BLUE, GREEN, GREY, INK, ORANGE, PALE, RED, Point, Sheet, polar

RADIUS = 130.0
TILT_DEG = 24.0  # Within the limit of the drive, and large enough to be seen.
AXLE_DEG = 90.0 - TILT_DEG


@dataclass(frozen=True)
class Side:
    """Differences between the two views."""

    centre: Point
    title: str
    angle: str
    right: tuple[str, str, str]
    depth: tuple[str, str, bool]
    """Name and colour of the axis across the page, and whether it points to the reader."""
    bar: str
    formulas: str


SIDES = (
    Side(
        centre=(245.0, 250.0),
        title="α: the inner gimbal tips the axle outward",
        angle="α",
        right=("Y", GREEN, "outward; axis of\nthe outer gimbal"),
        depth=("X", RED, True),
        bar="inner gimbal",
        formulas="β = 0:  l = (0, sin α, cos α)\nv = (r_w ω_d sin α, 0): to the reader",
    ),
    Side(
        centre=(735.0, 250.0),
        title="β: the outer gimbal tips the axle along the tangent",
        angle="β",
        right=("X", RED, "tangent; axis of the\ninner gimbal at β = 0"),
        depth=("Y", GREEN, False),
        bar="outer gimbal",
        formulas="α = 0:  l = (sin β, 0, cos β)\nv = (0, −r_w ω_d sin β): to the reader",
    ),
)


def draw() -> str:
    """Return the drawing."""
    sheet = Sheet(980, 510, "Side views of a tilted module")
    for side in SIDES:
        _view(sheet, side)
    sheet.line([(490, 24), (490, 486)], colour=PALE)
    return sheet.svg()


def _view(sheet: Sheet, side: Side) -> None:
    x, y = side.centre
    floor = y + RADIUS
    sheet.text((x, 36), side.title, size=15, style="b")
    sheet.line([(x - 210, floor), (x + 210, floor)], width=2)
    sheet.text((x - 206, floor + 18), "floor", size=12, colour=GREY, anchor="start")
    sheet.circle(side.centre, RADIUS, colour=PALE)
    _hemisphere(sheet, side)
    _axes(sheet, side)
    _gimbal(sheet, side)
    _axle(sheet, side)
    _contact(sheet, side)
    sheet.text((x, floor + 60), side.formulas, size=15)


def _hemisphere(sheet: Sheet, side: Side) -> None:
    """Draw the half of the sphere below the plane across the axle."""
    (x0, y0), (x1, y1) = (polar(side.centre, RADIUS, AXLE_DEG + turn) for turn in (90, 270))
    path = f"M{x0:.1f},{y0:.1f} A{RADIUS:g},{RADIUS:g} 0 0 0 {x1:.1f},{y1:.1f} z"
    sheet.path(path, colour=ORANGE, width=2.5, fill="#fff4ec")


def _axes(sheet: Sheet, side: Side) -> None:
    x, y = side.centre
    name, colour, words = side.right
    sheet.line([side.centre, (x + 195, y)], colour=colour, width=2, arrow=True)
    sheet.text((x + 208, y + 5), name, size=15, colour=colour, style="b")
    sheet.text((x + 224, y - 30), words, size=12, colour=colour, anchor="end")
    sheet.line([side.centre, (x, y - RADIUS - 44)], colour=BLUE, width=2, arrow=True)
    sheet.text((x - 14, y - RADIUS - 38), "Z", size=15, colour=BLUE, style="b")


def _gimbal(sheet: Sheet, side: Side) -> None:
    """Draw the tilted gimbal edge-on, and the axis that it turns about end-on."""
    x, y = side.centre
    ends = [polar(side.centre, 74, AXLE_DEG + turn) for turn in (90, -90)]
    sheet.line(ends, colour=AMBER, width=6)
    sheet.text((x - 122, y - 64), side.bar, size=13, colour=AMBER)
    name, colour, near = side.depth
    sheet.circle(side.centre, 9, colour=colour, fill="#fff", width=2)
    if near:
        sheet.circle(side.centre, 2.5, colour=colour, fill=colour)
    else:
        for turn in (45, 135):
            cross = [polar(side.centre, 9, turn), polar(side.centre, 9, turn + 180)]
            sheet.line(cross, colour=colour, width=2)
    sheet.text((x + 30, y - 8), name, size=15, colour=colour, style="b")


def _axle(sheet: Sheet, side: Side) -> None:
    start = polar(side.centre, 12, AXLE_DEG)
    sheet.line([start, polar(side.centre, RADIUS + 50, AXLE_DEG)], width=3, arrow=True)
    tip = polar(side.centre, RADIUS + 66, AXLE_DEG)
    sheet.text((tip[0], tip[1] + 6), "l", size=19, style="bi")
    sheet.arc(side.centre, 88, 90, AXLE_DEG, colour=INK, arrow=True)
    middle = polar(side.centre, 106, 90 - 0.45 * TILT_DEG)
    sheet.text((middle[0], middle[1] + 5), side.angle, size=17, style="i")
    # The near side of the wheel moves to the right: counter-clockwise from above.
    (x0, y0), (x1, y1) = (polar(side.centre, RADIUS + 24, AXLE_DEG + turn) for turn in (9, -9))
    path = f"M{x0:.1f},{y0:.1f} A22,9 {TILT_DEG:g} 1 0 {x1:.1f},{y1:.1f}"
    sheet.path(path, colour=ORANGE, width=2, arrow=True)
    sheet.text((x1 + 24, y1 + 8), "ω_d", size=15, colour=ORANGE, style="i")


def _contact(sheet: Sheet, side: Side) -> None:
    """Draw the contact, and its lever about the axle: the effective radius."""
    x, y = side.centre
    floor = y + RADIUS
    foot = polar(side.centre, RADIUS * math.cos(math.radians(TILT_DEG)), AXLE_DEG + 180)
    sheet.line([polar(side.centre, 12, AXLE_DEG + 180), foot], dash="6 4")
    sheet.line([(x, y + 12), (x, floor)], colour=GREY, dash="2 3")
    sheet.line([(x, floor), foot], colour=ORANGE, width=3)
    sheet.text((x + 14, floor - 52), "r_w", size=15, colour=GREY, style="i", anchor="start")
    sheet.circle((x, floor), 4.5, colour=ORANGE, fill=ORANGE)
    sheet.text((x + 6, floor + 20), "contact", size=12, colour=ORANGE, anchor="start")
    sheet.line([(x - 62, floor + 26), (x - 26, floor - 8)], colour=ORANGE, width=1)
    words = f"r_w sin {side.angle}"
    sheet.text((x - 66, floor + 34), words, size=14, colour=ORANGE, style="i", anchor="end")
