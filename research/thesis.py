"""Study `thesis`: two explanations of the square of the thesis, its motor line and its floor."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from research.budget import (
    ERROR_SOURCES,
    MOTOR_LINE,
    OpenLoopErrors,
    drawn_errors,
    drive_open_loop,
    spin_error_of_line,
    with_exact_motor_table,
)
from tsd_twin import robots
from tsd_twin.cli import experiment, flags
from tsd_twin.cli.experiment import Experiment, Output
from tsd_twin.lab import tracking
from tsd_twin.lab.square import THESIS_ROBOT, THESIS_SHARE, unlimited_trajectory
from tsd_twin.lie import Array
from tsd_twin.motion.routes import Route
from tsd_twin.robots import SingularityDescription, description_of_kind

SPEEDS_RPM = (2500.0, 3000.0, 3750.0, 5000.0, 6000.0, 8000.0, 10000.0)
"""Wheel speeds; the thesis states none for the square."""
NO_LOAD_RPM_PER_V, SUPPLY_V = 1100.0, 12.0
"""Motor constant and supply voltage in the text of the thesis."""


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """Explanation: the speed commands of the motors, and the friction of the floor."""

    name: str
    uses_line: bool
    friction: float


HYPOTHESES = (
    Hypothesis("table, friction 0.8", uses_line=False, friction=0.8),
    Hypothesis("line, friction 0.8", uses_line=True, friction=0.8),
    Hypothesis("table, friction 0.2", uses_line=False, friction=0.2),
    Hypothesis("line, friction 0.5", uses_line=True, friction=0.5),
)


def robot_at(speed_rpm: float, friction: float = 0.8) -> SingularityDescription:
    """Return the robot of the thesis at a wheel speed, on a floor; Table 1 is taken to be right."""
    robot = description_of_kind(robots.load_robot(THESIS_ROBOT), SingularityDescription)
    return msgspec.structs.replace(
        with_exact_motor_table(robot),
        drive=msgspec.structs.replace(robot.drive, cruise_speed_rpm=speed_rpm),
        floor=msgspec.structs.replace(robot.floor, friction=friction),
    )


def drive_squares(hypothesis: Hypothesis, speed_rpm: float, runs: int, seed: int) -> OpenLoopErrors:
    """Drive the open-loop square with all other errors, `runs` robots in lockstep."""
    robot = robot_at(speed_rpm, hypothesis.friction)
    used = [*ERROR_SOURCES, MOTOR_LINE] if hypothesis.uses_line else list(ERROR_SOURCES)
    errors = drawn_errors(robot, np.random.default_rng(seed), used, runs)
    return drive_open_loop(
        robot, unlimited_trajectory(Route(tracking.named_path("square"))), errors
    )


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Compare both explanations of the thesis's square at each wheel speed."""
    excess = np.array([100.0 * spin_error_of_line(robot_at(rpm)) for rpm in SPEEDS_RPM])
    jobs = [(each, rpm) for each in HYPOTHESES for rpm in SPEEDS_RPM]
    found = [
        drive_squares(each, rpm, args.runs, args.seed)
        for each, rpm in out.progress(jobs, "driving squares", len(jobs))
    ]
    line, speed, turned = (
        np.array([scale * np.quantile(getattr(each, key), shares) for each in found]).reshape(
            len(HYPOTHESES), len(SPEEDS_RPM), len(shares)
        )
        for key, scale, shares in (
            ("line_m", 100.0, [0.5, 0.95]),
            ("speed_mps", 1.0, [0.5]),
            ("turned_rad", 180.0 / np.pi, [0.5]),
        )
    )
    columns: dict[str, Array | Sequence[float | str]] = {"wheel_rpm": list(SPEEDS_RPM)}
    columns |= {f"motor{i + 1}_excess_percent": excess[:, i] for i in range(excess.shape[1])}
    for k, each in enumerate(HYPOTHESES):
        key = each.name.replace(", ", "_").replace(" ", "_")
        columns |= {
            f"{key}_line_median_percent": line[k, :, 0],
            f"{key}_line_p95_percent": line[k, :, 1],
            f"{key}_speed_mps": speed[k, :, 0],
            f"{key}_turned_deg": turned[k, :, 0],
        }
    out.table("thesis", columns)
    _draw(excess, line[..., 0], speed[..., 0], out)
    lines = ["motors driven by the line of Table 2, against Table 1: wheels faster by, %"]
    lines += [
        f"  {rpm:6.0f} rpm  " + "".join(f"{share:+7.1f}" for share in row)
        for rpm, row in zip(SPEEDS_RPM, excess.tolist(), strict=True)
    ]
    lines.append(
        f"square, {args.runs} robots with all other errors: from the line %, median / 95 of 100; "
        "speed on straights m/s; turn within a straight deg"
    )
    for k, each in enumerate(HYPOTHESES):
        lines.append(f"  {each.name}:")
        lines += [
            f"  {rpm:6.0f} rpm  {line[k, j, 0]:6.1f} / {line[k, j, 1]:4.1f}"
            f"   {speed[k, j, 0]:6.3f} {turned[k, j, 0]:6.1f}"
            for j, rpm in enumerate(SPEEDS_RPM)
        ]
    return [*lines, _no_load_line()]


def _no_load_line() -> str:
    """Compare the fastest row of Table 1 with the no-load speed in the text."""
    top_rpm = np.array([row[-1] for row in robot_at(SPEEDS_RPM[0]).motor.speed_rpm])
    text_rpm = NO_LOAD_RPM_PER_V * SUPPLY_V
    shares = ", ".join(f"{100.0 * (rpm / text_rpm - 1.0):+.1f}" for rpm in top_rpm)
    return (
        f"top row of Table 1 against {text_rpm:.0f} rpm in the text "
        f"({NO_LOAD_RPM_PER_V:.0f} rpm/V at {SUPPLY_V:g} V): {shares} %"
    )


def _draw(excess: Array, line: Array, speed: Array, out: Output) -> None:
    figure = experiment.new_figure(11.0, 4.0, "The square of the thesis: line of Table 2, or floor")
    panels: Any = figure.subplots(1, 3)
    for i in range(excess.shape[1]):
        colour = experiment.SERIES_COLOURS[i]
        panels[0].plot(SPEEDS_RPM, excess[:, i], "o-", color=colour, label=f"motor {i + 1}")
    for k, each in enumerate(HYPOTHESES):
        style: dict[str, Any] = {"color": experiment.SERIES_COLOURS[k], "label": each.name}
        marks = "o-" if each.uses_line else "s--"
        panels[1].plot(SPEEDS_RPM, line[k], marks, **style)
        panels[2].plot(SPEEDS_RPM, speed[k], marks, **style)
    reference: dict[str, Any] = {"color": experiment.REFERENCE_COLOUR, "linestyle": ":"}
    panels[0].axhline(0.0, **reference)
    panels[1].axhline(100.0 * THESIS_SHARE, **reference, label="thesis: at most")
    panels[2].axhline(1.0, **reference, label="thesis: faster than")
    labels = ("wheels too fast (%)", "from the line (% of the side)", "speed on straights (m/s)")
    for axis, label in zip(panels, labels, strict=True):
        experiment.label_axes(axis, "commanded wheel speed (rpm)", label)
        experiment.add_legend(axis)
    out.figure("thesis", figure)


def _add_flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--runs", type=flags.whole(1), default=400, help="robots of each row; default 400"
    )


EXPERIMENT = Experiment(
    "thesis",
    run,
    ["python -m research thesis", "python -m research thesis --runs 2000 --seed 1"],
    seed_of="all errors",
    add_own_flags=_add_flags,
)
