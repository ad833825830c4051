"""Experiment `motors`: from Table 1 of the thesis to its Table 2, line fits of motor speeds."""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from tsd_twin import robots
from tsd_twin.cli import experiment
from tsd_twin.cli.experiment import Experiment, Output
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityDescription, description_of_kind

RowMask: TypeAlias = npt.NDArray[np.bool_]
"""(r,): mask of rows of the table."""


@dataclass(frozen=True, slots=True, eq=False)
class MotorLines:
    """Least-squares lines rpm = slope signal + offset, one per motor."""

    slope: Array
    """(k,): rpm per unit of the signal."""
    offset: Array
    """(k,): rpm."""
    used: RowMask
    """(r,): mask of the fitted rows of the table."""

    def rpm(self, signal: Array) -> Array:
        """Return the speeds (k, ...) at `signal` (...)."""
        return np.multiply.outer(self.slope, signal) + self.offset.reshape(-1, *[1] * signal.ndim)

    def error_rpm(self, signal: Array, rpm: Array, where: RowMask) -> Array:
        """Return the RMS errors (k,) over the rows `where` (r,) of a table."""
        off = (self.rpm(signal) - rpm)[:, where]
        return np.sqrt(np.mean(np.square(off), axis=-1))


def fit_lines(signal: Array, rpm: Array, used: RowMask) -> MotorLines:
    """Fit lines through the rows `used` (r,) of signal (r,) and rpm (k, r)."""
    x: Array = signal[used]
    y: Array = rpm[:, used]
    slope: Array = ((x - x.mean()) * (y - y.mean(axis=1, keepdims=True))).sum(axis=1)
    slope = slope / np.square(x - x.mean()).sum()
    return MotorLines(slope, y.mean(axis=1) - slope * x.mean(), used)


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Lines through the motor table: from Table 1 of the thesis to its Table 2, and better."""
    robot = description_of_kind(robots.load_robot(args.robot), SingularityDescription)
    signal, rpm = np.array(robot.motor.signal), np.array(robot.motor.speed_rpm)
    turning: RowMask = np.asarray((rpm > 0.0).all(axis=0))
    every: RowMask = np.ones(len(signal), dtype=bool)
    all_rows, working = (fit_lines(signal, rpm, used) for used in (every, turning))
    columns = {"signal": signal} | {f"motor{i + 1}_rpm": row for i, row in enumerate(rpm)}
    for name, fitted in (("all_rows", all_rows), ("working_range", working)):
        for i, row in enumerate(fitted.rpm(signal)):
            columns[f"motor{i + 1}_{name}_rpm"] = row
    out.table("motors", columns)
    _draw(robot, signal, rpm, (all_rows, working), out)
    dead = ", ".join(f"{s:g}" for s in signal[~turning])
    lines = ["through all rows, as in Table 2 of the thesis (rpm = slope signal + offset):"]
    lines += _line_summary(all_rows, signal, rpm, turning)
    lines += [f"without the dead zone (signals {dead}), which fits where motors turn:"]
    lines += _line_summary(working, signal, rpm, turning)
    return lines


def _line_summary(lines: MotorLines, signal: Array, rpm: Array, turning: RowMask) -> list[str]:
    errors = lines.error_rpm(signal, rpm, turning)
    return [
        f"  motor {i + 1}: {round_half_up(slope, 2)} / {round_half_up(offset, 1)}"
        f"    off by {error:.0f} rpm RMS where it turns"
        for i, (slope, offset, error) in enumerate(
            zip(lines.slope.tolist(), lines.offset.tolist(), errors.tolist(), strict=True)
        )
    ]


def round_half_up(value: float, digits: int) -> str:
    """Round a number as in the thesis: halves away from zero."""
    return f"{value + math.copysign(1e-9, value):.{digits}f}"


def _draw(
    robot: SingularityDescription,
    signal: Array,
    rpm: Array,
    lines: tuple[MotorLines, MotorLines],
    out: Output,
) -> None:
    figure = experiment.new_figure(
        10.0, 4.2, f"Motors of {robot.title.lower()}: speed against signal"
    )
    left, right = figure.subplots(1, 2)
    fine = np.linspace(float(signal[0]), float(signal[-1]), 200)
    for i, row in enumerate(rpm):
        left.plot(
            signal,
            row,
            "o",
            color=experiment.SERIES_COLOURS[i],
            markersize=5,
            label=f"motor {i + 1}",
        )
        for of, style in zip(lines, ("--", "-"), strict=True):
            left.plot(
                fine, of.rpm(fine)[i], style, color=experiment.SERIES_COLOURS[i], linewidth=1.0
            )
    left.axhline(
        robot.motor.start_speed_rpm, color=experiment.REFERENCE_COLOUR, linewidth=0.8, linestyle=":"
    )
    left.annotate(
        "below, motors stand still",
        (signal[-1], robot.motor.start_speed_rpm),
        xytext=(0, -12),
        textcoords="offset points",
        ha="right",
        fontsize=8,
        color=experiment.REFERENCE_COLOUR,
    )
    experiment.label_axes(
        left, "throttle signal", "speed (rpm)", "dashed: all rows; solid: where they turn"
    )
    experiment.add_legend(left)
    width = 0.35
    turning = lines[1].used
    for shift, of, name, colour in zip(
        (-0.5, 0.5), lines, ("all rows", "where they turn"), experiment.SERIES_COLOURS, strict=False
    ):
        errors = of.error_rpm(signal, rpm, turning)
        right.bar(np.arange(len(rpm)) + shift * width, errors, width, color=colour, label=name)
    right.set_xticks(range(len(rpm)), [f"motor {i + 1}" for i in range(len(rpm))])
    experiment.label_axes(
        right, "", "RMS error where they turn (rpm)", "which line predicts better"
    )
    experiment.add_legend(right, title="fitted to", title_fontsize=9)
    out.figure("motors", figure)


EXPERIMENT = Experiment(
    "motors",
    run,
    ["tsd-lab motors --out lab", "tsd-lab motors --robot my.toml"],
    robot="tsd",
)
