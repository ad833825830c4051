"""Table 1 of the thesis to its Table 2: straight lines through measured motor speeds."""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from tsd_twin import robots
from tsd_twin.lab import look
from tsd_twin.lab.experiment import Experiment
from tsd_twin.lab.output import Output
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityRobot, of_kind

Rows: TypeAlias = npt.NDArray[np.bool_]
"""(r,): some of the rows of the table."""


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """Least-squares lines rpm = slope signal + offset, one for each of k motors."""

    slope: Array
    """(k,): rpm for each unit of the signal."""
    offset: Array
    """(k,): rpm."""
    used: Rows
    """(r,): which rows of the table were fitted."""

    def rpm(self, signal: Array) -> Array:
        """Return the speeds (k, ...) at `signal` (...)."""
        return np.multiply.outer(self.slope, signal) + self.offset.reshape(-1, *[1] * signal.ndim)

    def error_rpm(self, signal: Array, rpm: Array, where: Rows) -> Array:
        """Return the root mean square errors (k,) over the rows `where` (r,) of a table."""
        off = (self.rpm(signal) - rpm)[:, where]
        return np.sqrt(np.mean(np.square(off), axis=-1))


def fit(signal: Array, rpm: Array, used: Rows) -> Lines:
    """Return the lines through the rows `used` (r,) of signal (r,) and rpm (k, r)."""
    x: Array = signal[used]
    y: Array = rpm[:, used]
    slope: Array = ((x - x.mean()) * (y - y.mean(axis=1, keepdims=True))).sum(axis=1)
    slope = slope / np.square(x - x.mean()).sum()
    return Lines(slope, y.mean(axis=1) - slope * x.mean(), used)


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Fit both lines, draw them and say which predicts better."""
    robot = of_kind(robots.load(args.robot), SingularityRobot)
    signal, rpm = np.array(robot.motor.signal), np.array(robot.motor.speed_rpm)
    turning: Rows = np.asarray((rpm > 0.0).all(axis=0))
    every: Rows = np.ones(len(signal), dtype=bool)
    all_rows, working = (fit(signal, rpm, used) for used in (every, turning))
    columns = {"signal": signal} | {f"motor{i + 1}_rpm": row for i, row in enumerate(rpm)}
    for name, lines in (("all_rows", all_rows), ("working_range", working)):
        for i, row in enumerate(lines.rpm(signal)):
            columns[f"motor{i + 1}_{name}_rpm"] = row
    out.table("motors", columns)
    _draw(robot, signal, rpm, (all_rows, working), out)
    dead = ", ".join(f"{s:g}" for s in signal[~turning])
    lines = ["through all rows, as in Table 2 of the thesis (rpm = slope signal + offset):"]
    lines += _said(all_rows, signal, rpm, turning)
    lines += [f"without the dead zone (signals {dead}), which fits where motors turn:"]
    lines += _said(working, signal, rpm, turning)
    return lines


def _said(lines: Lines, signal: Array, rpm: Array, turning: Rows) -> list[str]:
    errors = lines.error_rpm(signal, rpm, turning)
    return [
        f"  motor {i + 1}: {rounded(slope, 2)} / {rounded(offset, 1)}"
        f"    off by {error:.0f} rpm RMS where it turns"
        for i, (slope, offset, error) in enumerate(
            zip(lines.slope.tolist(), lines.offset.tolist(), errors.tolist(), strict=True)
        )
    ]


def rounded(value: float, digits: int) -> str:
    """Return a number as the thesis rounds: halves away from zero."""
    return f"{value + math.copysign(1e-9, value):.{digits}f}"


def _draw(
    robot: SingularityRobot, signal: Array, rpm: Array, lines: tuple[Lines, Lines], out: Output
) -> None:
    figure = look.figure(10.0, 4.2, f"Motors of {robot.title.lower()}: speed against signal")
    left, right = figure.subplots(1, 2)
    fine = np.linspace(float(signal[0]), float(signal[-1]), 200)
    for i, row in enumerate(rpm):
        left.plot(signal, row, "o", color=look.SERIES[i], markersize=5, label=f"motor {i + 1}")
        for of, style in zip(lines, ("--", "-"), strict=True):
            left.plot(fine, of.rpm(fine)[i], style, color=look.SERIES[i], linewidth=1.0)
    left.axhline(robot.motor.start_speed_rpm, color=look.REFERENCE, linewidth=0.8, linestyle=":")
    left.annotate(
        "below, motors stand still",
        (signal[-1], robot.motor.start_speed_rpm),
        xytext=(0, -12),
        textcoords="offset points",
        ha="right",
        fontsize=8,
        color=look.REFERENCE,
    )
    look.dress(left, "throttle signal", "speed (rpm)", "dashed: all rows; solid: where they turn")
    look.legend(left)
    width = 0.35
    turning = lines[1].used
    for shift, of, name, colour in zip(
        (-0.5, 0.5), lines, ("all rows", "where they turn"), look.SERIES, strict=False
    ):
        errors = of.error_rpm(signal, rpm, turning)
        right.bar(np.arange(len(rpm)) + shift * width, errors, width, color=colour, label=name)
    right.set_xticks(range(len(rpm)), [f"motor {i + 1}" for i in range(len(rpm))])
    look.dress(right, "", "RMS error where they turn (rpm)", "which line predicts better")
    look.legend(right, title="fitted to", title_fontsize=9)
    out.picture("motors", figure)


def _flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--robot", default="tsd", metavar="NAME|FILE", help="default tsd")


EXPERIMENT = Experiment(
    name="motors",
    purpose="Lines through the motor table: Table 1 of the thesis to its Table 2, and better.",
    run=run,
    examples=["tsd-lab motors --out lab", "tsd-lab motors --robot my.toml"],
    add_flags=_flags,
)
