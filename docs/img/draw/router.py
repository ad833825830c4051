"""A fleet behind a router: robots and gateway dial out, browsers use https."""

from __future__ import annotations

from svg import AMBER, BLUE, GREEN, GREY, INK, ORANGE, Point, Sheet


def draw() -> str:
    """Return the drawing."""
    sheet = Sheet(980, 400, "From a bench to the internet")
    _place(sheet, (20, 40), (190, 340), "Lab", "no open port")
    for row, name in enumerate(("lab1", "lab2", "lab3")):
        _part(sheet, (40, 110 + 90 * row), (150, 56), f"tsd-bridge\n{name}", GREEN)
    _place(sheet, (330, 40), (350, 340), "Server", "three services, each with its own user")
    sheet.box((350, 100), (44, 250), colour=AMBER, fill="#fff7e6")
    sheet.text((372, 92), "tsd-router", size=12, colour=AMBER, style="b", halo=False)
    sheet.text((445, 232), "rights per robot\nin its rules", size=11, colour=AMBER, halo=False)
    _part(sheet, (500, 110), (160, 64), "tsd-dashboard\nusers and their robots", ORANGE)
    _part(sheet, (500, 270), (160, 64), "tsd-record", BLUE)
    _place(sheet, (790, 40), (170, 150), "Operators", "browsers")
    _place(sheet, (790, 230), (170, 150), "Scripts", "with a certificate")
    _part(sheet, (810, 110), (130, 56), "page of Alice:\nlab1, lab2", ORANGE)
    _part(sheet, (810, 300), (130, 56), "Python client\nlab3", GREEN)
    for y in (138, 228, 318):
        sheet.line([(190, y), (350, y)], colour=GREEN, width=2, arrow=True)
    sheet.text((268, 218), "TLS, dials out", size=11, colour=GREEN)
    sheet.line([(500, 142), (394, 190)], colour=ORANGE, width=2, arrow=True)
    sheet.line([(500, 302), (394, 302)], colour=BLUE, width=2, arrow=True)
    sheet.line([(810, 138), (660, 138)], colour=ORANGE, width=2, arrow=True)
    sheet.text((735, 130), "https 8443", size=11, colour=ORANGE)
    sheet.line([(810, 344), (394, 344)], colour=GREEN, width=2, arrow=True)
    sheet.text((735, 336), "TLS 7447", size=11, colour=GREEN)
    return sheet.svg()


def _place(sheet: Sheet, corner: Point, size: Point, title: str, note: str) -> None:
    sheet.box(corner, size, fill="#f5f7fa")
    sheet.text((corner[0] + size[0] / 2, corner[1] + 22), title, size=15, style="b", halo=False)
    sheet.text((corner[0] + size[0] / 2, corner[1] + 39), note, size=11, colour=GREY, halo=False)


def _part(sheet: Sheet, corner: Point, size: Point, words: str, colour: str = INK) -> None:
    sheet.box(corner, size, colour=colour)
    top = corner[1] + size[1] / 2 - 7.2 * words.count("\n") + 4
    sheet.text((corner[0] + size[0] / 2, top), words, size=12, halo=False)
