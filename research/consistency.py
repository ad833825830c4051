"""Study `consistency`: agreement between estimation errors and their covariances."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import gammaincinv  # pyright: ignore

from research.open_loop import (
    BY_NAME,
    CONSTANT,
    DEAD_WHEELS,
    GYRO,
    JOINTS,
    MOUNTED,
    TIMES_S,
    Case,
    Consistency,
    collected,
    drive,
    drives,
)
from research.sphere import SPHERE_MANOEUVRES, compare_sphere
from tsd_twin import robots
from tsd_twin.cli import experiment, flags
from tsd_twin.cli.experiment import Experiment, Output
from tsd_twin.errors import TwinError
from tsd_twin.estimation import REGION_SHARE
from tsd_twin.lie import SE2
from tsd_twin.robots import OmniDescription, RobotDescription
from tsd_twin.simulation import PLANTS


def band(seeds: int) -> tuple[float, float]:
    """Return the 95 % interval of the mean NEES of `seeds` consistent robots."""
    low, high = (2.0 * float(gammaincinv(1.5 * seeds, share)) / seeds for share in (0.025, 0.975))
    return low, high


def cases(args: argparse.Namespace) -> list[Case]:
    """Return the rows of the table.

    Raises:
        TwinError: If a robot, manoeuvre or plant does not exist, a robot does not drive over a
            floor, or no robot has such sensors.
    """
    made: list[Case] = []
    for name in args.robots:
        robot = robots.load_robot(name)
        slides = isinstance(robot, OmniDescription) or args.plant == "mujoco"
        if args.friction is not None and not slides:
            raise TwinError(f"{name} has no friction on this plant: use --plant mujoco")
        known: Iterable[str] = BY_NAME
        if robot.kinematics().pose_type is not SE2:
            known = SPHERE_MANOEUVRES
        for manoeuvre in args.manoeuvres or known:
            if manoeuvre not in known:
                raise TwinError(f"{name} has no manoeuvre '{manoeuvre}': {', '.join(known)}")
            case = Case(name, manoeuvre, plant=args.plant, seeds=args.seeds, first=args.seed)
            case = replace(case, friction=args.friction)
            if known is SPHERE_MANOEUVRES:
                made.append(replace(case, odometry=JOINTS, plant="kinematic"))
                continue
            made.extend(case for case in _variants(case, robot) if _applies(case))
    wanted = args.sensors or [case.sensors for case in made]
    unknown = set(wanted) - {case.sensors for case in made}
    if unknown:
        sensors = "; ".join(dict.fromkeys(case.sensors for case in made))
        raise TwinError(f"none of these robots has the sensors '{min(unknown)}': {sensors}")
    return [case for case in made if case.sensors in wanted]


def _turns(case: Case) -> bool:
    """Return whether the robot turns a sphere in place."""
    return robots.load_robot(case.robot).kinematics().pose_type is not SE2


def _variants(case: Case, robot: RobotDescription) -> Iterable[Case]:
    """Yield a case with and without errors, gyro, tracking wheels and camera."""
    odometry = [JOINTS, GYRO]
    if isinstance(robot, OmniDescription) and robot.dead_wheels is not None:
        odometry.append(DEAD_WHEELS)
    for errors in (0.0, 1.0) if robot.with_errors(0.0) != robot else (0.0,):
        for used in odometry:
            for camera in ("", MOUNTED):
                yield replace(case, errors=errors, odometry=used, camera=camera)
    yield replace(case, odometry=JOINTS, camera=CONSTANT)


def _applies(case: Case) -> bool:
    """Return whether the manoeuvre is possible for the robot and has any uncertainty."""
    robot = robots.load_robot(case.robot)
    spins = robot.wheel_speed_range is not None
    if BY_NAME[case.manoeuvre].drive_speeds and not spins:
        return False
    return spins or case.manoeuvre != "standing"


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Consistency of estimates with their covariances: the NEES of many robots."""
    rows = cases(args)
    spheres = [case for case in rows if case.manoeuvre in SPHERE_MANOEUVRES and _turns(case)]
    driven = [case for case in rows if case not in spheres]
    made = drives(driven)
    results = collected(driven, made, experiment.run_cases(drive, made, args.jobs, out))
    results += experiment.run_cases(compare_sphere, spheres, args.jobs, out)
    out.table("consistency", _columns(results))
    _draw(results, out)
    low, high = band(args.seeds)
    times = ", ".join(f"{t_s:g}" for t_s in TIMES_S)
    lines = [
        f"mean NEES of x, y and heading after {times} s (3 expected, "
        f"{low:.1f} to {high:.1f} in 95 of 100 means of {args.seeds} robots);",
        f"shares of the positions in the drawn region and of the headings in the wedge after "
        f"{TIMES_S[-1]:g} s ({100.0 * REGION_SHARE:.0f} % expected)",
    ]
    for name in dict.fromkeys(case.robot for case in rows):
        own = [result for result in results if result.case.robot == name]
        lines += ["", f"{name}, NEES:", *_table(own, _nees)]
        lines += ["", f"{name}, in region and in wedge:", *_table(own, _shares)]
    return [*lines, "", _extremes(results)]


def _columns(results: Sequence[Consistency]) -> dict[str, Sequence[float | str]]:
    columns: dict[str, Sequence[float | str]] = {
        "robot": [result.case.robot for result in results],
        "plant": [result.case.plant for result in results],
        "errors": [result.case.errors for result in results],
        "sensors": [result.case.sensors for result in results],
        "manoeuvre": [result.case.manoeuvre for result in results],
    }
    for i, t_s in enumerate(TIMES_S):
        columns[f"nees_{t_s:g}_s"] = [float(result.means[i]) for result in results]
        columns[f"median_{t_s:g}_s"] = [float(np.median(result.nees[i])) for result in results]
        columns[f"inside_{t_s:g}_s"] = [float(result.coverage[i]) for result in results]
        columns[f"heading_{t_s:g}_s"] = [float(result.heading_coverage[i]) for result in results]
    return columns


def _table(results: Sequence[Consistency], cell: Callable[[Consistency], str]) -> list[str]:
    """Return the Markdown table of a robot: manoeuvres by sensors."""
    sensors = list(dict.fromkeys(result.case.sensors for result in results))
    cells: dict[tuple[str, str], dict[str, str]] = {}
    for result in results:
        case = result.case
        cells.setdefault((f"{case.errors:g}", case.manoeuvre), {})[case.sensors] = cell(result)
    rows = [[*key, *(row.get(each, "") for each in sensors)] for key, row in cells.items()]
    return experiment.markdown_table(["errors", "manoeuvre", *sensors], rows)


def _nees(result: Consistency) -> str:
    return " / ".join(f"{mean:.1f}" for mean in result.means)


def _shares(result: Consistency) -> str:
    shares = (result.coverage[-1], result.heading_coverage[-1])
    return ", ".join(f"{100.0 * share:.0f} %" for share in shares)


def _extremes(results: Sequence[Consistency]) -> str:
    """Format the smallest and largest means with their robots."""
    texts: list[str] = []
    for what, pick in (("smallest", np.argmin), ("largest", np.argmax)):
        means = np.array([result.means for result in results])
        row, i = np.unravel_index(int(pick(means)), means.shape)
        case = results[int(row)].case
        texts.append(
            f"{what} NEES {means[row, i]:.1f}: {case.robot}, errors {case.errors:g}, "
            f"{case.sensors}, {case.manoeuvre}, {TIMES_S[int(i)]:g} s"
        )
    return "; ".join(texts)


def _draw(results: Sequence[Consistency], out: Output) -> None:
    figure = experiment.new_figure(9.0, 4.8, "How right estimates are about their errors")
    axes: Any = figure.subplots()
    low, high = band(results[0].case.seeds)
    axes.axhspan(low, high, color=experiment.REFERENCE_COLOUR, alpha=0.2, label="95 of 100")
    names = list(dict.fromkeys(result.case.manoeuvre for result in results))
    for i, t_s in enumerate(TIMES_S):
        places = [names.index(result.case.manoeuvre) + 0.2 * (i - 1) for result in results]
        axes.plot(
            places,
            [result.means[i] for result in results],
            "o",
            color=experiment.SERIES_COLOURS[i],
            markersize=4,
            label=f"{t_s:g} s",
        )
    axes.set_yscale("log")
    axes.set_xticks(range(len(names)), names, rotation=20)
    experiment.label_axes(axes, "", "mean NEES, 3 expected")
    experiment.add_legend(axes, ncols=2)
    out.figure("consistency", figure)


def _flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--robots",
        nargs="+",
        default=["tsd", "omni4", "kiwi", "mecanum", "atlas"],
        metavar="NAME|FILE",
        help="default tsd omni4 kiwi mecanum atlas",
    )
    parser.add_argument(
        "--manoeuvres", nargs="+", metavar="NAME", help=f"of {', '.join(BY_NAME)}; default all"
    )
    parser.add_argument(
        "--seeds", type=flags.whole(1), default=40, help="robots of each row; default 40"
    )
    parser.add_argument(
        "--sensors",
        nargs="+",
        metavar="SENSORS",
        help="rows with these, as in the table: joints, 'gyro + camera, mounted'; default all",
    )
    parser.add_argument("--plant", choices=PLANTS, default="kinematic", help="default kinematic")
    parser.add_argument(
        "--friction",
        type=flags.number(0.01),
        help="friction of the simulated floor; default as described",
    )
    experiment.add_jobs_flag(parser)


EXPERIMENT = Experiment(
    "consistency",
    run,
    [
        "python -m research consistency",
        "python -m research consistency --robots tsd kiwi --manoeuvres circle wander --seeds 10",
        "python -m research consistency --robots tsd --plant mujoco --sensors joints",
        "python -m research consistency --robots tsd --plant mujoco --friction 0.35",
    ],
    seed_of="the first robot of a row",
    add_own_flags=_flags,
)
