"""Wiring plans, drawn from `docs/wiring/*.toml`: power with fuses, coil circuit and data lines."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import wiring_rules
from svg import AMBER, BLUE, GREY, ORANGE, RED, Point, Sheet

_FOLDER = Path(__file__).parents[2] / "wiring"
_COLOURS = {"supply": RED, "drive": ORANGE, "servos": AMBER, "control": BLUE}
_MOTORS = ("ESC", "VESC", "moteus")
_WIDTH, _LEFT = 1000, 28
_BOX, _COLUMN, _ROW = (132, 34), 262, 52
_TOP, _SECTION = 92, 46


def draw(name: str) -> str:
    """Return the drawing of a plan, after checking its rules.

    Raises:
        ValueError: If a rule is broken.
    """
    plan = wiring_rules.plans(_FOLDER)[name]
    if broken := wiring_rules.check(plan):
        raise ValueError(f"{name}: {broken}")
    leaves = _leaves(plan["wires"])
    chains = [*plan.get("signals", []), *([plan["can"]] if "can" in plan else [])]
    coil_y = _TOP + _ROW * len(leaves) + _SECTION
    data_y = coil_y + (180 if plan.get("contactors") else 0)
    height = data_y + 84 * len(chains) + 50
    sheet = Sheet(_WIDTH, height, f"Wiring plan: {plan['title']}")
    sheet.text((_WIDTH / 2, 36), plan["title"], size=17, style="b", halo=False)
    _heading(sheet, 72, "Power: fuse at the source, cross-section, largest continuous current")
    _power(sheet, plan["wires"], leaves)
    supply = next((wire["from"] for wire in plan["wires"] if wire["name"] == "coil"), "")
    for contactor in plan.get("contactors", []):
        radio = any(part["name"] == "radio stop" for part in plan["parts"])
        _coil(sheet, coil_y, contactor, supply, radio=radio)
    _heading(sheet, data_y, "Data")
    for row, chain in enumerate(chains):
        _chain(sheet, data_y + 36 + 84 * row, chain)
    grounds = ", ".join(plan["grounds"]["joined"])
    words = f"Grounds meet at {plan['grounds']['star']}: {grounds}"
    sheet.text((_LEFT, height - 22), words, size=12, anchor="start", halo=False)
    return sheet.svg()


def _heading(sheet: Sheet, y: float, words: str) -> None:
    sheet.text((_LEFT, y), words, size=13, style="b", anchor="start", halo=False)


def _leaves(wires: list[dict[str, Any]]) -> list[str]:
    """Return the places at the ends of all wires, from the top."""
    fed: dict[str, list[str]] = {}
    for wire in wires:
        fed.setdefault(wire["from"], []).append(wire["to"])

    def below(place: str) -> list[str]:
        return [leaf for to in fed[place] for leaf in below(to)] if place in fed else [place]

    return below("battery")


def _power(sheet: Sheet, wires: list[dict[str, Any]], leaves: list[str]) -> None:
    """Draw the tree of the supply from the left, each place centred on what it feeds."""
    feeds = {wire["to"]: wire for wire in wires}
    heights = {leaf: _TOP + _ROW * (row + 0.5) for row, leaf in enumerate(leaves)}
    columns = {"battery": 0}
    for wire in wires:
        columns[wire["to"]] = columns[wire["from"]] + 1
    for place in sorted(columns, key=columns.__getitem__, reverse=True):
        ends = [heights[wire["to"]] for wire in wires if wire["from"] == place]
        heights.setdefault(place, (min(ends, default=0.0) + max(ends, default=0.0)) / 2.0)
    for wire in wires:
        start = (_LEFT + _COLUMN * columns[wire["from"]] + _BOX[0], heights[wire["from"]])
        _wire(sheet, start, (_LEFT + _COLUMN * columns[wire["to"]], heights[wire["to"]]), wire)
    for place, column in columns.items():
        colour = _COLOURS[feeds[place]["role"]] if place in feeds else RED
        corner = (_LEFT + _COLUMN * column, heights[place] - _BOX[1] / 2)
        sheet.box(corner, _BOX, colour=colour, fill="#f5f7fa")
        at = (corner[0] + _BOX[0] / 2, heights[place] + 4)
        sheet.text(at, place, size=12, style="" if place in leaves else "b", halo=False)
        if place.startswith(_MOTORS):
            _motor(sheet, (corner[0] + _BOX[0], heights[place]))


def _wire(sheet: Sheet, start: Point, end: Point, wire: dict[str, Any]) -> None:
    colour, bend = _COLOURS[wire["role"]], start[0] + 16
    sheet.line([start, (bend, start[1]), (bend, end[1]), end], colour=colour, width=2.5)
    x = bend + 12
    sheet.line([(x, end[1]), (x + 30, end[1])], colour=colour, width=2.5)
    sheet.box((x, end[1] - 6), (30, 12), colour=colour)
    sheet.line([(x, end[1]), (x + 30, end[1])], colour=colour, width=1)
    at = (x, end[1] - 11)
    sheet.text(at, f"{wire['fuse_a']:g} A", size=11, style="b", colour=colour, anchor="start")
    size = f"{wire['mm2']:g} mm\u00b2, {wire['load_a']:g} A"
    sheet.text((x, end[1] + 18), size, size=10, colour=GREY, anchor="start")


def _motor(sheet: Sheet, at: Point) -> None:
    sheet.line([at, (at[0] + 12, at[1])], colour=ORANGE, width=2.5)
    sheet.circle((at[0] + 22, at[1]), 10, colour=ORANGE, fill="#fff7e6")
    sheet.text((at[0] + 22, at[1] + 4), "M", size=10, halo=False)


def _coil(sheet: Sheet, y: float, contactor: dict[str, Any], supply: str, *, radio: bool) -> None:
    """Draw the circuit of a contactor's coil, and its main contacts with the precharge."""
    _heading(
        sheet, y, "Coil circuit: stop opens it, start closes it, the auxiliary contact keeps it"
    )
    rail = y + 62
    low = rail + 44
    sheet.text((_LEFT, rail - 10), f"+ of the {supply}", size=11, anchor="start")
    for points in (
        [(_LEFT, rail), (390, rail)],
        [(370, rail), (370, low), (390, low)],
        [(430, low), (450, low), (450, rail)],
        [(430, rail), (510, rail)],
    ):
        sheet.line(points, colour=BLUE, width=2)
    _contact(sheet, (200, rail), "stop", closed=True)
    if radio:
        _contact(sheet, (290, rail), "radio stop", closed=True)
    _contact(sheet, (390, rail), "start", closed=False)
    _contact(sheet, (390, low), "auxiliary contact", closed=False, below=True)
    for x in (370, 450, 480, 600):
        sheet.circle((x, rail), 2.5, colour=BLUE, fill=BLUE)
    sheet.box((510, rail - 14), (60, 28), colour=BLUE, fill="#f5f7fa")
    sheet.text((540, rail + 4), "coil", size=12, halo=False)
    sheet.line([(570, rail), (650, rail)], colour=BLUE, width=2)
    sheet.text((652, rail + 4), "\u2212 of the battery", size=11, anchor="start", halo=False)
    _clamp(sheet, rail)
    _main_contacts(sheet, rail, contactor)


def _clamp(sheet: Sheet, rail: float) -> None:
    """Draw the diode, which conducts from the coil's minus, and the Zener against it."""
    low = rail + 44
    sheet.line([(480, rail), (480, low), (600, low), (600, rail)], colour=BLUE, width=2)
    for x, zener in ((512, True), (568, False)):
        # Both conduct towards where they meet.
        tip, base = (x + 7, x - 7) if zener else (x - 7, x + 7)
        ends = [(base, low - 7), (base, low + 7), (tip, low), (base, low - 7)]
        sheet.line(ends, colour=BLUE, fill="#fff")
        bend = 4 if zener else 0
        bar = [(tip - bend, low - 8), (tip, low - 8), (tip, low + 8), (tip + bend, low + 8)]
        sheet.line(bar, colour=BLUE, width=2)
    sheet.text((512, low + 24), "Zener", size=10, colour=GREY)
    sheet.text((568, low + 24), "diode", size=10, colour=GREY)


def _main_contacts(sheet: Sheet, rail: float, contactor: dict[str, Any]) -> None:
    x, low = 800, rail + 44
    sheet.text((x + 70, rail - 34), "main contacts", size=11)
    sheet.line([(x, rail), (x + 140, rail)], colour=ORANGE, width=3)
    sheet.line([(x + 12, rail), (x + 12, low), (x + 128, low), (x + 128, rail)], colour=ORANGE)
    _contact(sheet, (x + 50, rail), "", closed=False, colour=ORANGE)
    _contact(sheet, (x + 30, low), "", closed=False, colour=ORANGE)
    _resistor(sheet, (x + 82, low), ORANGE)
    words = f"precharge button, {contactor['precharge_ohm']:g} \u03a9"
    sheet.text((x + 70, low + 24), words, size=10, colour=GREY)
    rating = f"{contactor['rated_a']:g} A at {contactor['rated_v']:g} V DC"
    sheet.text((x + 70, rail - 20), rating, size=10, colour=GREY)


def _contact(
    sheet: Sheet,
    at: Point,
    words: str,
    *,
    closed: bool,
    colour: str = BLUE,
    below: bool = False,
) -> None:
    """Draw a contact 40 wide; an open one as a lever, a closed one that opens as a bridge."""
    x, y = at
    sheet.line([(x, y), (x + 40, y)], colour="#ffffff", width=5)
    for end in (x, x + 40):
        sheet.circle((end, y), 3, colour=colour, fill="#fff")
    lever = [(x + 2, y + 5), (x + 38, y + 5)] if closed else [(x + 3, y - 1), (x + 36, y - 12)]
    sheet.line(lever, colour=colour, width=2)
    if words:
        sheet.text((x + 20, y + 24 if below else y - 18), words, size=11)


def _resistor(sheet: Sheet, at: Point, colour: str) -> None:
    sheet.box((at[0], at[1] - 6), (30, 12), colour=colour)


def _chain(sheet: Sheet, y: float, chain: dict[str, Any]) -> None:
    """Draw a data line with its devices, and its rule below."""
    ends = chain.get("terminators_ohm")
    places, step = chain["chain"], 176
    for i, place in enumerate(places):
        x = _LEFT + step * i
        if i:
            sheet.line([(x - step + _BOX[0], y), (x, y)], colour=BLUE, width=2)
        sheet.box((x, y - 15), (_BOX[0], 30), colour=BLUE, fill="#f5f7fa")
        sheet.text((x + _BOX[0] / 2, y + 4), place, size=12, halo=False)
    if ends:
        for ohm, place in zip(ends, (1, len(places) - 1), strict=True):
            x = _LEFT + step * place + _BOX[0] / 2
            sheet.line([(x, y + 15), (x, y + 30), (x + 8, y + 30)], colour=BLUE)
            _resistor(sheet, (x + 8, y + 30), BLUE)
            sheet.text((x + 44, y + 34), f"{ohm:g} \u03a9", size=11, anchor="start", halo=False)
    sheet.text((_LEFT, y + 34), _rule(chain), size=11, colour=GREY, anchor="start", halo=False)


def _rule(chain: dict[str, Any]) -> str:
    if "terminators_ohm" in chain:
        return "CAN, terminated at both ends"
    pull = chain.get("pull_up_ohm", 0.0)
    pulled = f", pull-up {pull / 1000:g} k\u03a9" if pull else ""
    if down := chain.get("pull_down_ohm"):
        pulled = f", {down / 1000:g} k\u03a9 to ground"
    return f"{chain['name']}: {chain['driver_v']:g} V{pulled}, idles {chain['idle']}"
