"""Zeroing the gimbals as in the thesis: wheels at 2,500 rpm, at most an inch of creep in 30 s.

It turns the wheels of a robot on the bus, mock or machine, but drives it nowhere.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np

from tsd_twin.errors import TwinError
from tsd_twin.lab import creep_picture
from tsd_twin.lab.creep import (
    LIMIT_M,
    LIMIT_S,
    Creep,
    creep_by_hand,
    creep_of,
    spin_rpm,
    steps_that_end,
)
from tsd_twin.lab.experiment import Experiment
from tsd_twin.lab.joining import add_bus_flags, joined
from tsd_twin.lab.keyboard import ask, asked, say
from tsd_twin.lab.operator import Operator
from tsd_twin.lab.output import Output
from tsd_twin.lab.percents import PARTS, percents
from tsd_twin.lab.sight import Sight
from tsd_twin.lab.write_back import write_back
from tsd_twin.lie import SE2
from tsd_twin.robots import SingularityRobot, of_kind

LEASH_M = 0.5
"""Farther than this it is not let go, where somebody sees it."""
_SHORTEST_S = 1.0


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Lead through the procedure, and say whether the gimbals are zeroed, and what would be."""
    if not _SHORTEST_S <= args.seconds <= 300.0:
        raise TwinError(f"--seconds must be {_SHORTEST_S:g} to 300, not {args.seconds:g}")
    with joined(args) as operator:
        robot = of_kind(operator.robot, SingularityRobot)
        _brief(args, robot, operator.id)
        sight = Sight(operator.bus, operator.id)
        held_s = _watch(args, out, operator, sight)
    seen = len(sight.seen) > 1 and not args.by_hand
    if seen:
        t_s = np.array([at_s for at_s, _ in sight.seen])
        poses = np.array([pose for _, pose in sight.seen])
        creep = creep_of(t_s, poses, spin_rpm(robot))
    else:
        if sight.refused and not args.by_hand:
            say(f"What came on in/pose was of no use ({sight.refused}), so measure it.")
        moved_m, turned_rad = asked()
        creep = creep_by_hand(moved_m, turned_rad, held_s, spin_rpm(robot))
        t_s = np.array([0.0, held_s])
        poses = np.array([np.zeros(3), [*moved_m, turned_rad]])
    poses = (SE2(poses[0]).inverse() @ SE2(poses)).xy_heading
    columns = dict(zip(("x_m", "y_m", "heading_rad"), poses.T, strict=True))
    out.table("zero", {"t_s": t_s - t_s[0]} | columns)
    out.picture("zero", creep_picture.draw(t_s - t_s[0], poses, creep))
    who = f"seen by {sight.who}" if seen else "measured by hand"
    verdict = "PASS" if creep.passes else "FAIL"
    lines = [
        f"{operator.id}: wheels at {spin_rpm(robot):.0f} rpm for {held_s:.1f} s, {who}",
        f"creeps {creep.sentence()}; at most {1000 * LIMIT_M:.1f} mm: {verdict}",
    ]
    if abs(creep.way_m - LIMIT_M) < 2.0 * creep.way_sigma_m:
        about_mm = 1000 * creep.way_sigma_m
        lines.append(f"that is known to +- {about_mm:.1f} mm only: more --seconds tell better")
    return lines if creep.passes else lines + _advice(args, robot, operator.text, creep)


def _watch(args: argparse.Namespace, out: Output, operator: Operator, sight: Sight) -> float:
    """Return for how long the robot stood ready, and was seen if it was."""
    held_s = 0.0
    with operator:
        for _ in out.progress(percents(operator.get_ready(), 1.0), "spinning up", PARTS):
            pass
        sight.forget()
        held = percents(_noted(operator, args.seconds, sight), args.seconds)
        for percent in out.progress(held, "standing still, Ctrl-C stops", PARTS):
            held_s = max(held_s, percent * args.seconds / PARTS)
    seen = sight.seen
    return seen[-1][0] - seen[0][0] if seen else held_s


def _noted(operator: Operator, seconds: float, sight: Sight) -> Iterator[float]:
    """Hold, note what is seen, and end early when the robot goes too far."""
    for held_s in operator.hold(seconds):
        sight.look()
        yield held_s
        if sight.moved_m > LEASH_M:
            return
    yield seconds


def _brief(args: argparse.Namespace, robot: SingularityRobot, robot_id: str) -> None:
    """Tell what will happen, and wait for a word."""
    if args.yes:
        return
    say(
        f"{robot_id} will spin its wheels at {spin_rpm(robot):.0f} rpm and be told to stand, for "
        f"{args.seconds:g} s.\nGive it 1 m of free, level floor on all sides, mark where its "
        "centre is and where it looks,\nand have the hardware stop at hand. Ctrl-C here disarms it."
    )
    ask("Enter begins: ")


def _advice(
    args: argparse.Namespace, robot: SingularityRobot, text: str, creep: Creep
) -> list[str]:
    steps, left = steps_that_end(robot, creep)
    drive = robot.kinematics()
    offset = robot.trim().offset.reshape(-1, 3)[:, :2].ravel()
    offset = np.degrees(offset + steps * 2.0 * np.pi / robot.servo.steps_per_turn)
    pairs = [[round(float(angle), 4) for angle in pair] for pair in offset.reshape(-1, 2)]
    lines = ["zeros that explain it, in whole steps of the servos:"]
    for name, moved, (alpha, beta) in zip(
        drive.actuators, steps.reshape(-1, 2), pairs, strict=True
    ):
        lines.append(
            f"  {name}: alpha {moved[0]:+.0f} to {alpha:.3f} deg, "
            f"beta {moved[1]:+.0f} to {beta:.3f} deg"
        )
    lines.append(f"with them it should creep {left.sentence()}")
    lines.append(
        "others would explain it as well: what pushes wheels against one another moves no robot, "
        "and only tsd-lab calibrate sees it"
    )
    if args.write_to:
        write_back(args.write_to, text, {"calibration": {"tilt_offset_deg": pairs}})
        lines.append(f"written into {args.write_to}: start the robot with it, and zero again")
    return lines


def _flags(parser: argparse.ArgumentParser) -> None:
    add_bus_flags(parser)
    parser.add_argument(
        "--seconds", type=float, default=LIMIT_S, help=f"to watch it; default {LIMIT_S:g}"
    )
    parser.add_argument(
        "--by-hand", action="store_true", help="ask how far it went, also when somebody sees it"
    )
    parser.add_argument(
        "--write-to",
        metavar="FILE.toml",
        help="description to put new zeros into, its comments kept; or a copy of the robot's own",
    )


EXPERIMENT = Experiment(
    name="zero",
    purpose="Zero the gimbals of a robot on the bus: it may creep an inch in 30 s at 2,500 rpm.",
    run=run,
    examples=[
        "tsd-lab zero                            the robot of this machine, mock or not",
        "tsd-lab zero --write-to my.toml         and put better zeros into its description",
        "tsd-lab zero --id left --seconds 5      one of several, when it creeps far",
    ],
    add_flags=_flags,
)
