"""Study `camera-gap`: a camera returns to a driving robot, with correct or wrong poses."""

from __future__ import annotations

import argparse
import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from research.open_loop import (
    Case,
    driven_setpoints,
    nanoseconds,
    squared_errors,
    unmeasured_joints,
)
from tsd_twin.cli import experiment, flags
from tsd_twin.cli.experiment import Experiment, Output
from tsd_twin.client.virtual import PERIOD_S
from tsd_twin.control.state_estimator import StateEstimator
from tsd_twin.estimation import exponential_error
from tsd_twin.estimation.consistency import FALSE_ALARM, chi_square_bound
from tsd_twin.lie import SE2, Array, wrap
from tsd_twin.messages.cdr import Odometry
from tsd_twin.messages.pose import PoseStamped, encode_pose
from tsd_twin.messages.topics import SENSOR_POSE, Sample
from tsd_twin.sensors.pose import Camera, CameraNoise, Frame, PoseSensor
from tsd_twin.simulation import PLANTS, simulate


class Picture(StrEnum):
    """Kind of error in a camera's poses."""

    GOOD = "good"
    OUTLIERS = "outliers"
    """One pose in twenty is off by 0.5 m."""
    MIRRORED = "mirrored"
    FROZEN = "frozen"
    """The first pose is repeated forever."""
    SHIFTED = "shifted"
    """All poses are off by 0.5 m in one direction."""

    @property
    def is_right(self) -> bool:
        """Whether nearly all poses are correct."""
        return self in (Picture.GOOD, Picture.OUTLIERS)


OFF_M = 0.5
OUTLIER_SHARE = 0.05
SEEN_S = 2.0
"""Time from the start for which the camera is correct."""
GAP_S, WATCHED_S = 20.0, 3.0
WRONG_S = 5.0
"""Duration of wrong poses if there is no gap."""
_MIRROR_RAD = 1.0
"""Direction of the mirror, a line through the start."""
_NEAR_M, _NEAR_RAD = 0.05, 0.1
_MISLED = chi_square_bound(3, FALSE_ALARM)
_LEAST_M = 1e-5


class _FaultyCamera:
    """Camera above a robot, as described, with optional pose errors."""

    def __init__(self, sensor: PoseSensor, key: str, seed: int) -> None:
        noise = CameraNoise(
            mounting_m=sensor.mounting_m, mounting_rad=math.radians(sensor.mounting_deg)
        )
        self._camera = Camera(noise, np.random.default_rng([seed, 3]))
        self._random = np.random.default_rng([seed, 5])
        self._key = key
        direction = self._random.uniform(0.0, 2.0 * math.pi)
        self._off: Array = OFF_M * np.array([math.cos(direction), math.sin(direction), 0.0])
        self._frozen: Array | None = None
        self._before: Picture | None = None
        self._since_s = -math.inf
        self._picture: Picture | None = Picture.GOOD

    def change(self, picture: Picture | None, now_s: float) -> None:
        """Switch to another kind of poses, or to none."""
        self._before, self._picture, self._since_s = self._picture, picture, now_s

    def watch(self, estimator: StateEstimator, true: SE2, now_s: float) -> None:
        """Take a picture if due, and forward poses whose processing has finished."""
        heard: list[Sample] = []
        for frame in self._camera.capture(now_s, true):
            is_new = frame.taken_s >= self._since_s - 1e-9
            pose = self._seen(frame, self._picture if is_new else self._before)
            if pose is not None:
                seen = PoseStamped.planar(SE2(pose), nanoseconds(frame.taken_s))
                heard.append(Sample(self._key, encode_pose(seen), b""))
        estimator.pose_sensor.receive(heard, now_s, nanoseconds(now_s))
        estimator.pose_sensor.step(now_s, at_rest=False)

    def _seen(self, frame: Frame, picture: Picture | None) -> Array | None:
        pose = frame.pose
        match picture:
            case None:
                return None
            case Picture.GOOD:
                return pose
            case Picture.OUTLIERS:
                if self._random.random() >= OUTLIER_SHARE:
                    return pose
                direction = self._random.uniform(0.0, 2.0 * math.pi)
                return pose + OFF_M * np.array([math.cos(direction), math.sin(direction), 0.0])
            case Picture.MIRRORED:
                c, s = math.cos(2.0 * _MIRROR_RAD), math.sin(2.0 * _MIRROR_RAD)
                x, y, heading = pose
                return np.array([c * x + s * y, s * x - c * y, 2.0 * _MIRROR_RAD - heading])
            case Picture.FROZEN:
                self._frozen = pose if self._frozen is None else self._frozen
                return self._frozen
            case Picture.SHIFTED:
                return pose + self._off


@dataclass(frozen=True, slots=True, eq=False)
class Recovery:
    """Estimates of many robots after the camera returns with one kind of poses."""

    case: Case
    gap_s: float
    picture: Picture
    believed_s: Array
    """(seeds,): time until the estimate is permanently near the true pose; infinite if never."""
    misled: Array
    """(seeds,): whether the final estimate is further from the true pose than it claims."""


def run_case(
    case: Case, gap_s: float = GAP_S, pictures: Sequence[Picture] = tuple(Picture)
) -> list[Recovery]:
    """Drive all robots of a case, remove the camera, and restore it with each kind of poses."""
    watched_s = WATCHED_S if gap_s > 0.0 else WRONG_S
    seconds = SEEN_S + gap_s + watched_s
    runs = [
        run
        for batch in _batches(case)
        for run in _drive(case, batch, gap_s, round(watched_s / PERIOD_S), seconds, pictures)
    ]
    results: list[Recovery] = []
    for picture in pictures:
        watched = [run[picture] for run in runs]
        columns = [np.array(column) for column in zip(*watched, strict=True)]
        results.append(Recovery(case, gap_s, picture, *columns))
    return results


def _batches(case: Case) -> list[list[int]]:
    """Return the seeds of each simulation; rigid bodies are simulated one robot at a time."""
    seeds = list(range(case.first, case.first + case.seeds))
    return [seeds] if case.plant == "kinematic" else [[seed] for seed in seeds]


_Run = dict[Picture, tuple[float, bool]]


def _drive(
    case: Case,
    seeds: Sequence[int],
    gap_s: float,
    watched: int,
    seconds: float,
    pictures: Sequence[Picture],
) -> list[_Run]:
    robot = case.described
    drive = _driven(case, seeds, seconds)
    back = len(drive.truths) - watched
    gone = drive.start + round(SEEN_S / PERIOD_S)
    runs: list[_Run] = []
    for k, seed in enumerate(seeds):
        estimator = StateEstimator(robot)
        camera = _FaultyCamera(robot.pose_sensor, SENSOR_POSE.key(robot.name), seed)
        for i in range(back):
            if i == gone and gap_s > 0.0:
                camera.change(None, (i + 1) * PERIOD_S)
            drive.step(estimator, camera, i, k)
        run: _Run = {}
        for picture in pictures:
            own, seen = copy.deepcopy(estimator), copy.deepcopy(camera)
            seen.change(picture, (back + 1) * PERIOD_S)
            states: list[Odometry] = []
            for i in range(back, len(drive.truths)):
                drive.step(own, seen, i, k)
                states.append(own.odometry(0))
            run[picture] = _judged(states, np.array([truth[k] for truth in drive.truths[back:]]))
        runs.append(run)
    return runs


@dataclass(frozen=True, slots=True, eq=False)
class _Driven:
    """Batch of simulated robots after a drive."""

    start: int
    """Period in which they start."""
    setpoints: Array
    measured: list[Array]
    """Measured joints (robots, n) of each period."""
    truths: list[Array]
    """True poses (robots, 3) of each period since the start."""

    def step(self, estimator: StateEstimator, camera: _FaultyCamera, i: int, k: int) -> None:
        """Advance the estimator of robot `k` through period `i`, with a camera."""
        now_s, setpoint = (i + 1) * PERIOD_S, self.setpoints[max(i - 1, 0)]
        estimator.advance(now_s, self.measured[i][k], setpoint, PERIOD_S)
        if i == self.start:
            estimator.set_pose(SE2.identity())
        elif i > self.start:
            camera.watch(estimator, SE2(self.truths[i][k]), now_s)


def _driven(case: Case, seeds: Sequence[int], seconds: float) -> _Driven:
    """Drive a batch of robots."""
    robot = case.described
    setpoints, start = driven_setpoints(case.robot, case.manoeuvre, seconds)
    batch = (len(seeds),) if case.plant == "kinematic" else ()
    simulation = simulate(robot, batch, seed=seeds[0], noise=1.0, errors=1.0, plant=case.plant)
    unmeasured = unmeasured_joints(robot)
    measured: list[Array] = []
    poses: list[SE2] = []
    for i in range(start + round(seconds / PERIOD_S)):
        if i > 0:
            simulation.advance(PERIOD_S)
        measured.append(np.atleast_2d(simulation.measure()))
        measured[-1][:, unmeasured] = np.nan
        poses.append(SE2(np.atleast_2d(simulation.pose.xy_heading)))
        simulation.command(setpoints[i])
    truths = [(poses[start].inverse() @ pose).xy_heading for pose in poses]
    return _Driven(start, setpoints, measured, truths)


def _judged(states: Sequence[Odometry], truths: Array) -> tuple[float, bool]:
    """Return the time until the estimate stays near the truth, and whether it is misled."""
    poses = np.array([state.xy_heading for state in states])
    off = truths - poses
    near = (np.hypot(off[:, 0], off[:, 1]) < _NEAR_M) & (np.abs(wrap(off[:, 2])) < _NEAR_RAD)
    away = np.flatnonzero(~near)
    believed_s = (float(away[-1]) + 1.0) * PERIOD_S if len(away) else 0.0
    error = exponential_error(SE2(poses[-1:]), SE2(truths[-1:]))
    covariance = np.array([states[-1].pose_covariance]) + _LEAST_M**2 * np.eye(3)
    is_misled = bool(squared_errors(error, covariance)[0] > _MISLED)
    return believed_s if near[-1] else math.inf, is_misled


# Table.

_AFTER_GAP = (Picture.GOOD, Picture.OUTLIERS, Picture.MIRRORED, Picture.FROZEN)
_WITHOUT_GAP = (Picture.OUTLIERS, Picture.MIRRORED, Picture.FROZEN, Picture.SHIFTED)
MANOEUVRES = ("straight 0.5 m/s", "circle", "wander")


@dataclass(frozen=True, slots=True, eq=False)
class _GapResult:
    """Results of a case: after a gap, and without one."""

    after: dict[Picture, Recovery]
    without: dict[Picture, Recovery]


def _row(case: Case) -> _GapResult:
    after, without = run_case(case, GAP_S, _AFTER_GAP), run_case(case, 0.0, _WITHOUT_GAP)
    return _GapResult(
        {each.picture: each for each in after}, {each.picture: each for each in without}
    )


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """A camera returns to a driving robot: time to accept good poses, rejection of wrong ones."""
    cases = [
        Case(args.robot, manoeuvre, errors, plant=args.plant, seeds=args.seeds, first=args.seed)
        for manoeuvre in MANOEUVRES
        for errors in (0.0, 1.0)
    ]
    rows = experiment.run_cases(_row, cases, args.jobs, out)
    results = [each for row in rows for part in (row.after, row.without) for each in part.values()]
    out.table("camera_gap", _columns(results))
    _draw(rows, out)
    return [
        f"camera away for {GAP_S:g} s, {args.seeds} robots of each row; time until believed again, "
        "median / 95 of 100 / worst;",
        "and robots that are misled by wrong pictures, after the gap and instead of good ones:",
        *_lines(rows),
    ]


def _columns(results: Sequence[Recovery]) -> dict[str, Sequence[float | str]]:
    each = [(result, i) for result in results for i in range(len(result.misled))]
    return {
        "manoeuvre": [result.case.manoeuvre for result, _ in each],
        "errors": [result.case.errors for result, _ in each],
        "gap_s": [result.gap_s for result, _ in each],
        "picture": [result.picture.value for result, _ in each],
        "seed": [result.case.first + i for result, i in each],
        "believed_s": [float(result.believed_s[i]) for result, i in each],
        "misled": [float(result.misled[i]) for result, i in each],
    }


def _lines(rows: Sequence[_GapResult]) -> list[str]:
    """Return the table in Markdown."""
    wrong_after = [picture for picture in _AFTER_GAP if picture is not Picture.GOOD]
    head = ["manoeuvre", "errors", "good, s", "with outliers, s"]
    head += [f"after it {', '.join(wrong_after)}", f"without it {', '.join(_WITHOUT_GAP)}"]
    lines: list[list[str]] = []
    for row in rows:
        case = row.after[Picture.GOOD].case
        cells = [case.manoeuvre, f"{case.errors:g}"]
        shown = (row.after[picture] for picture in (Picture.GOOD, Picture.OUTLIERS))
        cells += [experiment.spread(result.believed_s, 2) for result in shown]
        for part, pictures in ((row.after, wrong_after), (row.without, _WITHOUT_GAP)):
            misled = [int(part[picture].misled.sum()) for picture in pictures]
            cells.append(", ".join(map(str, misled)))
        lines.append(cells)
    return experiment.markdown_table(head, lines)


def _draw(rows: Sequence[_GapResult], out: Output) -> None:
    figure = experiment.new_figure(9.0, 4.2, "A camera that comes back: when it is believed again")
    axes: Any = figure.subplots()
    names: list[str] = []
    for i, row in enumerate(rows):
        case = row.after[Picture.GOOD].case
        names.append(f"{case.manoeuvre}, errors {case.errors:g}")
        for k, picture in enumerate((Picture.GOOD, Picture.OUTLIERS)):
            times = row.after[picture].believed_s
            places = np.full(len(times), i + 0.2 * (k - 0.5))
            colour = experiment.SERIES_COLOURS[k]
            label = picture.value if i == 0 else None
            axes.plot(places, times, "o", color=colour, markersize=4, label=label)
    axes.axhline(1.0, color=experiment.REFERENCE_COLOUR, linestyle="--")
    axes.set_ylim(bottom=0.0)
    axes.set_xticks(range(len(names)), names, rotation=15)
    experiment.label_axes(axes, "", "time until believed (s)")
    experiment.add_legend(axes)
    out.figure("camera_gap", figure)


def _flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--seeds", type=flags.whole(1), default=10, help="robots of each row; default 10"
    )
    parser.add_argument("--plant", choices=PLANTS, default="kinematic", help="default kinematic")
    experiment.add_jobs_flag(parser)


EXPERIMENT = Experiment(
    "camera-gap",
    run,
    ["python -m research camera-gap", "python -m research camera-gap --seeds 40 --seed 100"],
    robot="tsd",
    seed_of="the first robot of a row",
    add_own_flags=_flags,
)
