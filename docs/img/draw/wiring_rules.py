"""Rules for wiring plans: `check(plan)` returns the broken ones."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

Plan = dict[str, Any]
AMPACITY_A = {
    0.41: 3.0,
    0.75: 6.0,
    1.5: 15.0,
    2.5: 20.0,
    4.0: 32.0,
    6.0: 44.0,
    10.0: 62.0,
    16.0: 82.0,
}
"""Largest fuse, A, by cross-section of copper, mm2: assumed for short, warm, bundled wires.

The data sheet of the wire takes precedence. A pin of JST EH limits 0.41 mm2 (21 AWG).
"""
BOARD_LEAST_V = 3.0
"""Least high level of an input at 5 V (ATmega2560: 0.6 VCC)."""
TERMINATED_OHM = (54.0, 66.0)
SEAL_IN, CLAMP = "no seal-in contact", {"diode", "zener"}


def plans(folder: Path) -> dict[str, Plan]:
    """Return all plans in a folder, by name."""
    files = sorted(folder.glob("*.toml"))
    return {file.stem: tomllib.loads(file.read_text(encoding="utf-8")) for file in files}


def check(plan: Plan) -> list[str]:
    """Return the broken rules of a plan, as `rule: name`."""
    return [
        *_wires(plan),
        *_contactors(plan),
        *_signals(plan),
        *_supplies(plan),
        *_grounds(plan),
        *_stop(plan),
    ]


def _wires(plan: Plan) -> Iterator[str]:
    fed = {"battery", *(wire["to"] for wire in plan["wires"])}
    for wire in plan["wires"]:
        if wire["from"] not in fed:
            yield f"not fed: {wire['name']}"
        name, fuse_a = wire["name"], wire.get("fuse_a", 0.0)
        if fuse_a <= 0.0:
            yield f"no fuse: {name}"
        if fuse_a > AMPACITY_A[wire["mm2"]]:
            yield f"fuse above the wire's ampacity: {name}"
        if wire["load_a"] > fuse_a:
            yield f"load above the fuse: {name}"
        if wire.get("servos", 0) > 2:
            yield f"more than two servos in a branch: {name}"
    supply = [wire for wire in plan["wires"] if wire["role"] == "supply"]
    if not any(wire["fuse_a"] >= plan["supply_a"] for wire in supply):
        yield "main fuse below the supply current: main"


def _contactors(plan: Plan) -> Iterator[str]:
    servos = any(wire["role"] == "servos" for wire in plan["wires"])
    if any(wire["role"] == "drive" for wire in plan["wires"]) and not plan.get("contactors"):
        yield "no contactor: drive"
    for it in plan.get("contactors", []):
        name = it["name"]
        if not it["dc"]:
            yield f"contactor not rated for DC: {name}"
        if it["rated_a"] < plan["supply_a"] or it["rated_v"] < plan["battery_v"]:
            yield f"contactor rating too small: {name}"
        if set(it["coil_clamp"]) != CLAMP:
            yield f"coil without diode and Zener: {name}"
        if servos and it["coil_after"] != "servos":
            yield f"coil before the servos' fuse: {name}"
        if not it["seal_in"]:
            yield f"{SEAL_IN}: {name}"
        if not 10.0 <= it["precharge_ohm"] <= 47.0:
            yield f"no precharge: {name}"


def _signals(plan: Plan) -> Iterator[str]:
    for it in plan.get("signals", []):
        name = it["name"]
        if it["driver_v"] > it["input_v"] + 0.3:
            yield f"level above the input's supply: {name}"
        if it["input_v"] == 5.0 and it["driver_v"] < BOARD_LEAST_V + 0.5:
            yield f"level too low for the input: {name}"
        if "bus" in name and not it.get("pull_up_ohm"):
            yield f"no pull-up: {name}"
        if it.get("inverted_at_source", False) and not it.get("inverter", False):
            yield f"not inverted: {name}"
    if "can" in plan:
        ohm = plan["can"]["terminators_ohm"]
        total = 1.0 / sum(1.0 / it for it in ohm) if ohm else float("inf")
        if len(ohm) != 2 or not TERMINATED_OHM[0] <= total <= TERMINATED_OHM[1]:
            yield "not terminated at both ends: CAN"


def _supplies(plan: Plan) -> Iterator[str]:
    feeds = [it["feeds"] for it in plan.get("supplies", [])]
    for place in sorted(set(feeds)):
        if feeds.count(place) > 1:
            yield f"more than one 5 V supply: {place}"


def _grounds(plan: Plan) -> Iterator[str]:
    for name in sorted(set(plan["grounds"]["needs"]) - set(plan["grounds"]["joined"])):
        yield f"no ground: {name}"


def _stop(plan: Plan) -> Iterator[str]:
    if plan["stop"]["wheels"] != 0:
        yield "stop category is not 0: wheels"
    servos = any(wire.get("servos") for wire in plan["wires"])
    if servos and plan.get("contactors") and plan["stop"].get("gimbals") not in (1, 2):
        yield "stop category is not 1 or 2: gimbals"
