"""Zeros of the gimbals, radii and spins of one machine, from squares that a camera saw.

Squares driven both ways tell errors of scale and of direction apart, as in UMBmark (Borenstein and
Feng 1996); what is found here are the causes, not two factors for them.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsd_twin import robots
from tsd_twin.lab import excitation, look, recording
from tsd_twin.lab.experiment import Experiment
from tsd_twin.lab.fit import Fit, fit
from tsd_twin.lab.machine import built
from tsd_twin.lab.output import Output
from tsd_twin.lab.recording import Recording
from tsd_twin.lab.sensors import CameraNoise
from tsd_twin.lab.write_back import write_back
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityRobot, of_kind

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


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Drive or read squares, say what is wrong with the machine, and write it down."""
    robot = of_kind(robots.load(args.robot), SingularityRobot)
    true = None
    if args.log:
        recordings = recording.read(args.log, robot.drive.modules)
    else:
        true = built(robot, np.random.default_rng(args.seed))
        recordings = _simulated(robot, true, args, out)
        out.table("calibrate_log", recording.columns(recordings))
    found = fit(robot.kinematics(), recordings, CameraNoise(), robot.joint_errors())
    rows = table(robot, found, true)
    out.table("calibrate", _columns(rows))
    _draw(recordings, found, rows, out)
    lines = [_source(args, recordings), *_lines(rows), *_remarks(found)]
    if args.write_to:
        write_back(args.write_to, robots.text(args.robot), changes(rows))
        lines.append(f"written into {args.write_to}")
    return lines


def _simulated(
    robot: SingularityRobot, true: SingularityRobot, args: argparse.Namespace, out: Output
) -> list[Recording]:
    ratios = excitation.patterns(robot.drive.modules)
    ratios = ratios[:1] if args.same_speed else ratios
    return [
        excitation.drive(
            robot, true, ratio, args.seed * len(ratios) + i, tachometer=args.tachometer
        )
        for i, ratio in enumerate(out.progress(ratios, "driving squares", len(ratios)))
    ]


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


def _columns(rows: list[Row]) -> dict[str, list[Any]]:
    names = ("name", "unit", "before", "found", "sigma", "true")
    return {
        name: ["" if (value := getattr(row, name)) is None else value for row in rows]
        for name in names
    }


def _source(args: argparse.Namespace, recordings: list[Recording]) -> str:
    seconds = sum(run.t_s[-1] - run.t_s[0] for run in recordings)
    frames = sum(len(run.seen_s) for run in recordings)
    what = args.log or "simulated machine with errors of its own"
    return f"{what}: {len(recordings)} runs, {seconds:.0f} s, {frames} frames of the camera"


def _lines(rows: list[Row]) -> list[str]:
    known = rows[0].true is not None
    heads = ("before", "found", "+-", *(("true",) if known else ()))
    lines = [f"{'':19}" + "".join(f"{head:>9}" for head in heads)]
    for row in rows:
        unit, factor, digits = _SHOWN[row.unit]
        values = (row.before, row.found, row.sigma, row.true)
        numbers = "".join(f"{factor * v:9.{digits}f}" for v in values if v is not None)
        lines.append(f"  {row.name:13} {unit:3}{numbers}")
    return lines


def _remarks(found: Fit) -> list[str]:
    before, after = (1000 * _rms_m(each) for each in (found.before, found.after))
    lines = [f"camera and joints disagree by {before:.0f} mm RMS before, {after:.1f} mm after"]
    if not found.common_spin_known:
        lines.append(
            "no speed of a wheel was measured: wheel radius times the speed that all wheels have "
            "in common is known, and stands as the wheel radius"
        )
    if found.unseen:
        lines.append("these data do not tell, so it was left as small as it can be:")
        lines += [f"  {combination}" for combination in found.unseen]
    return lines


def _rms_m(residuals: list[Array]) -> float:
    squared = np.concatenate([np.square(each[:, :2]).sum(axis=1) for each in residuals])
    return float(np.sqrt(squared.mean()))


def _draw(recordings: list[Recording], found: Fit, rows: list[Row], out: Output) -> None:
    figure: Any = look.figure(11.0, 4.6, "Calibration from driven squares")
    left, middle, right = figure.subplots(1, 3, width_ratios=[1.2, 1.0, 1.0])
    for residuals, colour, style, name in (
        (found.before, look.REFERENCE, "--", "before"),
        (found.after, look.TRUTH, "-", "after"),
    ):
        for i, (each, residual) in enumerate(zip(recordings, residuals, strict=True)):
            left.semilogy(
                each.seen_s - each.t_s[0],
                1000 * np.hypot(residual[:, 0], residual[:, 1]),
                style,
                color=colour,
                linewidth=0.9,
                label=name if i == 0 else None,
            )
    look.dress(left, "time (s)", "camera to joints (mm)", "position, all runs")
    look.legend(left)
    _bars(middle, [row for row in rows if row.unit == "deg"], "error (deg)", 1.0)
    _bars(right, [row for row in rows if row.unit != "deg"], "error (%)", 100.0)
    out.picture("calibrate", figure)


def _bars(axes: look.Axes, rows: list[Row], label: str, scale: float) -> None:
    """Draw how far off figures are, or how much they changed where the truth is not known."""
    at = np.arange(len(rows))[::-1]
    sizes = np.array([abs(row.before) if row.unit == "m" else 1.0 for row in rows])
    true = np.array([row.before if row.true is None else row.true for row in rows])
    before = scale * (np.array([row.before for row in rows]) - true) / sizes
    found = scale * (np.array([row.found for row in rows]) - true) / sizes
    spread = scale * 2.0 * np.array([row.sigma for row in rows]) / sizes
    known = rows[0].true is not None
    axes.barh(at, before, 0.7, color="#d9dee5", label="before")
    axes.errorbar(
        found, at, xerr=spread, fmt="o", color=look.TRUTH, markersize=4, capsize=3, label="found"
    )
    axes.set_yticks(at, [row.name for row in rows])
    title = "against the truth, 2 s.d." if known else "against the description, 2 s.d."
    look.dress(axes, label, "", title)
    look.legend(axes, loc="best")


def _flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--robot", default="tsd", metavar="NAME|FILE", help="default tsd")
    parser.add_argument(
        "--log",
        metavar="FILE.csv",
        help="drives that were recorded, not simulated; columns as in calibrate_log.csv",
    )
    parser.add_argument(
        "--seed", type=int, default=0, help="of the machine and its noise; default 0"
    )
    parser.add_argument(
        "--tachometer",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="the simulated machine measures the speeds of its wheels; default yes",
    )
    parser.add_argument(
        "--same-speed",
        action="store_true",
        help="all wheels at one speed: to see what such drives cannot tell",
    )
    parser.add_argument(
        "--write-to",
        metavar="FILE.toml",
        help="description to put it into, its comments kept; a new one is a copy of --robot",
    )


EXPERIMENT = Experiment(
    name="calibrate",
    purpose="Zeros of the gimbals, radii and spins of one machine, from squares that a camera saw.",
    run=run,
    examples=[
        "tsd-lab calibrate --seed 1                      a simulated machine, the truth beside it",
        "tsd-lab calibrate --no-tachometer               what is left when no speed is measured",
        "tsd-lab calibrate --same-speed                  what drives at one speed cannot tell",
        "tsd-lab calibrate --log run.csv --robot my.toml --write-to my.toml    a machine of yours",
    ],
    add_flags=_flags,
)
