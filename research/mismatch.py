"""Study `mismatch`: the closed-loop square of robots that differ from their description."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import msgspec
import numpy as np

from tsd_twin.cli import experiment, flags
from tsd_twin.cli.experiment import Experiment, Output
from tsd_twin.errors import TwinError
from tsd_twin.lab.observer import Loop
from tsd_twin.lab.square import Square, drive_squares, percent_of
from tsd_twin.lie import Array
from tsd_twin.robots import SingularityDescription

_AS_DESCRIBED = "as described"
_LOOPS = (Loop.CAMERA, Loop.GYRO)
"""Default loops of the table."""
_KEYS = ("rms_m", "cross_track_m", "closure_m")


def _changed(table: str, robot: SingularityDescription, **values: float) -> SingularityDescription:
    """Return the robot with other values in one table of its description."""
    changed = msgspec.structs.replace(getattr(robot, table), **values)
    return msgspec.structs.replace(robot, **{table: changed})


def _slower_motors(robot: SingularityDescription) -> SingularityDescription:
    motor = robot.motor
    up_s, down_s = 2.0 * motor.time_constant_up_s, 2.0 * motor.time_constant_down_s
    return _changed("motor", robot, time_constant_up_s=up_s, time_constant_down_s=down_s)


MISMATCHES: dict[str, Callable[[SingularityDescription], SingularityDescription]] = {
    "contact patch 2 mm": partial(_changed, "floor", patch_radius_m=0.002),
    "friction 0.5": partial(_changed, "floor", friction=0.5),
    "friction 0.35": partial(_changed, "floor", friction=0.35),
    "servo approach rate 20/s": partial(_changed, "servo", approach_rate_per_s=20.0),
    "servo torque halved": partial(_changed, "servo", stall_torque_nm=3.0),
    "motor time constants doubled": _slower_motors,
    "mass 4 kg": partial(_changed, "mass", total_kg=4.0),
}
"""Differences between the true robot and its description; sent to other processes."""


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Errors of the closed-loop square if the true robot is not as described, in MuJoCo."""
    names = ("", *(args.differ or MISMATCHES))
    unknown = [name for name in names[1:] if name not in MISMATCHES]
    if unknown:
        raise TwinError(f"there is no mismatch '{unknown[0]}': {', '.join(MISMATCHES)}")
    loops = [Loop(loop) for loop in args.loops]
    squares = [
        Square(
            robot="tsd",
            loop=loop,
            seed=args.seed + i,
            noise=1.0,
            errors=1.0,
            plant="mujoco",
            believed_friction=1.0,
            turns=True,
            differs=MISMATCHES.get(name),
        )
        for name in names
        for loop in loops
        for i in range(args.seeds)
    ]
    driven = list(out.progress(drive_squares(squares), "driving squares", len(squares)))
    percent = np.array([[percent_of(errors, key) for key in _KEYS] for _, errors in driven])
    out.table(
        "mismatch",
        {
            "differs": [
                name or _AS_DESCRIBED for name in names for _ in range(len(loops) * args.seeds)
            ],
            "loop": [str(square.loop) for square in squares],
            "seed": [float(square.seed) for square in squares],
            "rms_percent": percent[:, 0].tolist(),
            "cross_track_percent": percent[:, 1].tolist(),
            "closure_percent": percent[:, 2].tolist(),
        },
    )
    by_case = percent.reshape(len(names), len(loops), args.seeds, len(_KEYS))
    _draw(by_case, names, loops, out)
    last = args.seed + args.seeds - 1
    return [
        f"seeds {args.seed} to {last}; per cent of the side, median / worst:",
        *_lines(by_case, names, loops),
    ]


def _lines(by_case: Array, names: Sequence[str], loops: Sequence[Loop]) -> list[str]:
    """Return the table in Markdown."""
    head = ["the true robot differs in"]
    head += [f"{kind}, {loop}" for loop in loops for kind in ("RMS", "cross-track")]
    rows: list[list[str]] = []
    for name, case in zip(names, by_case, strict=True):
        cells = [name or _AS_DESCRIBED]
        for of_loop in case:
            cells += [f"{np.median(of):.2f} / {of.max():.2f}" for of in of_loop.T[:2]]
        rows.append(cells)
    return experiment.markdown_table(head, rows)


def _draw(by_case: Array, names: Sequence[str], loops: Sequence[Loop], out: Output) -> None:
    figure = experiment.new_figure(9.0, 4.4, "The closed-loop square of robots not as described")
    axes: Any = figure.subplots()
    rows = np.arange(len(names))[::-1]
    for i, loop in enumerate(loops):
        for seed in range(by_case.shape[2]):
            axes.plot(
                by_case[:, i, seed, 0],
                rows - 0.15 + 0.3 * i,
                "o",
                color=experiment.SERIES_COLOURS[i],
                markersize=4,
                label=str(loop) if seed == 0 else None,
            )
    axes.set_yticks(rows, [name or _AS_DESCRIBED for name in names])
    experiment.label_axes(axes, "RMS time-tracking (% of the side)", "")
    experiment.add_legend(axes)
    out.figure("mismatch", figure)


def _flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--seeds", type=flags.whole(1), default=5, help="robots of each row; default 5"
    )
    parser.add_argument(
        "--loops",
        nargs="+",
        choices=[Loop.GYRO, Loop.CAMERA],
        default=_LOOPS,
        help="default camera gyro",
    )
    parser.add_argument(
        "--differ", nargs="+", metavar="NAME", help=f"of {', '.join(MISMATCHES)}; default all"
    )


EXPERIMENT = Experiment(
    "mismatch",
    run,
    [
        "python -m research mismatch --seed 300",
        'python -m research mismatch --differ "friction 0.5" --loops gyro',
    ],
    seed_of="the first robot of a row",
    add_own_flags=_flags,
)
