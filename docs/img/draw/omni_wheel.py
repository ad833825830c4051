"""Wheel with rollers from above: position, driving direction and roller axle."""

from __future__ import annotations

import math

import numpy as np
from svg import BLUE, GREEN, GREY, INK, ORANGE, PALE, RED, Point, Sheet, polar

from tsd_twin.kinematics import OmniKinematics
from tsd_twin.robots import load_robot

SCALE = 620.0  # Pixels a metre.
ROBOTS = (
    ("omni4", "omni4: psi = 0"),
    ("kiwi", "kiwi: psi = 0"),
    ("mecanum", "mecanum: psi = ±45°"),
)


def draw() -> str:
    """Return one wheel with its angles, and the shipped platforms as they are described."""
    sheet = Sheet(980, 520, "Wheels with rollers from above")
    sheet.text((24, 34), "Seen from above: X up, Y to the left", size=17, anchor="start", style="b")
    _one(sheet, (130.0, 420.0), (430.0, 190.0))
    sheet.text((820, 34), "driven wheels and the rollers on the floor", size=13, colour=ORANGE)
    for row, (name, words) in enumerate(ROBOTS):
        centre = (820.0, 118.0 + 158.0 * row)
        _robot(sheet, load_robot(name).kinematics(), centre, words.replace("psi", "ψ"))
    return sheet.svg()


def _one(sheet: Sheet, origin: Point, wheel: Point) -> None:
    """Draw a wheel in front and to the right, with lambda, alpha, l and psi."""
    out = math.degrees(math.atan2(origin[1] - wheel[1], wheel[0] - origin[0]))
    for name, angle, colour in (("X", 90.0, RED), ("Y", 180.0, GREEN)):
        tip = polar(origin, 110 if name == "X" else 90, angle)
        sheet.line([origin, tip], colour=colour, width=2.5, arrow=True)
        sheet.text(
            (tip[0] + (16 if name == "X" else -14), tip[1] + 6), name, colour=colour, size=16
        )
    sheet.line([origin, polar(wheel, 120, out)], colour=GREY, dash="5 4")
    sheet.circle(origin, 4, colour=BLUE, fill=BLUE)
    sheet.arc(origin, 70, 90, out, arrow=True)
    label = polar(origin, 92, (90 + out) / 2)
    sheet.text((label[0], label[1] + 5), "−λ", size=18, style="i")
    middle = ((origin[0] + wheel[0]) / 2 + 10, (origin[1] + wheel[1]) / 2 + 26)
    sheet.text(middle, "l", size=18, style="i")
    axle = out + 25.0
    drive = axle - 90.0
    _bar(sheet, wheel, drive, 62, 24, ORANGE, "#fff4ec")
    sheet.line([polar(wheel, 70, axle + 180), polar(wheel, 112, axle)], colour=INK, dash="2 4")
    sheet.arc(wheel, 100, out, axle, arrow=True)
    alpha = polar(wheel, 120, (out + axle) / 2)
    sheet.text((alpha[0] + 4, alpha[1] + 4), "α", size=18, style="i")
    sheet.line([wheel, polar(wheel, 130, drive)], colour=ORANGE, width=3, arrow=True)
    end = polar(wheel, 150, drive)
    sheet.text((end[0] + 4, end[1] + 12), "drives: r φ'", size=14, colour=ORANGE)
    roller = drive + 40.0
    sheet.line([wheel, polar(wheel, 130, roller)], colour=BLUE, width=3, arrow=True)
    end = polar(wheel, 146, roller)
    sheet.text((end[0] + 8, end[1]), "roller's axle: holds", size=14, colour=BLUE, anchor="start")
    free = [polar(wheel, 78, roller + 90.0 + turn) for turn in (0.0, 180.0)]
    sheet.line(free, colour=GREY, width=2, dash="7 5")
    sheet.text(
        (free[0][0] - 6, free[0][1] - 12), "rolls freely", size=13, colour=GREY, anchor="end"
    )
    sheet.arc(wheel, 84, drive, roller, arrow=True)
    psi = polar(wheel, 104, drive + 18.0)
    sheet.text((psi[0] + 2, psi[1] + 5), "ψ", size=18, style="i")


def _robot(sheet: Sheet, drive: OmniKinematics, centre: Point, words: str) -> None:
    reach = float(np.hypot(*drive.positions_m.T).max())
    scale = 46.0 / reach
    sheet.circle(centre, 46.0, colour=PALE, width=2)
    for (x, y), direction, roller in zip(
        drive.positions_m, drive.directions_rad, drive.rollers_rad, strict=True
    ):
        at = (centre[0] - scale * float(y), centre[1] - scale * float(x))
        along = 90.0 + math.degrees(float(direction))
        _bar(sheet, at, along, 15, 6, ORANGE, "#fff4ec")
        sheet.line([at, polar(at, 30, along)], colour=ORANGE, width=2, arrow=True)
        held = along + math.degrees(float(roller))
        sheet.line([polar(at, 11, held), polar(at, 11, held + 180.0)], colour=BLUE, width=2.5)
    sheet.text((centre[0], centre[1] + 78), words, size=13)


def _bar(
    sheet: Sheet, at: Point, along: float, half: float, wide: float, colour: str, fill: str
) -> None:
    """Draw a rectangle whose long side points `along`, degrees on the page."""
    corners = []
    for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1), (1, 1)):
        x, y = polar(at, a * half, along)
        corners.append(polar((x, y), b * wide, along + 90.0))
    sheet.line(corners, colour=colour, width=2, fill=fill)
