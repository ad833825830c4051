"""The spherical platform from the side and from above: contacts, axes, and the two rows."""

from __future__ import annotations

import math

import numpy as np
from svg import BLUE, GREEN, GREY, INK, ORANGE, PALE, RED, Point, Sheet, polar

from tsd_twin.kinematics import SphereKinematics
from tsd_twin.robots import load_robot

RADIUS = 150.0


def draw() -> str:
    """Return the drawing of the shipped platform; its rows are drawn four times as far apart."""
    robot = load_robot("atlas")
    drive = robot.kinematics()
    sheet = Sheet(980, 480, "The spherical platform")
    theta = robot.drive.wheels[0].below_equator_deg
    _side(sheet, drive, theta, (300.0, 210.0))
    _above(sheet, drive, (790.0, 210.0))
    return sheet.svg()


def _side(sheet: Sheet, drive: SphereKinematics, theta: float, centre: Point) -> None:
    sheet.text((24, 34), "From the side, with wheel 1", size=17, anchor="start", style="b")
    sheet.circle(centre, RADIUS, colour=INK, fill="#f7fafc", width=2)
    sheet.line(
        [polar(centre, RADIUS + 20, 180), polar(centre, RADIUS + 70, 0)], colour=GREY, dash="5 4"
    )
    for name, angle, colour in (("Z", 90.0, BLUE), ("X", 0.0, RED)):
        sheet.line([centre, polar(centre, 90, angle)], colour=colour, width=2.5, arrow=True)
        tip = polar(centre, 106, angle)
        sheet.text((tip[0], tip[1] + (18 if name == "X" else 5)), name, colour=colour, size=16)
    contact = polar(centre, RADIUS, -theta)
    sheet.line([centre, contact], colour=GREY, width=2)
    sheet.arc(centre, 60, 0, -theta, arrow=True)
    label = polar(centre, 78, -theta / 2)
    sheet.text((label[0], label[1] + 6), "θ", size=18, style="i")
    middle = polar(centre, 0.62 * RADIUS, -theta - 9)
    sheet.text(middle, "R_i", size=17, style="i")
    # The axle lies along Omega = R x v, in this plane; the rows are on both sides of the middle.
    axle = 90.0 - theta
    wheel = polar(centre, RADIUS + 46, -theta)
    spread = 4.0 * math.degrees(drive.row_offset_rad)
    for sign, words in ((1.0, "row 1"), (-1.0, "row 2")):
        touch = polar(centre, RADIUS, -theta + sign * spread)
        roller = polar(centre, RADIUS + 12, -theta + sign * spread)
        sheet.circle(roller, 12, colour=ORANGE, fill="#fff4ec", width=2)
        sheet.circle(touch, 3, colour=ORANGE, fill=ORANGE)
        hub = polar(wheel, sign * 26, axle)
        sheet.line([roller, hub], colour=ORANGE, width=2)
        name = polar(centre, RADIUS + 38 - 15 * sign, -theta + sign * (spread + 13.0))
        sheet.text((name[0], name[1] + 5), words, size=12, colour=ORANGE, anchor="start")
    sheet.line(
        [polar(wheel, -60, axle), polar(wheel, 84, axle)], colour=GREEN, width=2.5, arrow=True
    )
    end = polar(wheel, 100, axle)
    sheet.text((end[0] + 16, end[1]), "Ω_i", size=17, colour=GREEN, style="i")
    words = "v_i points away from the reader: a wheel that turns forward\n"
    words += "pushes the surface there and turns the sphere about Ω_i"
    sheet.text((24, 440), words, size=13, anchor="start")


def _above(sheet: Sheet, drive: SphereKinematics, centre: Point) -> None:
    sheet.text((640, 34), "From above", size=17, anchor="start", style="b")
    sheet.circle(centre, 0.8 * RADIUS, colour=INK, fill="#f7fafc", width=2)
    for name, angle, colour in (("X", 90.0, RED), ("Y", 180.0, GREEN)):
        sheet.line([centre, polar(centre, 60, angle)], colour=colour, width=2.5, arrow=True)
        tip = polar(centre, 74, angle)
        sheet.text((tip[0], tip[1] + 5), name, colour=colour, size=16)
    for i, (contact, push) in enumerate(zip(drive.contacts, drive.actuations, strict=True)):
        # X is up and Y to the left.
        x, y = (0.8 * RADIUS * float(value) for value in contact[:2])
        at = (centre[0] - y, centre[1] - x)
        along = 90.0 + math.degrees(float(np.arctan2(push[1], push[0])))
        ends = [polar(at, -24, along), polar(at, 24, along)]
        sheet.line(ends, colour=ORANGE, width=9)
        sheet.line([at, polar(at, 62, along)], colour=BLUE, width=2.5, arrow=True)
        name = polar(at, 76, along)
        sheet.text((name[0], name[1] + 5), f"v_{i + 1}", size=15, colour=BLUE, style="i")
        az = math.degrees(float(np.arctan2(contact[1], contact[0])))
        sheet.line([centre, polar(centre, 0.8 * RADIUS + 26, 90.0 + az)], colour=PALE, dash="4 4")
        number = polar(centre, 0.8 * RADIUS + 24, 90.0 + az)
        sheet.text((number[0], number[1] + 6), str(i + 1), size=16, style="b")
