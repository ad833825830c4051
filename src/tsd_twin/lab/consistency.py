"""Experiment `consistency`: whether estimates are as exact as their covariances say."""

from __future__ import annotations

import argparse
import functools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import numpy as np
from scipy.special import gammaincinv  # pyright: ignore

from tsd_twin import experiment, flag_types, robots
from tsd_twin.client.simulated import PERIOD_S, VirtualRobot
from tsd_twin.control.state_estimator import StateEstimator
from tsd_twin.errors import TwinError
from tsd_twin.estimation import (
    REGION_SHARE,
    encloses,
    exponential_error,
    heading_region_rad,
    position_region,
)
from tsd_twin.experiment import Experiment, Output
from tsd_twin.kinematics import JointKind
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.requests import PoseStamped, Sample, encode_pose
from tsd_twin.messages.topics import SENSOR_POSE
from tsd_twin.robots import Gyro, RobotDescription, SingularityDescription
from tsd_twin.simulation import PLANTS, Camera, CameraNoise, SimRobot, Simulation, simulate

TIMES_S = (2.0, 5.0, 20.0)
MOUNTED, CONSTANT = "mounted", "2 cm off"
"""Cameras: mounted as exactly as described, or off by a constant distance."""
_CONSTANT_M = 0.02
_POINT_M = 1e-9

# Manoeuvres.


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """Twists in time for any robot over a floor."""

    name: str
    twist: Callable[[float], Sequence[float]]
    """From seconds since the start to vx, vy, omega; m/s and rad/s."""
    drive_speeds: Sequence[float] = ()
    """Speeds of wheels that always spin, as shares of the usual one, for `_SPEED_S` each."""


_SPEED_S = 2.0


def _wander(t_s: float) -> tuple[float, float, float]:
    start = min(1.0, t_s)
    return (
        0.6 * start,
        0.3 * start * math.sin(t_s),
        0.5 * start * math.cos(0.7 * t_s),
    )


def _to_and_fro(t_s: float) -> tuple[float, float, float]:
    return (0.5 if t_s % 4.0 < 2.0 else -0.5, 0.0, 0.0)


MANOEUVRES: tuple[Manoeuvre, ...] = (
    Manoeuvre("straight 0.5 m/s", lambda _t_s: (0.5, 0.0, 0.0)),
    Manoeuvre("straight 1 m/s", lambda _t_s: (1.0, 0.0, 0.0)),
    Manoeuvre("circle", lambda _t_s: (0.5, 0.0, 0.5)),
    Manoeuvre("wander", _wander),
    Manoeuvre("to and fro", _to_and_fro),
    Manoeuvre("drive speeds", lambda _t_s: (0.5, 0.0, 0.0), (1.0, 2.0, 1.5, 3.0)),
    Manoeuvre("standing", lambda _t_s: (0.0, 0.0, 0.0)),
)
BY_NAME = {manoeuvre.name: manoeuvre for manoeuvre in MANOEUVRES}


class _Recorder(SimRobot):
    """Ideal robot that keeps its set-points."""

    def __init__(self, robot: RobotDescription) -> None:
        super().__init__(robot)
        self.setpoints: list[Array] = []

    def write(self, setpoint: Array, now_s: float) -> None:
        """Keep and obey a set-point (n,)."""
        self.setpoints.append(setpoint.copy())
        super().write(setpoint, now_s)


@functools.lru_cache(maxsize=4)
def driven_setpoints(robot_name: str, manoeuvre_name: str, seconds: float) -> tuple[Array, int]:
    """Return the set-points (p, n) of a run from power-up, and at which of them the robot starts.

    They are those of the control loop with all its limits, for commands in the frame of the robot:
    these depend on nothing that is measured.
    """
    robot, manoeuvre = robots.load_robot(robot_name), BY_NAME[manoeuvre_name]
    recorder = _Recorder(robot)
    virtual = VirtualRobot(robot, recorder)
    start = len(recorder.setpoints)
    usual_rpm = getattr(robot.drive, "cruise_speed_rpm", 0.0)  # pyright: ignore
    for i in range(round(seconds / PERIOD_S)):
        t_s = i * PERIOD_S
        if manoeuvre.drive_speeds and t_s % _SPEED_S < 0.5 * PERIOD_S:
            speeds = manoeuvre.drive_speeds
            virtual.choose_drive_speed(usual_rpm * speeds[round(t_s / _SPEED_S) % len(speeds)])
        virtual.drive(np.array(manoeuvre.twist(t_s)))
    return np.array(recorder.setpoints), start


# Runs.


@dataclass(frozen=True, slots=True)
class Case:
    """One row of the table: many robots of one description, all with errors of their own."""

    robot: str
    manoeuvre: str
    errors: float = 0.0
    gyro: bool = False
    camera: str = ""
    """A camera "mounted" as described; or "2 cm off"; or none."""
    plant: str = "kinematic"
    seeds: int = 40
    first: int = 0
    """Seed of the first robot."""
    times_s: tuple[float, ...] = TIMES_S
    """When estimates are compared with the truth, seconds from the start."""

    @property
    def described(self) -> RobotDescription:
        """The robot, as it is described to simulator and estimator."""
        robot = robots.load_robot(self.robot).with_errors(self.errors)
        if not isinstance(robot, SingularityDescription):
            return robot
        if self.gyro:
            robot = msgspec.structs.replace(robot, gyro=Gyro())
        if self.plant == "kinematic":
            # This plant has no friction: a point that touches the floor does not slide.
            floor = msgspec.structs.replace(robot.floor, patch_radius_m=_POINT_M)
            robot = msgspec.structs.replace(robot, floor=floor)
        return robot

    @property
    def sensors(self) -> str:
        """Sensors beside the joints, as text."""
        camera = f"camera, {self.camera}" if self.camera else ""
        return " + ".join(filter(None, ("gyro" if self.gyro else "", camera))) or "joints"


@dataclass(frozen=True, slots=True, eq=False)
class Consistency:
    """Result of a case."""

    case: Case
    nees: Array
    """(times, seeds): squared error in units of the covariance, expected 3."""
    inside: Array
    """(times, seeds): whether the position was inside the drawn region."""
    within: Array
    """(times, seeds): whether the heading was inside the drawn wedge."""

    @property
    def means(self) -> Array:
        """(times,): mean squared errors."""
        return self.nees.mean(axis=-1)

    @property
    def coverage(self) -> Array:
        """(times,): share of the robots inside the drawn region."""
        return self.inside.mean(axis=-1)

    @property
    def heading_coverage(self) -> Array:
        """(times,): share of the robots whose heading is inside the drawn wedge."""
        return self.within.mean(axis=-1)


def band(seeds: int) -> tuple[float, float]:
    """Return the interval that holds 95 % of the means of `seeds` robots that claim right."""
    low, high = (2.0 * float(gammaincinv(1.5 * seeds, share)) / seeds for share in (0.025, 0.975))
    return low, high


def run_case(case: Case) -> Consistency:
    """Drive all robots of a case, and compare their estimates with the truth."""
    robot = case.described
    make = functools.partial(simulate, robot, noise=1.0, errors=1.0, plant=case.plant)
    if case.plant == "kinematic":
        driven = [_drive(case, robot, make((case.seeds,), seed=case.first), case.first)]
    else:
        # Rigid bodies are simulated one robot at a time.
        seeds = range(case.first, case.first + case.seeds)
        driven = [_drive(case, robot, make((), seed=seed), seed) for seed in seeds]
    return Consistency(case, *(np.concatenate(each, axis=-1) for each in zip(*driven, strict=True)))


def _drive(
    case: Case, robot: RobotDescription, simulation: Simulation, seed: int
) -> tuple[Array, ...]:
    """Drive one robot or a batch; return what `_compared` does, (times, robots) each."""
    setpoints, start = driven_setpoints(case.robot, case.manoeuvre, case.times_s[-1])
    estimators = [StateEstimator(robot) for _ in np.atleast_2d(simulation.joints)]
    cameras = _Cameras(case, robot, len(estimators), seed)
    unmeasured = unmeasured_joints(robot)
    marks = SE2.identity()
    ends = {start + round(t_s / PERIOD_S) for t_s in case.times_s}
    results: list[tuple[Array, ...]] = []
    for i in range(max(ends) + 1):
        now_s = (i + 1) * PERIOD_S
        if i > 0:
            simulation.advance(PERIOD_S)
        measured = np.atleast_2d(simulation.measure())
        measured[:, unmeasured] = np.nan
        poses = SE2(np.atleast_2d(simulation.pose.xy_heading))
        if i == start:
            marks = poses
        truths = marks.inverse() @ poses
        for k, estimator in enumerate(estimators):
            estimator.advance(now_s, measured[k], setpoints[max(i - 1, 0)], PERIOD_S)
            if i == start:
                estimator.set_pose(SE2.identity())
            elif i > start:
                cameras.watch(k, estimator, SE2(truths.xy_heading[k]), now_s)
        if i in ends:
            results.append(_compared(estimators, truths))
        if i < len(setpoints):
            simulation.command(setpoints[i])
    return tuple(np.array(each) for each in zip(*results, strict=True))


def unmeasured_joints(robot: RobotDescription) -> list[int]:
    """Return the indices of the joints that the robot does not measure."""
    if robot.measures_spin:
        return []
    joints = enumerate(robot.kinematics().joints)
    return [i for i, joint in joints if joint.kind is JointKind.VELOCITY]


_LEAST_M = 1e-5
"""Standard deviation added to each number, for covariances without extent in some direction."""


def _compared(estimators: Sequence[StateEstimator], truths: SE2) -> tuple[Array, ...]:
    """Return for each robot its squared error in units of the covariance, and what is inside.

    Inside the drawn regions, that is: its position, and its heading.
    """
    messages = [estimator.odometry(0) for estimator in estimators]
    estimates = SE2(np.array([each.xy_heading for each in messages]))
    errors = exponential_error(estimates, truths)
    covariances = np.array([each.pose_covariance for each in messages]) + _LEAST_M**2 * np.eye(3)
    away = (truths.xy_heading - estimates.xy_heading)[:, :2]
    inside = [
        encloses(position_region(covariance), point)
        for covariance, point in zip(covariances, away, strict=True)
    ]
    halves = np.array([heading_region_rad(covariance) for covariance in covariances])
    return (
        squared_errors(errors, covariances),
        np.array(inside, dtype=float),
        (np.abs(errors[:, 2]) <= halves).astype(float),
    )


def squared_errors(errors: Array, covariances: Array) -> Array:
    """Return the squared errors (...) in units of their covariances."""
    solved = np.asarray(np.linalg.solve(covariances, errors[..., None]), dtype=float)
    return (errors * solved[..., 0]).sum(axis=-1)


class _Cameras:
    """Cameras above the robots of a case, one each, which they hear as over the bus."""

    def __init__(self, case: Case, robot: RobotDescription, count: int, seed: int) -> None:
        self._key = SENSOR_POSE.key(robot.name)
        noise, sensor = CameraNoise(), robot.pose_sensor
        if case.camera == MOUNTED:
            noise = replace(
                noise,
                mounting_m=sensor.mounting_m,
                mounting_rad=math.radians(sensor.mounting_deg),
            )
        self._cameras = [Camera(noise, np.random.default_rng([seed + i, 3])) for i in range(count)]
        if not case.camera:
            self._cameras = []
        self._off: Array = np.zeros((count, 3))
        if case.camera == CONSTANT:
            directions = np.random.default_rng([seed, 4]).uniform(0.0, 2.0 * np.pi, count)
            self._off[:, 0] = _CONSTANT_M * np.cos(directions)
            self._off[:, 1] = _CONSTANT_M * np.sin(directions)

    def watch(self, i: int, estimator: StateEstimator, true: SE2, now_s: float) -> None:
        """Look at robot `i`, and pass on what the camera has seen by now."""
        if not self._cameras:
            return
        heard: list[Sample] = []
        for frame in self._cameras[i].capture(now_s, true):
            seen = PoseStamped.planar(SE2(frame.pose + self._off[i]), nanoseconds(frame.taken_s))
            heard.append(Sample(self._key, encode_pose(seen), b""))
        estimator.pose_sensor.receive(heard, now_s, nanoseconds(now_s))
        estimator.pose_sensor.step(now_s, at_rest=False)


def nanoseconds(now_s: float) -> int:
    """Return a time as it is stamped."""
    return round(now_s * 1e9)


# The table.


def cases(args: argparse.Namespace) -> list[Case]:
    """Return the rows of the table.

    Raises:
        TwinError: there is no such robot, manoeuvre or plant, or it does not drive over a floor,
            or no robot has such sensors.
    """
    made: list[Case] = []
    for name in args.robots:
        robot = robots.load_robot(name)
        if robot.kinematics().pose_type is not SE2:
            raise TwinError(f"{name} turns a sphere in place: it follows no manoeuvre")
        for manoeuvre in args.manoeuvres or BY_NAME:
            if manoeuvre not in BY_NAME:
                raise TwinError(f"there is no manoeuvre '{manoeuvre}': {', '.join(BY_NAME)}")
            case = Case(name, manoeuvre, plant=args.plant, seeds=args.seeds, first=args.seed)
            made.extend(case for case in _variants(case, robot) if _applies(case))
    wanted = args.sensors or [case.sensors for case in made]
    unknown = set(wanted) - {case.sensors for case in made}
    if unknown:
        known = "; ".join(dict.fromkeys(case.sensors for case in made))
        raise TwinError(f"none of these robots has the sensors '{min(unknown)}': {known}")
    return [case for case in made if case.sensors in wanted]


def _variants(case: Case, robot: RobotDescription) -> Iterable[Case]:
    """Yield a case with and without errors, gyro and camera."""
    is_tsd = isinstance(robot, SingularityDescription)
    for errors in (0.0, 1.0) if robot.with_errors(0.0) != robot else (0.0,):
        for gyro in (False, True) if is_tsd else (False,):
            for camera in ("", MOUNTED):
                yield replace(case, errors=errors, gyro=gyro, camera=camera)
    yield replace(case, camera=CONSTANT)


def _applies(case: Case) -> bool:
    """Return whether the robot can do it, and has anything to be wrong about."""
    robot = robots.load_robot(case.robot)
    spins = robot.wheel_speed_range is not None
    if BY_NAME[case.manoeuvre].drive_speeds and not spins:
        return False
    return spins or case.manoeuvre != "standing"


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Whether estimates are as exact as their covariances say: the NEES of many robots."""
    rows = cases(args)
    results = experiment.run_cases(run_case, rows, args.jobs, out)
    out.table("consistency", _columns(results))
    _draw(results, out)
    low, high = band(args.seeds)
    return [
        "mean NEES of x, y and heading (3 expected, "
        f"{low:.1f} to {high:.1f} in 95 of 100 tables of {args.seeds} robots)",
        f"and shares of the positions in the drawn region and of the headings in the wedge after "
        f"{TIMES_S[-1]:g} s, {100.0 * REGION_SHARE:.0f} % expected:",
        *_lines(results),
    ]


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


def _lines(results: Sequence[Consistency]) -> list[str]:
    """Return the table in Markdown."""
    times = [f"{t_s:g} s" for t_s in TIMES_S]
    head = ["robot", "errors", "sensors", "manoeuvre", *times, "in region", "in wedge"]
    rows: list[list[str]] = []
    for result in results:
        case = result.case
        cells = [case.robot, f"{case.errors:g}", case.sensors, case.manoeuvre]
        cells += [f"{mean:.1f}" for mean in result.means]
        shares = (result.coverage[-1], result.heading_coverage[-1])
        cells += [f"{100.0 * share:.0f} %" for share in shares]
        rows.append(cells)
    return experiment.markdown_table(head, rows)


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
        default=["tsd", "omni4", "kiwi", "mecanum"],
        metavar="NAME|FILE",
        help="default tsd omni4 kiwi mecanum",
    )
    parser.add_argument(
        "--manoeuvres", nargs="+", metavar="NAME", help=f"of {', '.join(BY_NAME)}; default all"
    )
    parser.add_argument(
        "--seeds", type=flag_types.whole(1), default=40, help="robots of each row; default 40"
    )
    parser.add_argument(
        "--sensors",
        nargs="+",
        metavar="SENSORS",
        help="rows with these, as in the table: joints, 'gyro + camera, mounted'; default all",
    )
    parser.add_argument("--plant", choices=PLANTS, default="kinematic", help="default kinematic")
    experiment.add_jobs_flag(parser)


EXPERIMENT = Experiment(
    "consistency",
    run,
    [
        "tsd-lab consistency",
        "tsd-lab consistency --robots tsd kiwi --manoeuvres circle wander --seeds 10",
        "tsd-lab consistency --robots tsd --plant mujoco --sensors joints",
    ],
    seed_of="the first robot of a row",
    add_own_flags=_flags,
)
