"""The modes of a robot and the ways between them, from the table that the robot itself runs on."""

from __future__ import annotations

import itertools

from svg import AMBER, BLUE, GREEN, GREY, INK, RED, Point, Sheet

from tsd_twin.messages.modes import ARMED, LATCHED, Mode
from tsd_twin.safety import TRANSITIONS

SIZE = (104.0, 44.0)
CENTRES: dict[Mode, Point] = {
    Mode.DISARMED: (90, 190),
    Mode.ARMING: (340, 190),
    Mode.READY: (540, 190),
    Mode.DRIVING: (760, 190),
    Mode.STOPPING: (760, 340),
    Mode.STOPPED: (1085, 190),
    Mode.FAULT: (1085, 340),
}
COLOURS = {
    Mode.DISARMED: GREY,
    Mode.ARMING: AMBER,
    Mode.READY: BLUE,
    Mode.DRIVING: GREEN,
    Mode.STOPPING: AMBER,
    Mode.STOPPED: RED,
    Mode.FAULT: RED,
}
ROUTES: dict[tuple[Mode, Mode], tuple[list[Point], Point]] = {
    (Mode.DISARMED, Mode.ARMING): ([(142, 180), (288, 180)], (186, 172)),
    (Mode.ARMING, Mode.DISARMED): ([(288, 200), (142, 200)], (204, 218)),
    (Mode.ARMING, Mode.READY): ([(392, 190), (488, 190)], (440, 168)),
    (Mode.READY, Mode.DRIVING): ([(592, 180), (708, 180)], (650, 154)),
    (Mode.DRIVING, Mode.READY): ([(708, 200), (592, 200)], (650, 218)),
    (Mode.DRIVING, Mode.STOPPING): ([(780, 212), (780, 318)], (850, 250)),
    (Mode.STOPPING, Mode.DRIVING): ([(740, 318), (740, 212)], (692, 282)),
    (Mode.STOPPING, Mode.READY): ([(708, 332), (540, 332), (540, 212)], (580, 324)),
    (Mode.STOPPING, Mode.DISARMED): ([(708, 350), (75, 350), (75, 212)], (340, 342)),
    (Mode.READY, Mode.DISARMED): ([(540, 168), (540, 118), (105, 118), (105, 168)], (330, 110)),
    (Mode.STOPPED, Mode.DISARMED): ([(1085, 168), (1085, 30), (75, 30), (75, 168)], (560, 22)),
    (Mode.FAULT, Mode.STOPPED): ([(1085, 318), (1085, 212)], (1108, 270)),
    (Mode.FAULT, Mode.DISARMED): ([(1085, 362), (1085, 440), (55, 440), (55, 212)], (560, 432)),
}
"""Where an arrow runs and where its words stand."""
ARROWS_OF_ALL: tuple[tuple[frozenset[Mode], Mode, list[Point], Point], ...] = (
    (frozenset(Mode) - LATCHED, Mode.STOPPED, [(975, 190), (1033, 190)], (1004, 178)),
    (ARMED, Mode.FAULT, [(955, 340), (1033, 340)], (1004, 328)),
)
"""Arrows that start at a frame and apply to every mode in it."""


def draw() -> str:
    """Return the drawing.

    Raises:
        ValueError: If the drawn transitions differ from the table.
    """
    drawn = set(ROUTES) | {(mode, to) for group, to, _, _ in ARROWS_OF_ALL for mode in group}
    if drawn != set(TRANSITIONS):
        raise ValueError(f"drawn and allowed differ in {sorted(drawn ^ set(TRANSITIONS))}")
    sheet = Sheet(1155, 460, "Modes of a robot")
    sheet.box((20, 56), (955, 356), colour=GREY, fill="#f9fafb", dash="6 4")
    sheet.text((120, 76), "not latched", size=12, colour=GREY, anchor="start")
    sheet.box((262, 86), (693, 306), colour=AMBER, fill="#fffdf7", dash="6 4")
    sheet.text((943, 104), "armed: the wheels may spin", size=12, colour=AMBER, anchor="end")
    for group, to, points, at in ARROWS_OF_ALL:
        (words,) = {TRANSITIONS[mode, to] for mode in group}
        sheet.line(points, colour=RED, width=2.5, arrow=True)
        sheet.text(at, words, size=13, colour=RED, style="b")
    for way, (points, at) in ROUTES.items():
        sheet.line(points, arrow=True)
        sheet.text(at, _wrapped(TRANSITIONS[way], _letters(points)), size=12)
    for mode, (x, y) in CENTRES.items():
        corner = (x - SIZE[0] / 2, y - SIZE[1] / 2)
        sheet.box(corner, SIZE, colour=COLOURS[mode])
        sheet.text((x, y + 5), mode.value, size=15, colour=COLOURS[mode], style="b", halo=False)
    sheet.circle((90, 262), 5, colour=INK, fill=INK)
    sheet.line([(90, 258), (90, 212)], arrow=True)
    return sheet.svg()


def _letters(points: list[Point]) -> int:
    """Return the number of letters per line that fit next to an arrow."""
    longest = max(abs(b[0] - a[0]) for a, b in itertools.pairwise(points))
    return int(longest / 7.0) or 18


def _wrapped(words: str, width: int) -> str:
    rows = [""]
    for word in words.split():
        if rows[-1] and len(rows[-1]) + 1 + len(word) > width:
            rows.append("")
        rows[-1] = f"{rows[-1]} {word}".strip()
    return "\n".join(rows)
