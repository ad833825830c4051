"""Calibration report: parameter table, figure, and the edited description file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tomlkit
from tomlkit.exceptions import TOMLKitError

from tsd_twin import robots
from tsd_twin.calibration.drive_log import Recording
from tsd_twin.calibration.fit import CalibrationFit
from tsd_twin.cli import experiment
from tsd_twin.errors import RobotFileError
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityDescription

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TomlTables = Mapping[str, Mapping[str, Any]]
"""Keys and values by table."""


def write_description(file: str, used: str, tables: TomlTables) -> None:
    """Set keys in the description `file` and keep its comments; a new file starts from `used`.

    The file is replaced atomically.

    Raises:
        RobotFileError: If the file is not a valid description of this kind, before or after the
            change, or cannot be written.
    """
    path = Path(file)
    if path.suffix != ".toml":
        raise RobotFileError(file, "is no place for a description", "a name that ends in .toml")
    text = edit_description(robots.read_description(file) if path.exists() else used, file, tables)
    temporary = path.with_name(f".{path.name}.new")
    try:
        temporary.write_text(text, encoding="utf-8")
        temporary.replace(path)
    except OSError as error:
        raise RobotFileError(file, f"cannot be written: {error.strerror}") from error


def edit_description(text: str, file: str, tables: TomlTables) -> str:
    """Return the TOML text of a description with changed values.

    Raises:
        RobotFileError: As in `write_description`.
    """
    robots.description_of_kind(robots.parse_description(text, file), SingularityDescription)
    try:
        document: Any = tomlkit.parse(text)
        for name, values in tables.items():
            if name not in document:
                document.add(tomlkit.nl())
                document.add(name, tomlkit.table())
            for key, value in values.items():
                document[name][key] = value
        changed = tomlkit.dumps(document)
    except TOMLKitError as error:
        raise RobotFileError(file, f"cannot be edited: {error}") from error
    robots.parse_description(changed, file)
    return changed


_WRITTEN_DIGITS = {"deg": 4, "m": 6, "1": 5}
"""Number of written digits of each unit."""
_PRINTED_UNITS = {"deg": ("deg", 1.0, 3), "m": ("mm", 1000.0, 2), "1": ("", 1.0, 5)}
"""Printed unit, factor and number of digits."""


@dataclass(frozen=True, slots=True, eq=False)
class ParameterRow:
    """Robot parameter: before, fitted, and true if known."""

    name: str
    unit: str
    before: float
    found: float
    sigma: float
    true: float | None


def parameter_table(
    robot: SingularityDescription, found: CalibrationFit, true: SingularityDescription | None
) -> list[ParameterRow]:
    """Return the parameter table: described, fitted and, if known, true values."""
    before, by, sigma = _parameters(robot), found.found, found.sigma
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
    known = [None] * len(before) if true is None else _parameters(true).tolist()
    parts = ("alpha", "beta")
    names = [f"module{i + 1}_{part}" for i in range(robot.drive.modules) for part in parts]
    names += ["wheel_radius", "pivot_radius"]
    names += [f"module{i + 1}_spin" for i in range(robot.drive.modules)]
    units = ["deg"] * angles + ["m"] * 2 + ["1"] * robot.drive.modules
    each = zip(names, units, before.tolist(), after.tolist(), spread.tolist(), known, strict=True)
    return [ParameterRow(*values) for values in each]


def _parameters(robot: SingularityDescription) -> Array:
    """Return zeros (2k) in degrees, both radii, and wheel-speed scales (k).

    The pivot radius is the root mean square if pivot distances differ.
    """
    trim, drive = robot.actuator_offsets(), robot.drive
    offset = np.degrees(trim.offset).reshape(-1, 3)[:, :2]
    radii = [drive.wheel_radius_m, drive.rms_radius_m]
    return np.concatenate([offset.ravel(), radii, trim.scale.reshape(-1, 3)[:, 2]])


def description_changes(
    rows: list[ParameterRow], robot: SingularityDescription
) -> dict[str, dict[str, Any]]:
    """Return the description keys with the fitted values.

    The error of radius times wheel speed replaces that of the motor table.
    """
    values = {row.name: round(row.found, _WRITTEN_DIGITS[row.unit]) for row in rows}
    by_unit = {
        unit: [values[row.name] for row in rows if row.unit == unit] for unit in _WRITTEN_DIGITS
    }
    angles = by_unit["deg"]
    moved = robot.drive.with_rms_radius(values["pivot_radius"]).positions
    digits = _WRITTEN_DIGITS["m"]
    pivots: dict[str, Any] = (
        {"modules": [{"x_m": round(p.x_m, digits), "y_m": round(p.y_m, digits)} for p in moved]}
        if moved
        else {"pivot_radius_m": values["pivot_radius"]}
    )
    return {
        "drive": {**pivots, "wheel_radius_m": values["wheel_radius"]},
        "calibration": {
            "tilt_offset_deg": [angles[i : i + 2] for i in range(0, len(angles), 2)],
            "spin_scale": by_unit["1"],
        },
        "errors": {"motor_share": round(_speed_sigma(rows), _WRITTEN_DIGITS["1"])},
    }


def _speed_sigma(rows: list[ParameterRow]) -> float:
    """Return the relative standard deviation of wheel radius times the speed of any wheel."""
    share = {row.name: row.sigma / row.found for row in rows if row.unit != "deg"}
    spins = [share[row.name] for row in rows if row.unit == "1"]
    return math.hypot(share["wheel_radius"], max(spins))


def parameter_columns(rows: Sequence[ParameterRow]) -> dict[str, list[Any]]:
    """Return the columns of a table."""
    names = ("name", "unit", "before", "found", "sigma", "true")
    return {
        name: ["" if (value := getattr(row, name)) is None else value for row in rows]
        for name in names
    }


def parameter_lines(rows: Sequence[ParameterRow]) -> list[str]:
    """Return the rows to print."""
    known = rows[0].true is not None
    heads = ("before", "found", "+-", *(("true",) if known else ()))
    shown = [f"{'':19}" + "".join(f"{head:>9}" for head in heads)]
    for row in rows:
        unit, factor, digits = _PRINTED_UNITS[row.unit]
        values = (row.before, row.found, row.sigma, row.true)
        numbers = "".join(f"{factor * v:9.{digits}f}" for v in values if v is not None)
        shown.append(f"  {row.name:13} {unit:3}{numbers}")
    return shown


def draw_calibration(
    recordings: Sequence[Recording], found: CalibrationFit, rows: Sequence[ParameterRow]
) -> Figure:
    """Draw the calibration figure."""
    figure: Any = experiment.new_figure(11.0, 4.6, "Calibration from driven squares")
    left, middle, right = figure.subplots(1, 3, width_ratios=[1.2, 1.0, 1.0])
    for residuals, colour, style, name in (
        (found.before, experiment.REFERENCE_COLOUR, "--", "before"),
        (found.after, experiment.TRUTH_COLOUR, "-", "after"),
    ):
        for i, (each, residual) in enumerate(zip(recordings, residuals, strict=True)):
            left.semilogy(
                each.camera_s - each.t_s[0],
                1000 * np.hypot(residual[:, 0], residual[:, 1]),
                style,
                color=colour,
                linewidth=0.9,
                label=name if i == 0 else None,
            )
    experiment.label_axes(left, "time (s)", "camera to joints (mm)", "position, all runs")
    experiment.add_legend(left)
    _bars(middle, [row for row in rows if row.unit == "deg"], "deg", 1.0)
    _bars(right, [row for row in rows if row.unit != "deg"], "%", 100.0)
    return figure


def _bars(axes: experiment.Axes, rows: list[ParameterRow], unit: str, scale: float) -> None:
    """Draw the parameter errors, or the changes if the true values are unknown."""
    at = np.arange(len(rows))[::-1]
    sizes = np.array([abs(row.before) if row.unit == "m" else 1.0 for row in rows])
    true = np.array([row.before if row.true is None else row.true for row in rows])
    before = scale * (np.array([row.before for row in rows]) - true) / sizes
    found = scale * (np.array([row.found for row in rows]) - true) / sizes
    spread = scale * 2.0 * np.array([row.sigma for row in rows]) / sizes
    known = rows[0].true is not None
    axes.barh(at, before, 0.7, color="#d9dee5", label="before")
    axes.errorbar(
        found,
        at,
        xerr=spread,
        fmt="o",
        color=experiment.TRUTH_COLOUR,
        markersize=4,
        capsize=3,
        label="found",
    )
    axes.set_yticks(at, [row.name for row in rows])
    title = "against the truth, 2 s.d." if known else "against the description, 2 s.d."
    experiment.label_axes(axes, f"{'error' if known else 'change'} ({unit})", "", title)
    experiment.add_legend(axes, loc="best")
