"""Study `prediction`: error of the predicted pose, begun with the commanded or measured twist."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tsd_twin import robots
from tsd_twin.cli import experiment, flags
from tsd_twin.cli.experiment import Experiment, Output
from tsd_twin.client.virtual import PERIOD_S
from tsd_twin.client.virtual_robot import VirtualRobot
from tsd_twin.errors import TwinError
from tsd_twin.lab.manoeuvres import MANOEUVRES
from tsd_twin.lie import SE2, Array
from tsd_twin.motion.prediction import PendingCommand, Predictor
from tsd_twin.simulation import PLANTS, SimRobot

DELAYS_S = (0.04, 0.14, 0.3)
"""Round trips of the table."""
_EVERY = 5
"""Periods between two predictions."""
INITIAL_TWISTS = ("no prediction", "commanded twist", "measured twist")


@dataclass(frozen=True, slots=True)
class Case:
    """Table row: robots with individual errors on one manoeuvre."""

    robot: str
    plant: str
    manoeuvre: str
    seeds: int
    first: int
    seconds: float


def position_errors(case: Case) -> Array:
    """Return the distances (delay, initial twist, prediction) of predicted and true pose, in m.

    A command sent when a state arrives reaches the robot a round trip after that state, and the
    operator knows all commands in between. The pose is predicted for that time, relative to the
    pose in the state, so errors of the estimated position are not included.
    """
    errors: list[Array] = []
    robot = robots.load_robot(case.robot)
    for seed in range(case.first, case.first + case.seeds):
        virtual = VirtualRobot(robot, SimRobot(robot, seed, 1.0, plant=case.plant, errors=1.0))
        twist_at = MANOEUVRES[case.manoeuvre](np.random.default_rng([seed, 5]))
        predictor = Predictor(virtual.controller.kinematics, robot.limits, robot.lag_s)
        requests: list[Array] = []
        states: list[tuple[SE2, Array, Array]] = []
        for i in range(round(case.seconds / PERIOD_S)):
            requests.append(np.array(twist_at(i * PERIOD_S)))
            virtual.drive(requests[-1])
            setpoint = virtual.controller.kinematics.forward(virtual.controller.setpoint).twist
            states.append((virtual.truth, setpoint, virtual.odometry().twist))
        errors.append(_errors_of(predictor, requests, states))
    return np.concatenate(errors, axis=2)


def _errors_of(
    predictor: Predictor, requests: Sequence[Array], states: Sequence[tuple[SE2, Array, Array]]
) -> Array:
    longest = round(max(DELAYS_S) / PERIOD_S)
    times = range(longest, len(states) - longest, _EVERY)
    errors = np.zeros((len(DELAYS_S), len(INITIAL_TWISTS), len(times)))
    for i, delay_s in enumerate(DELAYS_S):
        ahead = round(delay_s / PERIOD_S)
        for k, at in enumerate(times):
            pose, commanded, measured = states[at]
            here = SE2.identity()
            pending = [PendingCommand(n * PERIOD_S, requests[at + n]) for n in range(1, ahead + 1)]
            true_xy = (pose.inverse() @ states[at + ahead][0]).xy_heading[:2]
            for j, begun in enumerate((None, commanded, measured)):
                found = (
                    here
                    if begun is None
                    else predictor.after(delay_s, here, commanded, pending, measured=begun)
                )
                errors[i, j, k] = np.hypot(*(found.xy_heading[:2] - true_xy))
    return errors


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Drive robots, and compare each predicted pose with the true one."""
    if robots.load_robot(args.robot).kinematics().pose_type is not SE2:
        raise TwinError(f"{args.robot} does not drive on a floor")
    wanted = [
        Case(args.robot, args.plant, name, args.seeds, args.seed, args.seconds)
        for name in ("full stick", "wander")
    ]
    found = experiment.run_cases(position_errors, wanted, args.jobs, out)
    rows = [
        (case, delay_s, begun, 1e3 * errors[i, j])
        for case, errors in zip(wanted, found, strict=True)
        for i, delay_s in enumerate(DELAYS_S)
        for j, begun in enumerate(INITIAL_TWISTS)
    ]
    out.table(
        "prediction",
        {
            "manoeuvre": [case.manoeuvre for case, *_ in rows],
            "delay_ms": [1e3 * delay_s for _, delay_s, *_ in rows],
            "initial": [begun for *_, begun, _ in rows],
            "median_mm": [float(np.median(off)) for *_, off in rows],
            "p95_mm": [float(np.percentile(off, 95)) for *_, off in rows],
            "worst_mm": [float(off.max()) for *_, off in rows],
        },
    )
    _draw(found, wanted, out)
    return [
        f"{args.seeds} robots, {args.plant}, all errors; mm, median / 95 of 100 / worst:",
        *experiment.markdown_table(
            ["manoeuvre", "round trip, ms", *INITIAL_TWISTS],
            [
                [
                    case.manoeuvre,
                    f"{1e3 * delay_s:.0f}",
                    *(experiment.spread(1e3 * off, 1) for off in errors[i]),
                ]
                for case, errors in zip(wanted, found, strict=True)
                for i, delay_s in enumerate(DELAYS_S)
            ],
        ),
    ]


def _draw(found: Sequence[Array], wanted: Sequence[Case], out: Output) -> None:
    figure = experiment.new_figure(9.0, 4.0, "Distance of the predicted from the true pose")
    panels = figure.subplots(1, len(found))
    for axis, errors, case in zip(panels, found, wanted, strict=True):
        for j, begun in enumerate(INITIAL_TWISTS):
            medians = 1e3 * np.median(errors[:, j], axis=1)
            colour = experiment.SERIES_COLOURS[j]
            axis.plot(1e3 * np.array(DELAYS_S), medians, "o-", color=colour, label=begun)
        axis.set_yscale("log")
        experiment.label_axes(axis, "round trip, ms", f"{case.manoeuvre}: median, mm")
    experiment.add_legend(panels[0])
    out.figure("prediction", figure)


def _add_flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seeds", type=flags.whole(1), default=6, help="robots; default 6")
    parser.add_argument("--plant", choices=PLANTS, default="kinematic", help="default kinematic")
    parser.add_argument(
        "--seconds", type=flags.number(1.0), default=15.0, help="length of each drive; default 15"
    )
    experiment.add_jobs_flag(parser)


EXPERIMENT = Experiment(
    "prediction",
    run,
    ["python -m research prediction --seed 7000", "python -m research prediction --plant mujoco"],
    robot="tsd",
    seed_of="the first robot",
    add_own_flags=_add_flags,
)
