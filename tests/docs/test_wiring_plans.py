"""Wiring plans satisfy the rules, and each rule detects its error."""

from __future__ import annotations

import copy
import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
_SPEC = importlib.util.spec_from_file_location(
    "wiring_rules", ROOT / "docs/img/draw/wiring_rules.py"
)
assert _SPEC is not None
assert _SPEC.loader is not None
rules = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(rules)
PLANS: dict[str, dict[str, Any]] = rules.plans(ROOT / "docs/wiring")
Harm = Callable[[dict[str, Any]], object]


@pytest.mark.parametrize("name", PLANS)
def test_plan_keeps_all_rules(name: str) -> None:
    assert not rules.check(PLANS[name])


def _first(section: str, **values: object) -> Harm:
    return lambda plan: plan[section][0].update(values)


def _sbus(plan: dict[str, Any]) -> None:
    plan["signals"][1]["inverter"] = False


ERRORS: list[tuple[str, Harm, str]] = [
    ("mega", _first("wires", fuse_a=0.0), "no fuse: main"),
    ("mega", _first("wires", mm2=4.0), "fuse above the wire's ampacity: main"),
    ("mega", _first("wires", to="nowhere"), "not fed: drive"),
    ("mega", _first("wires", load_a=90.0), "load above the fuse: main"),
    (
        "mega",
        lambda it: it["wires"][-3].update(servos=6),
        "more than two servos in a branch: servos",
    ),
    ("mega", lambda it: it.update(supply_a=90.0), "main fuse below the supply current: main"),
    ("mega", lambda it: it.pop("contactors"), "no contactor: drive"),
    ("mega", _first("contactors", dc=False), "contactor not rated for DC"),
    ("mega", _first("contactors", rated_a=40.0), "contactor rating too small"),
    ("mega", _first("contactors", rated_v=10.0), "contactor rating too small"),
    ("mega", _first("contactors", coil_clamp=["diode"]), "coil without diode and Zener"),
    ("mega", _first("contactors", coil_after="battery"), "coil before the servos' fuse"),
    ("mega", _first("contactors", seal_in=False), "no seal-in contact"),
    ("mega", _first("contactors", precharge_ohm=0.0), "no precharge"),
    ("bus_wheels", _first("signals", driver_v=5.0), "level above the input's supply: servo bus"),
    ("mega", _first("signals", driver_v=3.3), "level too low for the input: servo bus"),
    ("mega", _first("signals", pull_up_ohm=0.0), "no pull-up: servo bus"),
    ("mega", _sbus, "not inverted: SBUS"),
    (
        "mega",
        lambda it: it["supplies"].append({"name": "BEC of ESC 1", "volts": 5.0, "feeds": "board"}),
        "more than one 5 V supply: board",
    ),
    ("mega", lambda it: it["grounds"]["joined"].remove("receiver"), "no ground: receiver"),
    ("mega", lambda it: it["stop"].update(wheels=2), "stop category is not 0: wheels"),
    ("mega", lambda it: it["stop"].update(gimbals=0), "stop category is not 1 or 2: gimbals"),
    ("u2d2_can", lambda it: it["can"].update(terminators_ohm=[120.0]), "not terminated"),
    ("u2d2_can", lambda it: it["can"].update(terminators_ohm=[120.0] * 3), "not terminated"),
]


@pytest.mark.parametrize(("name", "harm", "rule"), ERRORS)
def test_rule_finds_its_error(name: str, harm: Harm, rule: str) -> None:
    plan = copy.deepcopy(PLANS[name])
    harm(plan)
    assert any(it.startswith(rule) for it in rules.check(plan)), rules.check(plan)
