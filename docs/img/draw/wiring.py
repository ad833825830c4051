"""What is connected to what: PC, board, servo bus, speed controllers, receiver, battery."""

from __future__ import annotations

from svg import AMBER, BLUE, GREEN, GREY, INK, ORANGE, RED, Point, Sheet


def draw() -> str:
    """Return the drawing."""
    sheet = Sheet(1010, 600, "Wiring of the robot: board, servos, speed controllers, battery")
    _board(sheet)
    _pc(sheet)
    _receiver(sheet)
    _servos(sheet)
    _controllers(sheet)
    _power(sheet)
    _legend(sheet)
    return sheet.svg()


def _thing(
    sheet: Sheet, corner: Point, size: Point, title: str, note: str = "", colour: str = INK
) -> None:
    sheet.box(corner, size, colour=colour, fill="#f5f7fa")
    x, y = corner[0] + size[0] / 2, corner[1] + 22
    sheet.text((x, y), title, size=14, style="b", halo=False)
    if note:
        sheet.text((x, y + 18), note, size=11, colour=GREY, halo=False)


def _pin(sheet: Sheet, at: Point, words: str, *, left: bool) -> None:
    sheet.circle(at, 3.5, fill=INK)
    shift, anchor = (9, "start") if left else (-9, "end")
    sheet.text((at[0] + shift, at[1] + 4), words, size=11, anchor=anchor, halo=False)


def _board(sheet: Sheet) -> None:
    _thing(sheet, (330, 90), (230, 318), "Arduino Mega 2560", "firmware/; RESET-EN cut")
    for y, words in ((170, "USB"), (230, "A8 to A13, 15"), (330, "A0"), (360, "A1"), (395, "GND")):
        _pin(sheet, (330, y), words, left=True)
    pins = ((150, "TX1 18"), (170, "RX1 19"), (190, "D22 direction"), (285, "D6"))
    for y, words in (*pins, (310, "D7"), (335, "D8"), (370, "5 V"), (395, "GND")):
        _pin(sheet, (560, y), words, left=False)


def _pc(sheet: Sheet) -> None:
    _thing(sheet, (30, 135), (180, 70), "PC on the robot", "tsd-bridge")
    sheet.line([(210, 170), (326, 170)], colour=BLUE, width=2.5)
    sheet.text((268, 162), "USB, 1 Mbaud", size=11, colour=BLUE)
    sheet.text((268, 188), "5 V wire cut", size=11, colour=RED)


def _receiver(sheet: Sheet) -> None:
    _thing(sheet, (30, 225), (180, 76), "RC receiver", "six channels, 5 V")
    sheet.text((120, 285), "kill switch, manual", size=11, colour=RED, halo=False)
    sheet.line([(210, 230), (326, 230)], colour=GREEN, width=2)
    sheet.text((268, 222), "6 × pulse or SBUS", size=11, colour=GREEN)


def _servos(sheet: Sheet) -> None:
    _thing(sheet, (655, 135), (110, 75), "74LVC2G241", "half duplex")
    for y in (150, 170, 190):
        sheet.line([(563, y), (655, y)], colour=BLUE, width=2)
    sheet.line([(765, 172), (792, 172)], colour=BLUE, width=2)
    for i in range(6):
        x, y = 800 + 54 * (i // 2), 140 + 36 * (i % 2)
        sheet.box((x - 8, y), (46, 30), colour=BLUE)
        sheet.text((x + 15, y + 20), f"id {i + 1}", size=11, halo=False)
    sheet.text((868, 126), "six MX-64, one chain", size=13, style="b", halo=False)
    order = "modules 1, 2, 3 from the left: \u03b1 above \u03b2"
    sheet.text((848, 226), order, size=10, colour=GREY)


def _controllers(sheet: Sheet) -> None:
    for i, y in enumerate((285, 310, 335)):
        sheet.line([(563, y), (700, y)], colour=ORANGE, width=2)
        sheet.box((700, y - 10), (84, 20), colour=ORANGE)
        sheet.text((742, y + 4), f"ESC {i + 1}", size=11, halo=False)
        sheet.line([(784, y), (842, y)], colour=ORANGE, width=2)
        sheet.circle((852, y), 10, colour=ORANGE, fill="#fff7e6")
        sheet.text((852, y + 4), "M", size=10, halo=False)
        sheet.line([(600, y), (600, y + 8)], colour=GREY)
    sheet.text((632, 274), "pulse, 50 Hz", size=11, colour=ORANGE)
    sheet.line([(600, 285), (600, 372)], colour=GREY, dash="4 3")
    sheet.text((606, 366), "10 kΩ each to GND", size=10, colour=GREY, anchor="start")
    sheet.text((905, 314), "wheels", size=11, colour=GREY)


def _power(sheet: Sheet) -> None:
    _thing(sheet, (30, 470), (150, 70), "battery", "12 V", AMBER)
    sheet.line([(180, 500), (250, 500)], colour=RED, width=3)
    sheet.box((250, 486), (70, 28), colour=RED)
    sheet.text((285, 504), "fuses", size=11, halo=False)
    sheet.line([(320, 500), (968, 500), (968, 155), (948, 155)], colour=RED, width=3, arrow=True)
    unswitched = "12 V to the servos:\nnot switched, so that\nthey hold neutral"
    sheet.text((958, 436), unswitched, size=11, colour=RED, anchor="end")
    sheet.line([(610, 500), (610, 450), (640, 450)], colour=RED, width=3)
    sheet.line([(400, 500), (400, 524), (420, 524)], colour=RED, width=3)
    sheet.box((420, 512), (130, 24), colour=RED)
    sheet.text((485, 528), "regulator to 5 V", size=11, halo=False)
    sheet.line([(550, 524), (590, 524), (590, 370), (564, 370)], colour=RED, width=2, arrow=True)
    sheet.text((708, 488), "its coil behind the servos' fuse", size=10, colour=RED)
    sheet.box((640, 430), (120, 40), colour=RED, fill="#fdecea")
    sheet.text((700, 447), "contactor", size=12, style="b", halo=False)
    sheet.text((700, 462), "opened by either stop", size=10, halo=False)
    sheet.line([(742, 430), (742, 347)], colour=RED, width=3, arrow=True)
    sheet.text((750, 395), "12 V to the drive", size=11, colour=RED, anchor="start")
    sheet.box((395, 440), (130, 24), colour=RED)
    sheet.text((460, 456), "hard-wired stop", size=11, halo=False)
    sheet.line([(525, 452), (640, 440)], colour=RED, dash="5 4", arrow=True)
    sheet.line([(120, 301), (120, 432), (640, 432)], colour=RED, dash="5 4", arrow=True)
    sheet.text((200, 424), "radio stop", size=11, colour=RED)
    sheet.line([(285, 486), (285, 330), (326, 330)], colour=AMBER, width=2)
    sheet.text((278, 350), "A0: 30 k\u03a9 over 10 k\u03a9", size=11, colour=AMBER, anchor="end")
    # Behind the contactor: across below the board to A1.
    sheet.line(
        [(720, 430), (720, 380), (612, 380), (612, 420), (312, 420), (312, 360), (326, 360)],
        colour=AMBER,
        width=2,
    )
    sheet.text((278, 376), "A1: 30 k\u03a9 over 10 k\u03a9", size=11, colour=AMBER, anchor="end")
    sheet.line([(60, 540), (60, 572), (985, 572), (985, 190), (950, 190)], colour=INK, width=2)
    sheet.line([(575, 572), (575, 395), (563, 395)], colour=INK, width=2)
    ground = "one ground: battery, board, servos, speed controllers, receiver"
    sheet.text((320, 564), ground, size=11)


def _legend(sheet: Sheet) -> None:
    words = (
        ("data", BLUE),
        ("pulses", ORANGE),
        ("receiver", GREEN),
        ("power", RED),
        ("ground", INK),
    )
    for i, (word, colour) in enumerate(words):
        x = 240 + 120 * i
        sheet.line([(x, 44), (x + 34, 44)], colour=colour, width=3)
        sheet.text((x + 42, 48), word, size=12, anchor="start", halo=False)
