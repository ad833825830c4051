"""Study `alarms`: false alarms of the consistency monitor, and detected tilt offsets."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from tsd_twin import robots
from tsd_twin.cli import experiment, flags
from tsd_twin.cli.experiment import Experiment, Output
from tsd_twin.client.virtual import PERIOD_S
from tsd_twin.client.virtual_robot import VirtualRobot
from tsd_twin.errors import TwinError
from tsd_twin.estimation.consistency import FALSE_ALARM
from tsd_twin.kinematics import JointKind, Kinematics
from tsd_twin.lab.manoeuvres import MANOEUVRES, TwistAt
from tsd_twin.lie import Array
from tsd_twin.messages.status import ConsistencyStatus
from tsd_twin.simulation import PLANTS, SimRobot

_STATUS_PERIODS = 5
"""Control periods between two statuses."""


@dataclass(frozen=True, slots=True)
class Case:
    """Table row: identical robots with individual errors."""

    robot: str
    plant: str
    errors: float
    seeds: int
    first: int = 0
    """Seed of the first robot."""


class OffsetRobot(SimRobot):
    """Simulated robot with an offset on one gimbal."""

    offset: Array | float = 0.0
    """(n,): offset added to the setpoint."""

    def write(self, setpoint: Array, now_s: float) -> None:
        """Apply a setpoint (n,) with the offset."""
        super().write(setpoint + self.offset, now_s)


def _robots(case: Case) -> Iterator[tuple[VirtualRobot, OffsetRobot, np.random.Generator]]:
    """Yield the armed robots of a case, each with a random generator."""
    robot = robots.load_robot(case.robot)
    for seed in range(case.first, case.first + case.seeds):
        simulated = OffsetRobot(robot, seed, 1.0, plant=case.plant, errors=case.errors)
        yield VirtualRobot(robot, simulated), simulated, np.random.default_rng([seed, 5])


def _statuses(
    virtual: VirtualRobot, twist_at: TwistAt, seconds: float
) -> Iterator[ConsistencyStatus]:
    """Drive, and yield the consistency section of each status."""
    for i in range(round(seconds / PERIOD_S)):
        virtual.drive(np.array(twist_at(i * PERIOD_S)))
        if i % _STATUS_PERIODS == _STATUS_PERIODS - 1:
            yield virtual.status().consistency


@dataclass(frozen=True, slots=True, eq=False)
class FalseAlarms:
    """Healthy robots on one manoeuvre."""

    case: Case
    manoeuvre: str
    levels: Array
    """Test statistic relative to its threshold, for each status."""

    @property
    def alarms(self) -> int:
        """Number of statuses that name an actuator."""
        return int(np.count_nonzero(self.levels > 1.0))


def false_alarms(case: Case, manoeuvre: str, seconds: float) -> FalseAlarms:
    """Drive healthy robots for `seconds` each."""
    levels = [
        status.level
        for virtual, _, random in _robots(case)
        for status in _statuses(virtual, MANOEUVRES[manoeuvre](random), seconds)
    ]
    return FalseAlarms(case, manoeuvre, np.array(levels))


# Faults.

_SETTLED_S = 1.5
"""Time at 1 m/s before the offset."""
WITHIN_S = 0.5
_AFTER_S = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """Robots at 1 m/s with an offset on one gimbal."""

    case: Case
    offset_deg: float
    found: Array
    """(trials,): whether an actuator was named within 0.5 s."""
    named: Array
    """(trials,): whether the correct actuator was named."""
    first: Array
    """(trials,): whether the first named actuator was correct."""


def detection(case: Case, offset_deg: float, trials: int) -> Detection:
    """Offset randomly chosen gimbals, `trials` times per robot."""
    results: list[tuple[bool, bool, bool]] = []
    for virtual, simulated, random in _robots(case):
        kinematics = virtual.controller.robot.kinematics()
        gimbals = _gimbals(kinematics)
        for _ in range(trials):
            angle, joint = random.uniform(0.0, 2.0 * np.pi), int(random.choice(gimbals))
            twist = (math.cos(angle), math.sin(angle), 0.0)
            list(_statuses(virtual, lambda _, twist=twist: twist, _SETTLED_S))
            offset = np.zeros(len(kinematics.joints))
            offset[joint] = random.choice([-1.0, 1.0]) * math.radians(offset_deg)
            simulated.offset = offset
            within = list(_statuses(virtual, lambda _, twist=twist: twist, WITHIN_S))
            names = [status.suspect for status in within if status.suspect is not None]
            right = kinematics.joints[joint].name.rpartition("_")[0]
            results.append((bool(names), right in names, names[:1] == [right]))
            simulated.offset = 0.0
            list(_statuses(virtual, lambda _, twist=twist: twist, _AFTER_S))
    found, named, first = np.array(results).T
    return Detection(case, offset_deg, found, named, first)


def _gimbals(kinematics: Kinematics[Any]) -> list[int]:
    """Return the indices of the position joints."""
    return [i for i, joint in enumerate(kinematics.joints) if joint.kind is JointKind.POSITION]


# Tables.


_Call: TypeAlias = tuple[Callable[..., FalseAlarms | Detection], tuple[Any, ...]]


def _perform(call: _Call) -> FalseAlarms | Detection:
    function, arguments = call
    return function(*arguments)


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """False alarms of the consistency monitor on healthy robots, and detected tilt offsets."""
    if not _gimbals(robots.load_robot(args.robot).kinematics()):
        raise TwinError(f"{args.robot} has no gimbals: none of them can be aside")
    cases = [Case(args.robot, args.plant, errors, args.seeds, args.seed) for errors in (0.0, 1.0)]
    driven = [(case, name, args.seconds) for case in cases for name in MANOEUVRES]
    offset = [(case, deg, args.trials) for case in cases for deg in args.offsets_deg]
    calls: list[_Call] = [
        *((false_alarms, each) for each in driven),
        *((detection, each) for each in offset),
    ]
    done = experiment.run_cases(_perform, calls, args.jobs, out)
    sound = [each for each in done if isinstance(each, FalseAlarms)]
    faulty = [each for each in done if isinstance(each, Detection)]
    _write(sound, faulty, out)
    return [
        f"false alarms of {args.robot}, seeds {args.seed} to {args.seed + args.seeds - 1}, "
        f"{args.seconds:g} s each ({FALSE_ALARM:g} allowed):",
        *_table(
            ["plant", "errors", "manoeuvre", "statuses", "alarms", "largest level"],
            [
                [
                    each.case.plant,
                    f"{each.case.errors:g}",
                    each.manoeuvre,
                    f"{len(each.levels)}",
                    f"{each.alarms}",
                    f"{each.levels.max():.2f}",
                ]
                for each in sound
            ],
        ),
        f"one gimbal aside at 1 m/s, within {WITHIN_S:g} s:",
        *_table(
            ["plant", "errors", "offset", "trials", "found", "right module", "at first"],
            [
                [
                    each.case.plant,
                    f"{each.case.errors:g}",
                    f"{each.offset_deg:g}°",
                    f"{len(each.found)}",
                    *(f"{100.0 * x.mean():.0f} %" for x in (each.found, each.named, each.first)),
                ]
                for each in faulty
            ],
        ),
    ]


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return a Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return [f"| {' | '.join(line)} |" for line in lines]


def _write(sound: Sequence[FalseAlarms], faulty: Sequence[Detection], out: Output) -> None:
    out.table(
        "false_alarms",
        {
            "plant": [each.case.plant for each in sound],
            "errors": [each.case.errors for each in sound],
            "manoeuvre": [each.manoeuvre for each in sound],
            "statuses": [float(len(each.levels)) for each in sound],
            "alarms": [float(each.alarms) for each in sound],
            "largest_level": [float(each.levels.max()) for each in sound],
        },
    )
    out.table(
        "offsets_found",
        {
            "plant": [each.case.plant for each in faulty],
            "errors": [each.case.errors for each in faulty],
            "offset_deg": [each.offset_deg for each in faulty],
            "trials": [float(len(each.found)) for each in faulty],
            "found": [float(each.found.mean()) for each in faulty],
            "right_module": [float(each.named.mean()) for each in faulty],
            "right_at_first": [float(each.first.mean()) for each in faulty],
        },
    )
    figure = experiment.new_figure(8.0, 4.0, "Evidence against sound robots")
    axes: experiment.Axes = figure.subplots()
    for i, each in enumerate(sound):
        levels = np.sort(each.levels)
        axes.plot(
            np.maximum(levels, 1e-3),
            1.0 - np.arange(len(levels)) / len(levels),
            color=experiment.SERIES_COLOURS[i % 3],
            linestyle="-" if each.case.errors == 0.0 else "--",
            label=f"{each.manoeuvre}, errors {each.case.errors:g}",
        )
    axes.axvline(1.0, color=experiment.REFERENCE_COLOUR, linestyle=":")
    axes.set_xscale("log")
    axes.set_yscale("log")
    experiment.label_axes(axes, "chi-square over threshold", "share of statuses above it")
    experiment.add_legend(axes)
    out.figure("false_alarms", figure)


def _flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--plant", choices=PLANTS, default="kinematic", help="default kinematic")
    parser.add_argument(
        "--seeds", type=flags.whole(1), default=12, help="robots of each row; default 12"
    )
    parser.add_argument(
        "--seconds", type=flags.number(1.0), default=30.0, help="drive of each; default 30"
    )
    parser.add_argument(
        "--trials", type=flags.whole(1), default=20, help="offsets of each; default 20"
    )
    parser.add_argument(
        "--offsets-deg",
        type=flags.number(above=0.0, most=5.0),
        nargs="+",
        default=[0.2, 0.3, 1.0],
        metavar="DEG",
        help="how far one gimbal is aside; default 0.2 0.3 1",
    )
    experiment.add_jobs_flag(parser)


EXPERIMENT = Experiment(
    "alarms",
    run,
    [
        "python -m research alarms",
        "python -m research alarms --plant mujoco --seeds 6 --trials 10",
        "python -m research alarms --offsets-deg 0.25 0.5 --seeds 4 --jobs 1",
    ],
    robot="tsd",
    seed_of="the first robot of a row",
    add_own_flags=_flags,
)
