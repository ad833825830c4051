"""What a calibration found, figure by figure: beside what was believed, and what is true."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsd_twin.lab.fit import Fit
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityRobot

_DIGITS = {"deg": 4, "m": 6, "1": 5}
"""Written for each unit."""
_SHOWN = {"deg": ("deg", 1.0, 3), "m": ("mm", 1000.0, 2), "1": ("", 1.0, 5)}
"""Unit, factor and digits that are printed."""


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """One figure of the machine: before, found, and true if that is known."""

    name: str
    unit: str
    before: float
    found: float
    sigma: float
    true: float | None


def table(robot: SingularityRobot, found: Fit, true: SingularityRobot | None) -> list[Row]:
    """Return what the description says, what was found, and what is so, figure by figure."""
    before, by, sigma = _figures(robot), found.found, found.sigma
    after = before.copy()
    angles = 2 * robot.drive.modules
    after[:angles] += np.degrees(by.offset_rad).ravel()
    after[angles:] *= [by.wheel_radius, by.pivot_radius, *by.spin]
    spread = np.concatenate(
        [
            np.degrees(sigma.offset_rad).ravel(),
            before[angles:] * [sigma.wheel_radius, sigma.pivot_radius, *sigma.spin],
        ]
    )
    known = [None] * len(before) if true is None else _figures(true).tolist()
    parts = ("alpha", "beta")
    names = [f"module{i + 1}_{part}" for i in range(robot.drive.modules) for part in parts]
    names += ["wheel_radius", "pivot_radius"]
    names += [f"module{i + 1}_spin" for i in range(robot.drive.modules)]
    units = ["deg"] * angles + ["m"] * 2 + ["1"] * robot.drive.modules
    each = zip(names, units, before.tolist(), after.tolist(), spread.tolist(), known, strict=True)
    return [Row(*values) for values in each]


def _figures(robot: SingularityRobot) -> Array:
    """Return the zeros (2k) in degrees, both radii, and the spins (k)."""
    trim, drive = robot.trim(), robot.drive
    offset = np.degrees(trim.offset).reshape(-1, 3)[:, :2]
    radii = [drive.wheel_radius_m, drive.pivot_radius_m]
    return np.concatenate([offset.ravel(), radii, trim.scale.reshape(-1, 3)[:, 2]])


def changes(rows: list[Row]) -> dict[str, dict[str, Any]]:
    """Return the keys of a description that say what was found."""
    values = {row.name: round(row.found, _DIGITS[row.unit]) for row in rows}
    by_unit = {unit: [values[row.name] for row in rows if row.unit == unit] for unit in _DIGITS}
    angles = by_unit["deg"]
    return {
        "drive": {
            "pivot_radius_m": values["pivot_radius"],
            "wheel_radius_m": values["wheel_radius"],
        },
        "calibration": {
            "tilt_offset_deg": [angles[i : i + 2] for i in range(0, len(angles), 2)],
            "spin_scale": by_unit["1"],
        },
    }


def columns(rows: Sequence[Row]) -> dict[str, list[Any]]:
    """Return the columns of a table."""
    names = ("name", "unit", "before", "found", "sigma", "true")
    return {
        name: ["" if (value := getattr(row, name)) is None else value for row in rows]
        for name in names
    }


def lines(rows: Sequence[Row]) -> list[str]:
    """Return the rows to print."""
    known = rows[0].true is not None
    heads = ("before", "found", "+-", *(("true",) if known else ()))
    shown = [f"{'':19}" + "".join(f"{head:>9}" for head in heads)]
    for row in rows:
        unit, factor, digits = _SHOWN[row.unit]
        values = (row.before, row.found, row.sigma, row.true)
        numbers = "".join(f"{factor * v:9.{digits}f}" for v in values if v is not None)
        shown.append(f"  {row.name:13} {unit:3}{numbers}")
    return shown
