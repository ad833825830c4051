"""Which error costs how much on the open-loop square of the thesis: one at a time, and together."""

from __future__ import annotations

import argparse
from functools import reduce
from operator import add
from typing import Any

import numpy as np

from tsd_twin import robots
from tsd_twin.errors import TwinError
from tsd_twin.lab import look, shapes
from tsd_twin.lab.experiment import Experiment
from tsd_twin.lab.one_square import THESIS_SHARE, sharp
from tsd_twin.lab.open_square import Errors, Outcome, drive_open
from tsd_twin.lab.output import Output
from tsd_twin.lab.sources import LINE, SOURCES, Source
from tsd_twin.lie import Array
from tsd_twin.motion.route import Route
from tsd_twin.robots import SingularityRobot, of_kind

_ALL = "all of these"
AT_ONCE = 1000
"""Robots in lockstep: their arrays stay in the processor's cache."""


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Drive the square with each error alone and with all together; draw what each costs."""
    if args.runs < 1:
        raise TwinError(f"--runs must be 1 or more, not {args.runs}")
    robot = of_kind(robots.load(args.robot), SingularityRobot)
    cases = {source.name: [source] for source in SOURCES}
    cases |= {_ALL: list(SOURCES), LINE.name: [LINE], "all and the line": [*SOURCES, LINE]}
    jobs = [
        (name, at) for name, used in cases.items() for at in range(0, _runs(args, used), AT_ONCE)
    ]
    random = np.random.default_rng(args.seed)
    errors = {name: _drawn(robot, random, used, _runs(args, used)) for name, used in cases.items()}
    trajectory = sharp(Route(shapes.shape("square")))
    found: dict[str, list[Outcome]] = {name: [] for name in cases}
    for name, at in out.progress(jobs, "driving squares", len(jobs)):
        part = errors[name].part(slice(at, at + AT_ONCE))
        found[name].append(drive_open(robot, trajectory, part))
    worst = {
        name: 100.0 * np.concatenate([outcome.worst_m for outcome in outcomes])
        for name, outcomes in found.items()
    }
    middle, high = (
        {name: float(np.quantile(values, share)) for name, values in worst.items()}
        for share in (0.5, 0.95)
    )
    out.table(
        "budget",
        {
            "source": list(worst),
            "size": ["; ".join(source.size for source in used) for used in cases.values()],
            "runs": [len(values) for values in worst.values()],
            "median_percent": list(middle.values()),
            "p95_percent": list(high.values()),
        },
    )
    _draw(worst, middle, high, out)
    lines = [
        "largest error of position on the open-loop square, % of the side (median, 95 of 100):"
    ]
    lines += [f"  {name:20} {middle[name]:5.1f} {high[name]:5.1f}" for name in worst]
    return [*lines, f"  the thesis reports at most {100 * THESIS_SHARE:.0f}"]


def _runs(args: argparse.Namespace, used: list[Source]) -> int:
    """Return the number of runs: with one error alone, a tenth is enough."""
    return int(args.runs) if len(used) > 1 else max(1, int(args.runs) // 10)


def _drawn(
    robot: SingularityRobot, random: np.random.Generator, used: list[Source], runs: int
) -> Errors:
    return reduce(add, (source.draw(robot, random, runs) for source in used))


def _draw(
    worst: dict[str, Array], middle: dict[str, float], high: dict[str, float], out: Output
) -> None:
    figure: Any = look.figure(10.0, 4.4, "What each error costs on the open-loop square")
    left, right = figure.subplots(1, 2, width_ratios=[1.3, 1.0])
    names = list(worst)[::-1]
    rows = np.arange(len(names))
    left.barh(rows, [high[n] for n in names], 0.7, color="#f0c8b4", label="95 of 100 runs")
    left.barh(rows, [middle[n] for n in names], 0.7, color=look.TRUTH, label="half of all runs")
    left.set_yticks(rows, names)
    left.axvline(100 * THESIS_SHARE, color=look.REFERENCE, linestyle="--", linewidth=1.0)
    look.dress(left, "largest error of position (% of the side)", "", "one at a time, and together")
    look.legend(left, loc="upper right")
    right.hist(worst[_ALL], 60, color=look.TRUTH)
    right.axvline(
        100 * THESIS_SHARE, color=look.REFERENCE, linestyle="--", linewidth=1.0, label="thesis"
    )
    look.dress(
        right, "largest error of position (% of the side)", "runs", "all of them, run by run"
    )
    look.legend(right)
    out.picture("budget", figure)


def _flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--robot", default="tsd", metavar="NAME|FILE", help="default tsd")
    parser.add_argument("--seed", type=int, default=0, help="of all errors; default 0")
    parser.add_argument(
        "--runs", type=int, default=10_000, help="with all errors together; default 10,000"
    )


EXPERIMENT = Experiment(
    name="budget",
    purpose="Which error costs how much on the open-loop square: one at a time, and together.",
    run=run,
    examples=["tsd-lab budget --out lab", "tsd-lab budget --runs 1000 --seed 1"],
    add_flags=_flags,
)
