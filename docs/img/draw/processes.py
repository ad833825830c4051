"""Who talks to whom: browser, dashboard, bus, robot node and the joints."""

from __future__ import annotations

from svg import AMBER, BLUE, GREEN, GREY, INK, ORANGE, Point, Sheet


def draw() -> str:
    """Return the drawing."""
    sheet = Sheet(980, 430, "Processes and data flow")
    _browser(sheet)
    _dashboard(sheet)
    _bus(sheet)
    _node(sheet)
    return sheet.svg()


def _process(sheet: Sheet, corner: Point, size: Point, title: str, note: str = "") -> None:
    sheet.box(corner, size, fill="#f5f7fa")
    sheet.text((corner[0] + size[0] / 2, corner[1] + 24), title, size=15, style="b", halo=False)
    sheet.text((corner[0] + size[0] / 2, corner[1] + 42), note, size=11, colour=GREY, halo=False)


def _part(sheet: Sheet, corner: Point, size: Point, words: str, colour: str = INK) -> None:
    sheet.box(corner, size, colour=colour)
    rows = words.count("\n") + 1
    top = corner[1] + size[1] / 2 - 7.2 * (rows - 1) + 4
    sheet.text((corner[0] + size[0] / 2, top), words, size=12, halo=False)


def _flow(sheet: Sheet, points: list[Point], words: str, at: Point, colour: str = INK) -> None:
    sheet.line(points, colour=colour, width=2, arrow=True)
    sheet.text(at, words, size=11, colour=colour)


def _browser(sheet: Sheet) -> None:
    _process(sheet, (20, 60), (150, 300), "Browser", "any number of pages")
    _part(sheet, (35, 130), (120, 70), "controls:\nstick, STOP,\nlease, status", ORANGE)
    _part(sheet, (35, 250), (120, 70), "viser's page:\nscene, sliders", BLUE)


def _dashboard(sheet: Sheet) -> None:
    _process(sheet, (265, 60), (250, 300), "tsd-dashboard", "one asyncio loop, two threads")
    _part(sheet, (280, 130), (100, 190), "gateway:\nthe only\nopen port", ORANGE)
    _part(sheet, (410, 130), (90, 70), "robot links,\nticker 60 Hz", GREEN)
    _part(sheet, (410, 250), (90, 70), "viser,\nloopback", BLUE)
    _flow(sheet, [(155, 158), (280, 158)], "", (0, 0), ORANGE)
    _flow(sheet, [(280, 176), (155, 176)], "separate socket", (218, 150), ORANGE)
    sheet.text((218, 194), "JSON, teleop.md", size=11, colour=ORANGE)
    _flow(sheet, [(155, 280), (280, 280)], "http, ws", (218, 272), BLUE)
    _flow(sheet, [(280, 292), (155, 292)], "", (0, 0), BLUE)
    _flow(sheet, [(380, 285), (410, 285)], "", (0, 0), BLUE)
    _flow(sheet, [(380, 165), (410, 165)], "", (0, 0), GREEN)
    _flow(sheet, [(455, 200), (455, 250)], "poses", (480, 230), GREEN)


def _bus(sheet: Sheet) -> None:
    sheet.box((590, 30), (44, 370), colour=AMBER, fill="#fff7e6")
    sheet.text((612, 22), "Zenoh", size=14, colour=AMBER, style="b")
    _flow(sheet, [(500, 150), (590, 150)], "twist, stop", (550, 142), GREEN)
    _flow(sheet, [(590, 180), (500, 180)], "state, events", (548, 198), GREEN)
    sheet.text((548, 222), "requests", size=11, colour=GREEN)
    _flow(sheet, [(560, 372), (590, 372)], "", (0, 0), GREY)
    others = "recorders, scripts, a second dashboard"
    sheet.text((552, 376), others, size=11, colour=GREY, anchor="end")


def _node(sheet: Sheet) -> None:
    _process(sheet, (700, 60), (260, 300), "robot node", "one thread, 100 Hz")
    inside = "lease, limits, kinematics,\nodometry, consistency monitor"
    _part(sheet, (715, 130), (230, 76), f"core: pure, time is an argument\n{inside}", GREEN)
    _part(sheet, (715, 246), (230, 36), "RobotIO: read, write", INK)
    _part(sheet, (715, 306), (106, 36), "SimRobot\n(tsd-mock)", INK)
    _part(sheet, (839, 306), (106, 36), "your machine", GREY)
    _flow(sheet, [(634, 150), (715, 150)], "commands", (672, 142), GREEN)
    _flow(sheet, [(715, 184), (634, 184)], "state", (672, 202), GREEN)
    _flow(sheet, [(800, 206), (800, 246)], "set-point", (765, 230), INK)
    _flow(sheet, [(870, 246), (870, 206)], "measured", (906, 230), INK)
    _flow(sheet, [(768, 306), (768, 282)], "", (0, 0), INK)
    _flow(sheet, [(892, 306), (892, 282)], "", (0, 0), GREY)
