"""The experiment of the thesis: a square of 1 m at 1 m/s, its Figures 13 and 14, and beyond it.

Open loop is as there: a reference that jumps from side to side, and no correction. Closed loop is
timed to the limits, so that all of it can be followed.
"""

from __future__ import annotations

import argparse
import itertools

import numpy as np

from tsd_twin.errors import TwinError
from tsd_twin.lab import charts, look
from tsd_twin.lab.drive_path import Record
from tsd_twin.lab.experiment import Experiment
from tsd_twin.lab.follow import add_run_flags
from tsd_twin.lab.many_squares import run_many
from tsd_twin.lab.observer import Loop
from tsd_twin.lab.one_square import THESIS_SHARE, Square
from tsd_twin.lab.output import Output
from tsd_twin.lab.virtual_robot import PERIOD_S
from tsd_twin.lie import SE2
from tsd_twin.sim import PLANTS, Camera, CameraNoise, Frame


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Drive the square, and say the three errors, or how they spread over many seeds."""
    if args.seeds < 1:
        raise TwinError(f"--seeds must be 1 or more, not {args.seeds}")
    if not args.believed_friction > 0.0:
        raise TwinError(f"--believed-friction must be above 0, not {args.believed_friction:g}")
    if args.seeds > 1:
        return run_many([Square.of(args, args.seed + i) for i in range(args.seeds)], out)
    loop = Loop(args.loop)
    trajectory, record = Square.of(args, args.seed).drive(
        lambda steps: out.progress(steps, "driving", len(steps))
    )
    frames = filmed(record, args.seed)
    out.table("square", record.columns())
    out.table(
        "square_camera",
        {"t_s": [frame.taken_s for frame in frames]}
        | {
            f"{axis}_m": charts.camera_xy(record, frames)[:, i] for i, axis in enumerate(("x", "y"))
        },
    )
    _draw(loop, record, frames, out)
    errors = record.errors()
    of_side = 100.0 * errors.worst_m / errors.size_m
    return [
        f"square of 1 m in {trajectory.duration_s:.2f} s, loop: {loop}",
        errors.sentence(),
        f"largest error of position {of_side:.1f} % of the side; "
        f"the thesis reports at most {100 * THESIS_SHARE:.0f} %, open loop",
    ]


def filmed(record: Record, seed: int) -> list[Frame]:
    """Return what a camera above the floor sees of a run, at 24 frames a second."""
    camera = Camera(CameraNoise(late_s=0.0), np.random.default_rng(seed))
    start = SE2(record.reference[0]).inverse()
    poses = (start @ SE2(record.truth)).xy_heading
    seen = (camera.watch(i * PERIOD_S, SE2(pose)) for i, pose in enumerate(poses))
    return list(itertools.chain.from_iterable(seen))


def _draw(loop: Loop, record: Record, frames: list[Frame], out: Output) -> None:
    figure = look.figure(10.5, 4.6, f"Square of 1 m at 1 m/s, loop: {loop}")
    left, right = figure.subplots(1, 2)
    charts.draw_positions(left, record, frames, "position, as Figure 13 of the thesis")
    charts.draw_speeds(right, record, frames, "speed, as Figure 14 of the thesis")
    out.picture("square", figure)


def _flags(parser: argparse.ArgumentParser) -> None:
    add_run_flags(parser, Loop.OPEN)
    parser.add_argument(
        "--seeds",
        type=int,
        default=1,
        metavar="N",
        help="drive so many squares, from --seed on, and say how their errors spread; default 1",
    )
    parser.add_argument(
        "--errors",
        type=float,
        default=1.0,
        metavar="SCALE",
        help="times [errors], what is wrong with a built robot; default 1",
    )
    parser.add_argument(
        "--plant",
        choices=list(PLANTS),
        default="kinematic",
        help="what moves it: rolling by the equations (default), or bodies that slide in MuJoCo",
    )
    parser.add_argument(
        "--believed-friction",
        type=float,
        default=1.0,
        metavar="SHARE",
        help="what the robot takes the friction of the floor for, over what it is; default 1",
    )
    parser.add_argument(
        "--turn",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="with a gyro: turn on the spot first, to learn how fast wheels spin; default: do",
    )


EXPERIMENT = Experiment(
    name="square",
    purpose="The experiment of the thesis: a square of 1 m at 1 m/s, seen by a camera.",
    run=run,
    examples=[
        "tsd-lab square --out lab                 open loop, as in the thesis",
        "tsd-lab square --loop gyro               closed by wheels and gyro",
        "tsd-lab square --loop camera --seed 7    and by the camera above",
        "tsd-lab square --loop camera --plant mujoco      on a floor with friction",
        "tsd-lab square --loop gyro --plant mujoco --seeds 20     by 20 robots",
        "tsd-lab square --errors 0 --noise 0      a perfect robot",
    ],
    add_flags=_flags,
)
