"""Descriptions derived from shipped robots: module positions, and Dynamixel X servos as wheels."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tsd_twin import robots
from tsd_twin.robots import SingularityDescription

CIRCLE = "azimuths_deg = [90.0, 210.0, 330.0]\npivot_radius_m = 0.15\n"
ODD = ((0.25, 0.15), (-0.2, 0.1), (0.02, -0.22))
"""Layout without symmetry."""


def text(positions: Sequence[tuple[float, float]] = ODD, name: str = "odd") -> str:
    """Return the TOML of `tsd` with one module and motor for each position (x, y), metres."""
    shipped = robots.read_description("tsd")
    assert CIRCLE in shipped
    tables = "".join(f"[[drive.modules]]\nx_m = {x!r}\ny_m = {y!r}\n\n" for x, y in positions)
    toml = shipped.replace(CIRCLE, "").replace("[limits]", f"{tables}[limits]", 1)
    toml = toml.replace('name = "tsd"', f'name = "{name}"')
    before, rest = toml.split("speed_rpm = [\n", 1)
    curves, after = rest.split("\n]\n", 1)
    lines = curves.splitlines()
    listed = "\n".join(lines[i % len(lines)] for i in range(len(positions)))
    return f"{before}speed_rpm = [\n{listed}\n]\n{after}"


def placed(positions: Sequence[tuple[float, float]] = ODD) -> SingularityDescription:
    """Return `tsd` with modules at these positions (x, y), metres."""
    robot = robots.parse_description(text(positions), "odd.toml")
    return robots.description_of_kind(robot, SingularityDescription)


_EXAMPLE = Path(__file__).parents[2] / "examples" / "kiwi_xl430.toml"


@dataclass(frozen=True)
class WheelRobot:
    """Description of an omni robot, and its wheel servos."""

    text: str
    wheels: int
    model: int
    volts: float
    limit_c: float


def _on_xc430(name: str) -> str:
    """Return the TOML of a shipped robot with XC430-W150 as its motors."""
    motor = (
        "[motor]\npower_w = 4.5\ngear_ratio = 200.0\nno_load_speed_rpm = 18000.0\n"
        "rotor_inertia_kg_m2 = 2e-8\ntime_constant_s = 0.05\n\n"
    )
    text = re.sub(r"\[motor\]\n(?:.+\n)+\n", motor, robots.read_description(name))
    text = re.sub(r"nominal_v = .*", "nominal_v = 12.0\narm_v = 10.0\nstop_v = 9.5", text)
    text = re.sub(r"speed_mps = .*", "speed_mps = 0.3", text)
    return re.sub(r"turn_rate_rad_per_s = .*", "turn_rate_rad_per_s = 0.8", text)


WHEEL_ROBOTS = {
    "kiwi": WheelRobot(_EXAMPLE.read_text(encoding="utf-8"), 3, 1060, 11.1, 72.0),
    "mecanum": WheelRobot(_on_xc430("mecanum"), 4, 1070, 12.0, 80.0),
    "omni4": WheelRobot(_on_xc430("omni4"), 4, 1070, 12.0, 80.0),
}
