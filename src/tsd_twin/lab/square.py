"""Experiment `square`: the 1 m square of the thesis at 1 m/s (Figures 13 and 14), and beyond.

Open loop is as in the thesis: a reference that jumps from side to side, without correction. Closed
loop is timed to the limits, so that the reference can be followed exactly.
"""

from __future__ import annotations

import argparse
import itertools
import multiprocessing
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from tsd_twin import robots
from tsd_twin.calibration.bus_drive import add_drive_flags
from tsd_twin.cli import experiment, flags
from tsd_twin.cli.experiment import Experiment, Output
from tsd_twin.client.virtual import PERIOD_S
from tsd_twin.client.virtual_robot import VirtualRobot
from tsd_twin.lab import tracking
from tsd_twin.lab.bus_square import drive_square
from tsd_twin.lab.observer import Loop, PoseObserver, Slip, make_observer
from tsd_twin.lab.tracking import TrackingErrors, TrackingRecord, add_loop_flag, follow_trajectory
from tsd_twin.lie import SE2, Array
from tsd_twin.motion.routes import Route
from tsd_twin.motion.tracking import Gains, TrackingController
from tsd_twin.motion.trajectory import SpeedProfile, Trajectory, plan
from tsd_twin.robots import RPM, RobotDescription, SingularityDescription, description_of_kind
from tsd_twin.sensors.pose import Camera, CameraNoise, Frame
from tsd_twin.simulation import PLANTS, SimRobot

_FEEDFORWARD_STEP_S = 0.005


def slip_feedforward(
    robot: SingularityDescription, slip: Slip, trajectory: Trajectory
) -> Callable[[float], Array]:
    """Return the twist (3,) to command over time, with slip, speed loss and compliance compensated.

    Wheels slide to push the body, slow down under the load, and deflect their gimbals. A servo acts
    as a spring, whose stiffness follows from its torque and approach rate. The compensation is
    precomputed from the trajectory.
    """
    drive, slip, servo = robot.kinematics(), slip.later(0.0), robot.servo
    stiffness_nm = servo.stall_torque_nm * servo.approach_rate_per_s
    stiffness_nm /= servo.no_load_speed_rpm * RPM
    # The floor rotates a gimbal by force times radius, and the tilt moves the wheel by its
    # speed times radius, perpendicular to the force.
    aside_mps_per_n = drive.wheel_radius_m**2 * drive.spin_rad_per_s / stiffness_nm
    steps = int(np.ceil(trajectory.duration_s / _FEEDFORWARD_STEP_S)) + 1
    at_s: Array = _FEEDFORWARD_STEP_S * (0.5 + np.arange(steps, dtype=np.float64))
    reference = trajectory.at(at_s)
    twists = np.empty((steps, 3))
    for i, (twist, rate) in enumerate(zip(reference.twist, reference.twist_rate, strict=True)):
        x, y, turn = twist
        over_ground = rate + turn * np.array([-y, x, 0.0])
        rolled, force = slip.push(twist, over_ground, _FEEDFORWARD_STEP_S)
        aside = aside_mps_per_n * np.stack([-force[:, 1], force[:, 0]], axis=-1)
        # The wheel-speed setpoint refers to rest on this floor.
        twists[i] = drive.twist_from_contacts @ (slip.rest_share * rolled - aside).ravel()
    return lambda t_s: np.array([float(np.interp(t_s, at_s, column)) for column in twists.T])


SPEED_MPS = 1.0
ACCELERATION_MPS2 = 4.0
"""Limit of the closed loop, either way; the robot's own limits are raised above it as a margin."""
SMOOTH_S = 0.0495
"""Rise time of the acceleration: the remainder of 5.2 s, on four sides."""
_LIMIT_SHARE = 0.5
"""Fraction of these limits used by the trajectory; lag, slip and compliance need the margin."""
_SPEED_MARGIN = 1.5
"""Speed limit relative to the square's speed; a low battery needs higher commands."""
_GAINS = Gains(6.0, 1.0, integral_limit=0.05)
"""Gains below the default: feed-forward leaves small errors, and camera frames are noisy."""
_BACKLASH_LAG_S = 0.01
"""Additional lag under load for the errors of `tsd`: while a servo motor crosses its backlash, the
floor turns the gimbal. Measured in MuJoCo, as the only value here; the remaining lag is in the
description."""
THESIS_ROBOT = "tsd"
THESIS_SHARE = 0.16
"""Maximum position error reported in the thesis, relative to the side."""
_NO_LIMIT_MPS2 = 1000.0
"""Acceleration limit for the thesis, which had none: corners at servo speed."""


@dataclass(frozen=True, slots=True)
class Square:
    """Settings of a square run, as in the flags of `tsd-lab square`."""

    robot: str
    loop: Loop
    seed: int
    noise: float
    errors: float
    plant: str
    believed_friction: float
    """Friction assumed by the robot, relative to the true friction."""
    turns: bool
    """Whether the robot first turns in place to measure its wheel speed."""
    differs: Callable[[SingularityDescription], SingularityDescription] | None = None
    """Change of the simulated robot that its description does not know."""

    @staticmethod
    def of(args: argparse.Namespace, seed: int) -> Square:
        """Return the settings of `args`, with another seed."""
        return Square(
            robot=args.robot,
            loop=Loop(args.loop),
            seed=seed,
            noise=args.noise,
            errors=args.errors,
            plant=args.plant,
            believed_friction=args.believed_friction,
            turns=args.turn,
        )

    def drive(
        self, periods: Callable[[range], Iterable[int]] = iter
    ) -> tuple[Trajectory, TrackingRecord]:
        """Simulate the square, and return the trajectory and the record."""
        robot = robots.load_robot(self.robot)
        route = Route(tracking.named_path("square"))
        if self.loop is Loop.OPEN:
            robot = _with_acceleration(robot, _NO_LIMIT_MPS2)
            trajectory = unlimited_trajectory(route)
        else:
            robot = _with_acceleration(robot, ACCELERATION_MPS2 / _LIMIT_SHARE)
            trajectory = plan(
                route,
                robot.kinematics(),
                robot.limits,
                share=_LIMIT_SHARE,
                speed_mps=SPEED_MPS,
                smooth_s=SMOOTH_S,
            )
        true = robot
        if self.differs is not None:
            true = self.differs(description_of_kind(robot, SingularityDescription))
        simulated = SimRobot(
            true, seed=self.seed, noise=self.noise, plant=self.plant, errors=self.errors
        )
        virtual = VirtualRobot(robot, simulated)
        slip = self._slip(robot) if self.plant == "mujoco" else None
        watching = make_observer(self.loop, virtual, self.seed, slip, turns=self.turns)
        tracker = self._tracker(robot, trajectory, watching)
        return trajectory, follow_trajectory(virtual, trajectory, tracker, watching, periods)

    def _slip(self, robot: RobotDescription) -> Slip:
        """Return the slip model with the friction assumed by the robot."""
        known = description_of_kind(robot, SingularityDescription)
        friction = self.believed_friction * known.floor.friction
        floor = msgspec.structs.replace(known.floor, friction=friction)
        return Slip(msgspec.structs.replace(known, floor=floor))

    def _tracker(
        self, robot: RobotDescription, trajectory: Trajectory, watching: PoseObserver | None
    ) -> TrackingController:
        """Return the tracking controller, which knows the described error sizes."""
        if watching is None:
            return TrackingController(trajectory, lag_s=0.0)
        lag_s = robot.lag_s + robot.with_errors(self.errors).delay_s
        if watching.slip is None:
            return TrackingController(trajectory, lag_s=lag_s, position=_GAINS)
        lag_s += _BACKLASH_LAG_S * min(self.errors, 1.0)
        pushing = slip_feedforward(
            description_of_kind(robot, SingularityDescription), watching.slip, trajectory
        )
        return TrackingController(trajectory, lag_s=lag_s, position=_GAINS, feed_forward=pushing)


def unlimited_trajectory(route: Route) -> Trajectory:
    """Return the reference of the thesis: constant speed, with instantaneous corners."""
    s_m = np.array([0.0, *route.breaks_m, route.length_m])
    speed = np.full(len(s_m), SPEED_MPS)
    profile = SpeedProfile(s_m, speed, np.zeros(len(s_m) - 1), s_m / SPEED_MPS)
    return Trajectory(route, profile)


def _with_acceleration(robot: RobotDescription, acceleration_mps2: float) -> RobotDescription:
    """Return the robot with another limit of acceleration either way, and a speed margin."""
    limits = msgspec.structs.replace(
        robot.limits,
        speed_mps=max(robot.limits.speed_mps, _SPEED_MARGIN * SPEED_MPS),
        acceleration_mps2=acceleration_mps2,
        deceleration_mps2=acceleration_mps2,
    )
    return msgspec.structs.replace(robot, limits=limits)


_NAMES = ("RMS time-tracking", "maximum cross-track", "closure", "largest in time")
_DRAWN = _NAMES[:3]
_COLUMNS = ("rms_percent", "cross_track_percent", "closure_percent", "largest_percent")
_KEYS = ("rms_m", "cross_track_m", "closure_m", "worst_m")


def run_seeds(squares: Sequence[Square], out: Output) -> list[str]:
    """Simulate all squares in parallel; draw and report the distribution of the errors."""
    driven = list(out.progress(drive_squares(squares), "driving squares", len(squares)))
    percent = np.array([[percent_of(errors, key) for key in _KEYS] for _, errors in driven])
    seeds = [square.seed for square in squares]
    out.table(
        "squares", {"seed": list(map(float, seeds))} | dict(zip(_COLUMNS, percent.T, strict=True))
    )
    title = f"{len(driven)} squares of 1 m in {driven[0][0]:.2f} s, loop: {squares[0].loop}"
    _draw_errors(percent[:, : len(_DRAWN)], title, out)
    return [
        f"{title}, seeds {seeds[0]} to {seeds[-1]}; "
        "per cent of the side (median, 95 of 100, worst):",
        *(
            f"  {name:20} {_format_quantiles(of)}"
            for name, of in zip(_NAMES, percent.T, strict=True)
        ),
    ]


def drive_squares(squares: Sequence[Square]) -> Iterator[tuple[float, TrackingErrors]]:
    """Simulate squares in parallel on all cores; yield their durations and errors."""
    # Spawn processes, because matplotlib and threads are not fork-safe.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(os.cpu_count() or 1, len(squares)), context) as pool:
        yield from pool.map(_drive_square, squares)


def _drive_square(square: Square) -> tuple[float, TrackingErrors]:
    trajectory, record = square.drive()
    return trajectory.duration_s, record.errors()


def percent_of(errors: TrackingErrors, key: str) -> float:
    """Return one of the errors as a percentage of the side."""
    return 100.0 * float(getattr(errors, key)) / errors.size_m


def _format_quantiles(percent: Array) -> str:
    figures = (np.median(percent), np.quantile(percent, 0.95), percent.max())
    return " ".join(f"{figure:6.2f}" for figure in figures)


def _draw_errors(percent: Array, title: str, out: Output) -> None:
    figure: Any = experiment.new_figure(7.0, 4.2, title)
    axes = figure.subplots()
    for row, (of, colour) in enumerate(zip(percent.T, experiment.SERIES_COLOURS, strict=False)):
        # Side by side in the order of the seeds, so that dots do not overlap.
        offsets = row + np.linspace(-0.3, 0.3, len(of)) if len(of) > 1 else np.array([row])
        axes.plot(offsets, of, ".", color=colour, markersize=7)
        median = float(np.median(of))
        axes.plot([row - 0.35, row + 0.35], [median, median], color=colour, linewidth=1.2)
    axes.set_xticks(range(len(_DRAWN)), _DRAWN)
    axes.set_ylim(bottom=0.0)
    experiment.label_axes(
        axes, "", "error (% of the side)", "each dot is a robot, the line is the median"
    )
    out.figure("squares", figure)


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """The experiment of the thesis: a square of 1 m at 1 m/s, seen by a camera."""
    if args.drive:
        return drive_square(args, out)
    if args.seeds > 1:
        return run_seeds([Square.of(args, args.seed + i) for i in range(args.seeds)], out)
    loop = Loop(args.loop)
    trajectory, record = Square.of(args, args.seed).drive(
        lambda steps: out.progress(steps, "driving", len(steps))
    )
    frames = camera_frames(record, args.seed)
    out.table("square", record.columns())
    camera_s = [frame.taken_s for frame in frames]
    x_m, y_m = tracking.camera_xy(record, frames).T
    out.table("square_camera", {"t_s": camera_s, "x_m": x_m, "y_m": y_m})
    of_thesis = args.robot == THESIS_ROBOT
    _draw_square(loop, record, frames, out, of_thesis=of_thesis)
    errors = record.errors()
    of_side = 100.0 * errors.worst_m / errors.size_m
    reported = f"; the thesis reports at most {100 * THESIS_SHARE:.0f} %, open loop"
    return [
        f"square of 1 m in {trajectory.duration_s:.2f} s, loop: {loop}",
        errors.sentence(),
        f"largest error of position {of_side:.1f} % of the side" + (reported if of_thesis else ""),
    ]


def camera_frames(record: TrackingRecord, seed: int) -> list[Frame]:
    """Return the frames of an overhead camera for a run, at 24 fps."""
    camera = Camera(CameraNoise(latency_s=0.0), np.random.default_rng(seed))
    start = SE2(record.reference[0]).inverse()
    poses = (start @ SE2(record.truth)).xy_heading
    seen = (camera.capture(i * PERIOD_S, SE2(pose)) for i, pose in enumerate(poses))
    return list(itertools.chain.from_iterable(seen))


def _draw_square(
    loop: Loop, record: TrackingRecord, frames: list[Frame], out: Output, *, of_thesis: bool
) -> None:
    figure = experiment.new_figure(10.5, 4.6, f"Square of 1 m at 1 m/s, loop: {loop}")
    left, right = figure.subplots(1, 2)
    figures = (", as Figure 13 of the thesis", ", as Figure 14 of the thesis")
    positions, speeds = figures if of_thesis else ("", "")
    tracking.draw_positions(left, record, frames, f"position{positions}")
    tracking.draw_speeds(right, record, frames, f"speed{speeds}")
    out.figure("square", figure)


def _flags(parser: argparse.ArgumentParser) -> None:
    add_loop_flag(parser, Loop.OPEN)
    text = "number of squares, from --seed on, to report the spread of their errors"
    flags.add(parser, "--seeds", text, flags.whole(1), 1, "N")
    text = "factor on [errors], the model errors of a built robot"
    flags.add(parser, "--errors", text, flags.SCALE, 1.0, "SCALE")
    text = (
        "plant: rolling by the equations (default), or rigid bodies that slide in MuJoCo, "
        "with the extra `mujoco`: docs/install.md"
    )
    flags.add(parser, "--plant", text, default="kinematic", choices=list(PLANTS))
    text = "friction of the floor assumed by the robot, relative to the true one"
    flags.add(parser, "--believed-friction", text, flags.POSITIVE, 1.0, "SHARE")
    parser.add_argument(
        "--turn",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="with a gyro: first turn in place to measure the wheel speeds; default: do",
    )
    add_drive_flags(parser, "drive a robot on the bus, guided, by its camera; else a simulated one")


EXPERIMENT = Experiment(
    "square",
    run,
    [
        "tsd-lab square --out lab                 open loop, as in the thesis",
        "tsd-lab square --loop gyro               closed by wheels and gyro",
        "tsd-lab square --loop camera --seed 7    and by the camera above",
        "tsd-lab square --loop camera --plant mujoco      on a floor with friction; needs MuJoCo",
        "tsd-lab square --loop gyro --plant mujoco --seeds 20     by 20 robots; needs MuJoCo",
        "tsd-lab square --errors 0 --noise 0      a perfect robot",
        "tsd-lab square --drive --room 1.2 --speed 1      the robot of this machine, guided",
    ],
    robot="tsd",
    noise=True,
    seed_of="all noise",
    add_own_flags=_flags,
)
