"""Wiring plans, drawn from `docs/wiring/*.toml`: each wire with its fuse and cross-section."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import wiring_rules
from svg import AMBER, BLUE, GREY, INK, ORANGE, RED, Sheet

_FOLDER = Path(__file__).parents[2] / "wiring"
_COLOURS = {"supply": RED, "drive": ORANGE, "servos": AMBER, "control": BLUE}
_ROW, _TOP = 46, 70


def draw(name: str) -> str:
    """Return the drawing of a plan, after checking its rules.

    Raises:
        ValueError: If a rule is broken.
    """
    plan = wiring_rules.plans(_FOLDER)[name]
    if broken := wiring_rules.check(plan):
        raise ValueError(f"{name}: {broken}")
    wires, notes = plan["wires"], _notes(plan)
    bottom = _TOP + _ROW * len(wires) + 20
    sheet = Sheet(900, bottom + 22 * len(notes) + 20, f"Wiring plan: {plan['title']}")
    sheet.text((450, 34), plan["title"], size=16, style="b", halo=False)
    for row, wire in enumerate(wires):
        _wire(sheet, _TOP + _ROW * row, wire)
    for row, (words, colour) in enumerate(notes):
        at = (40, bottom + 22 * row)
        sheet.text(at, words, size=12, colour=colour, anchor="start", halo=False)
    return sheet.svg()


def _wire(sheet: Sheet, y: int, wire: dict[str, Any]) -> None:
    colour = _COLOURS[wire["role"]]
    for x, word in ((40, wire["from"]), (680, wire["to"])):
        sheet.box((x, y), (180, 32), colour=colour, fill="#f5f7fa")
        sheet.text((x + 90, y + 21), word, size=12, halo=False)
    sheet.line([(220, y + 16), (676, y + 16)], colour=colour, width=3, arrow=True)
    sheet.box((290, y + 4), (110, 24), colour=colour)
    sheet.text((345, y + 20), f"fuse {wire['fuse_a']:g} A", size=11, halo=False)
    size = f"{wire['mm2']:g} mm\u00b2, at most {wire['load_a']:g} A"
    sheet.text((540, y + 10), size, size=11, colour=GREY)


def _notes(plan: wiring_rules.Plan) -> list[tuple[str, str]]:
    notes: list[tuple[str, str]] = []
    for it in plan.get("contactors", []):
        rating = f"{it['rated_a']:g} A, {it['rated_v']:g} V DC"
        text = f"{it['name']}: {rating}; coil behind the fuse of the {it['coil_after']}, with "
        text += (
            f"{' and '.join(it['coil_clamp'])}; sealed in; precharge {it['precharge_ohm']:g} \u03a9"
        )
        notes.append((text, RED))
    for it in plan.get("signals", []):
        pull = f", pull-up {it['pull_up_ohm'] / 1000:g} k\u03a9" if it.get("pull_up_ohm") else ""
        turned = ", through an inverter" if it.get("inverter") else ""
        notes.append(
            (f"{it['name']}: {it['driver_v']:g} V{pull}{turned}, idles {it['idle']}", BLUE)
        )
    if "can" in plan:
        ends = " and ".join(f"{ohm:g} \u03a9" for ohm in plan["can"]["terminators_ohm"])
        notes.append((f"CAN: {ends}, at its ends", BLUE))
    grounds = ", ".join(plan["grounds"]["joined"])
    notes.append((f"grounds joined at {plan['grounds']['star']}: {grounds}", INK))
    return notes
