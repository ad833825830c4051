"""The experiment of the thesis: a square of 1 m at 1 m/s, its Figures 13 and 14, and beyond it.

Open loop is as there: a reference that jumps from side to side, and no correction. Closed loop is
timed to the limits, so that all of it can be followed.
"""

from __future__ import annotations

import argparse
import itertools

import msgspec
import numpy as np

from tsd_twin import robots
from tsd_twin.estimation import Slip
from tsd_twin.lab import charts, look, shapes
from tsd_twin.lab.drive_path import Record, follow
from tsd_twin.lab.experiment import Experiment
from tsd_twin.lab.follow import add_run_flags
from tsd_twin.lab.observer import Loop, observer
from tsd_twin.lab.output import Output
from tsd_twin.lab.virtual_robot import PERIOD_S, VirtualRobot
from tsd_twin.lie import SE2
from tsd_twin.motion.route import Route
from tsd_twin.motion.timing import SpeedProfile
from tsd_twin.motion.tracker import Tracker, TrackerSettings
from tsd_twin.motion.trajectory import Trajectory, plan
from tsd_twin.robots import Robot, SingularityRobot, of_kind
from tsd_twin.sim import PLANTS, Camera, CameraNoise, Frame, SimRobot

SPEED_MPS = 1.0
ACCELERATION_MPS2, DECELERATION_MPS2 = 4.0, 4.0
"""Of the closed loop; the limits of the robot are raised to leave room above them."""
ROOM = 0.5
"""Share of these limits that the timing uses: servos that are late have to be told more."""
LAG_S = {"kinematic": 0.04, "mujoco": 0.055}
"""Time by which the robot follows late on each plant: servos, and wheels that slide to push."""
PLAY_LAG_S = 0.025
"""More of it with the errors of `tsd`: dead band and play of the gears."""
ANY_MPS2 = 1000.0
"""The thesis had no limit of acceleration: a corner was passed as fast as servos turn."""
THESIS_SHARE = 0.16
"""The largest error of position that the thesis reports, of the side."""


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Drive the square, and say the three errors."""
    loop = Loop(args.loop)
    robot = robots.load(args.robot)
    route = Route(shapes.shape("square"))
    if loop is Loop.OPEN:
        robot = with_limits(robot, ANY_MPS2, ANY_MPS2)
        trajectory = sharp(route)
        tracker = Tracker(trajectory, TrackerSettings(lag_s=0.0))
    else:
        robot = with_limits(robot, ACCELERATION_MPS2 / ROOM, DECELERATION_MPS2 / ROOM)
        trajectory = plan(route, robot.kinematics(), robot.limits, share=ROOM, speed_mps=SPEED_MPS)
        tracker = Tracker(trajectory, TrackerSettings(lag_s=lag_s(robot, args)))
    simulated = SimRobot(
        robot, seed=args.seed, noise=args.noise, plant=args.plant, errors=args.errors
    )
    virtual = VirtualRobot(robot, simulated)
    slip = Slip(of_kind(robot, SingularityRobot)) if args.plant == "mujoco" else None
    watching = observer(loop, virtual, args.seed, slip)
    record = follow(
        virtual,
        trajectory,
        tracker,
        watching,
        lambda steps: out.progress(steps, "driving", len(steps)),
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


def lag_s(robot: Robot, args: argparse.Namespace) -> float:
    """Return by how much the robot follows late; errors count up to their described size."""
    both_ways_s = 2.0 * robot.with_errors(args.errors).delay_s
    return LAG_S[args.plant] + both_ways_s + PLAY_LAG_S * min(args.errors, 1.0)


def sharp(route: Route) -> Trajectory:
    """Return the reference of the thesis: full speed at once, and around corners in an instant."""
    s_m = np.array([0.0, *route.breaks_m, route.length_m])
    speed = np.full(len(s_m), SPEED_MPS)
    profile = SpeedProfile(s_m, speed, np.zeros(len(s_m) - 1), s_m / SPEED_MPS)
    return Trajectory(route, profile)


def with_limits(robot: Robot, acceleration_mps2: float, deceleration_mps2: float) -> Robot:
    """Return the robot with other limits of acceleration, and room above the speed."""
    limits = msgspec.structs.replace(
        robot.limits,
        speed_mps=max(robot.limits.speed_mps, 1.1 * SPEED_MPS),
        acceleration_mps2=acceleration_mps2,
        deceleration_mps2=deceleration_mps2,
    )
    return msgspec.structs.replace(robot, limits=limits)


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


EXPERIMENT = Experiment(
    name="square",
    purpose="The experiment of the thesis: a square of 1 m at 1 m/s, seen by a camera.",
    run=run,
    examples=[
        "tsd-lab square --out lab                 open loop, as in the thesis",
        "tsd-lab square --loop gyro               closed by wheels and gyro",
        "tsd-lab square --loop camera --seed 7    and by the camera above",
        "tsd-lab square --loop camera --plant mujoco      on a floor with friction",
        "tsd-lab square --errors 0 --noise 0      a perfect robot",
    ],
    add_flags=_flags,
)
