"""The singularity drive from above: frames, azimuths, and which way the axles lean."""

from __future__ import annotations

import math

import numpy as np
from svg import BLUE, GREEN, GREY, INK, ORANGE, PALE, RED, Point, Sheet, polar

from tsd_twin.kinematics import SingularityKinematics
from tsd_twin.lie import Array
from tsd_twin.robots import load_robot

SCALE = 1250.0  # Pixels a metre.
CASES = (
    ("forward: all tilt left", [1.0, 0.0, 0.0]),
    ("to the left: all tilt back", [0.0, 1.0, 0.0]),
    ("turning left: all tilt inward", [0.0, 0.0, 7.0]),
)


def draw() -> str:
    """Draw the shipped robot from its description."""
    drive = load_robot("tsd").kinematics()
    sheet = Sheet(980, 640, "Top view of the triple singularity drive")
    _frames(sheet, drive, (330.0, 350.0))
    sheet.text((820, 34), "horizontal part of the axle, for", size=13, colour=ORANGE)
    for row, (words, twist) in enumerate(CASES):
        _tilt(sheet, drive, (820.0, 130.0 + 196.0 * row), words, np.array(twist))
    return sheet.svg()


def _page(centre: Point, metres: Array, scale: float = SCALE) -> Point:
    """Return where a point of the robot frame lies: X is up, Y to the left."""
    return centre[0] - scale * float(metres[1]), centre[1] - scale * float(metres[0])


def _frames(sheet: Sheet, drive: SingularityKinematics, centre: Point) -> None:
    sheet.text((24, 34), "Seen from above", size=17, anchor="start", style="b")
    note = "Z towards the reader, wheels spin counter-clockwise"
    sheet.text((24, 56), note, size=12, colour=GREY, anchor="start")
    pivots = [_page(centre, pivot) for pivot in drive.pivots_m]
    for pivot in pivots[1:]:
        sheet.line([centre, pivot], colour=GREY, dash="5 4")
    sheet.circle(centre, SCALE * drive.pivot_radius_m, colour=PALE, width=2)
    for i, azimuth in enumerate(drive.azimuths_rad):
        _module(sheet, drive, pivots[i], float(azimuth), i)
    for name, axis, colour in (("X", [0.11, 0.0], RED), ("Y", [0.0, 0.08], GREEN)):
        tip = _page(centre, np.array(axis))
        sheet.line([centre, tip], colour=colour, width=2.5, arrow=True)
        sheet.text((tip[0] - 16, tip[1] + 16), name, size=16, colour=colour, style="b")
    sheet.circle(centre, 4, colour=BLUE, fill=BLUE)
    sheet.text((centre[0] + 14, centre[1] + 5), "robot frame", size=12, colour=GREY, anchor="start")
    turn_deg = 90.0 + math.degrees(float(drive.azimuths_rad[1]))
    sheet.arc(centre, 62, 90, turn_deg, arrow=True)
    label = polar(centre, 82, 215)
    sheet.text((label[0], label[1] + 6), "θ_2", size=18, style="i")
    middle = ((centre[0] + pivots[2][0]) / 2 + 18, (centre[1] + pivots[2][1]) / 2 + 8)
    sheet.text(middle, "R", size=18, style="i")


def _module(
    sheet: Sheet, drive: SingularityKinematics, at: Point, azimuth: float, index: int
) -> None:
    radius = SCALE * drive.wheel_radius_m
    out = 90.0 + math.degrees(azimuth)
    sheet.circle(at, radius, colour=ORANGE, fill="#fff4ec", width=2)
    sheet.arc(at, radius + 9, out + 110, out + 200, colour=ORANGE, width=2, arrow=True)
    spin = polar(at, radius + 25, out + 150)
    sheet.text((spin[0], spin[1] + 4), "ω_d", size=13, colour=ORANGE, style="i")
    for angle, colour, name in ((out, GREEN, "Y_W"), (out - 90.0, RED, "X_W")):
        sheet.line([at, polar(at, 80, angle)], colour=colour, width=2, arrow=True)
        end = polar(at, 97, angle)
        sheet.text((end[0], end[1] + 5), name, colour=colour, size=15, style="b")
    sheet.circle(at, 4, colour=BLUE, fill=BLUE)
    number = polar(at, 0.6 * radius, out + 135.0)
    sheet.text((number[0], number[1] + 6), str(index + 1), size=17, style="b", halo=False)


def _tilt(
    sheet: Sheet, drive: SingularityKinematics, centre: Point, words: str, twist: Array
) -> None:
    """Draw, for one twist, the horizontal part of each axle in the robot frame."""
    scale = 0.3 * SCALE
    sheet.circle(centre, scale * drive.pivot_radius_m, colour=PALE, width=2)
    modules = zip(drive.pivots_m, drive.azimuths_rad, drive.axles(twist), strict=True)
    for pivot, azimuth, (x, y) in modules:
        c, s = np.cos(azimuth - np.pi / 2), np.sin(azimuth - np.pi / 2)
        lean = np.array([c * x - s * y, s * x + c * y])
        at = _page(centre, pivot, scale)
        sheet.circle(at, scale * drive.wheel_radius_m, colour=GREY, fill="#fff4ec")
        tip = _page(centre, pivot + 1.1 * lean, scale)
        sheet.line([at, tip], colour=ORANGE, width=2.5, arrow=True)
    if twist[:2].any():
        tip = _page(centre, 0.09 * twist[:2], scale)
        sheet.line([centre, tip], colour=INK, width=2, arrow=True)
    else:
        sheet.arc(centre, 14, -30, 210, width=2, arrow=True)
    sheet.text((centre[0], centre[1] + 104), words, size=13)
