"""Study `go-to`: simulated robots drive to goals over a link with known or unknown delay."""

from __future__ import annotations

import argparse
import functools
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import msgspec
import numpy as np

from tsd_twin import robots
from tsd_twin.cli import experiment, flags
from tsd_twin.cli.experiment import Experiment, Output
from tsd_twin.client.virtual import PERIOD_S
from tsd_twin.client.virtual_robot import VirtualRobot
from tsd_twin.lie import SE2, Array
from tsd_twin.messages.pose import PoseStamped, encode_pose
from tsd_twin.messages.sentences import sentence
from tsd_twin.messages.status import CommandStatus
from tsd_twin.messages.topics import SENSOR_POSE, Sample
from tsd_twin.motion import TwistLimiter
from tsd_twin.motion.prediction import CommandDelay
from tsd_twin.motion.routes import NavigationGoal
from tsd_twin.motion.tracking import ExecutionPhase, ExecutionStep, TrajectoryExecutor
from tsd_twin.motion.trajectory import plan
from tsd_twin.sensors.pose import Camera
from tsd_twin.simulation import SimRobot

HELD = 2
"""Periods for which a command holds; a page sends one every 20 ms."""
STATUS_EVERY = 5
"""Periods between two status messages."""
_SPEED_SHARE = 0.8
_REST_PERIODS = 100
_MAX_PERIODS = 6000


class _DelayedState(NamedTuple):
    """Robot state on the link: pose, and with a status the latest accepted command."""

    pose: SE2
    command: CommandStatus | None


class LinkedRobot:
    """Robot in virtual time behind a link that delays commands and states by `delay_s` / 2 each."""

    def __init__(
        self,
        name: str,
        delay_s: float = 0.0,
        *,
        seed: int = 1,
        errors: float = 0.0,
        has_camera: bool = False,
    ) -> None:
        self.robot = robots.load_robot(name)
        simulated = SimRobot(self.robot, seed, errors, errors=errors)
        self.virtual = VirtualRobot(self.robot, simulated)
        noise = self.robot.pose_sensor.camera_noise()
        self._camera = Camera(noise, np.random.default_rng([seed, 7])) if has_camera else None
        late = round(0.5 * delay_s / PERIOD_S)
        self._there = deque([(0, np.zeros(3))] * late, late + 1)
        self._back = deque([_DelayedState(self.seen, None)] * late, late + 1)
        self._counted = (0, 0.0)
        self._periods = 0
        self._seq = 0
        self.delay = CommandDelay()
        self.way: list[Array] = []
        """True poses, a row per period."""

    @property
    def seen(self) -> SE2:
        """Latest estimated pose."""
        return SE2(self.virtual.odometry().xy_heading)

    def follow(
        self,
        goal: NavigationGoal,
        *,
        believed_s: float,
        is_measured: bool = True,
        most_periods: int = _MAX_PERIODS,
    ) -> tuple[TrajectoryExecutor, ExecutionStep]:
        """Follow a path to a goal, initially assuming the delay `believed_s`."""
        limits = self.robot.limits
        limits = msgspec.structs.replace(limits, speed_mps=_SPEED_SHARE * limits.speed_mps)
        kinematics = self.robot.kinematics()
        trajectory = plan(goal.route(self.seen), kinematics, limits, share=0.7, cell_m=0.02)
        executor = TrajectoryExecutor(
            trajectory,
            TwistLimiter(kinematics, limits).cap,
            lag_s=self.robot.lag_s,
            delay_s=believed_s,
        )
        step = None
        for i in range(most_periods):
            now_s = i * PERIOD_S
            pose = self._receive(now_s)
            if step is None or i % HELD == 0:
                delay_s = self.delay.median_s(now_s) if is_measured else None
                step = executor.advance(now_s, pose, delay_s)
                if step.phase is not ExecutionPhase.GOING:
                    break
                self._seq += 1
                self.delay.add_sent(self._seq, now_s)
            self.drive(step.twist)
        assert step is not None  # noqa: S101  There is at least one period.
        return executor, step

    def drive(self, twist: Array) -> None:
        """Send a twist (3,), and run the robot for one period."""
        self._there.append((self._seq, twist))
        seq, arrived = self._there[0]
        self._periods += 1
        now_s = self._periods * PERIOD_S
        if seq != self._counted[0]:
            self._counted = (seq, now_s)
        self.virtual.drive(arrived)
        self.way.append(self.virtual.truth.xy_heading)
        if self._camera is not None:
            self._send_frames(self._camera)

    def _send_frames(self, camera: Camera) -> None:
        """Send the processed frames of the camera to the robot."""
        now_s = self.virtual.now_s
        poses = [
            PoseStamped.planar(SE2(frame.pose), round(frame.taken_s * 1e9))
            for frame in camera.capture(now_s, self.virtual.truth)
        ]
        samples = [
            Sample(SENSOR_POSE.key(self.robot.name), encode_pose(seen), b"") for seen in poses
        ]
        self.virtual.controller.add_pose_measurements(samples, now_s, round(now_s * 1e9))

    def rest(self) -> None:
        """Send zeros for a second, in which every robot comes to rest."""
        for _ in range(_REST_PERIODS):
            self.drive(np.zeros(3))

    def _receive(self, now_s: float) -> SE2:
        """Send the current state, and receive the delayed one."""
        command = None
        if self._periods % STATUS_EVERY == 0:
            seq, counted_s = self._counted
            command = CommandStatus(seq=seq, age_s=self._periods * PERIOD_S - counted_s)
        self._back.append(_DelayedState(self.seen, command))
        state = self._back[0]
        if state.command is not None:
            self.delay.add_status(state.command, now_s)
        return state.pose


@dataclass(frozen=True, slots=True)
class Case:
    """Row of the table."""

    robot: str
    delay_s: float
    believed_s: float
    is_measured: bool = True
    seeds: int = 20
    first: int = 0
    errors: float = 0.0
    """Scale of the errors and noise of the robot."""
    has_camera: bool = False

    @property
    def sensing(self) -> str:
        """Source of the estimate, for tables."""
        if self.errors == 0.0:
            return "exact odometry"
        return "errors, camera" if self.has_camera else "errors, no camera"


class Arrival(NamedTuple):
    """Result of a robot's drive to its goal."""

    has_arrived: bool
    overshoot_m: float
    """Maximum distance beyond the goal, in the direction from start to goal; negative if short."""
    beside_m: float
    """Maximum distance from the straight line."""
    off_m: float
    """Final distance of the true position from the goal."""
    off_by_estimate_m: float
    """Final distance of the estimated position from the goal."""
    time_s: float
    reason: str


def go(case: Case, seed: int) -> Arrival:
    """Send a robot to a random place, with or without a random heading."""
    random = np.random.default_rng([seed, 6])
    direction = random.uniform(-math.pi, math.pi)
    goal = random.uniform(0.8, 2.5) * np.array([math.cos(direction), math.sin(direction)])
    heading = random.uniform(-math.pi, math.pi) if seed % 2 else None
    linked = LinkedRobot(
        case.robot,
        case.delay_s,
        seed=1 if case.errors == 0.0 else seed,
        errors=case.errors,
        has_camera=case.has_camera,
    )
    _, step = linked.follow(
        NavigationGoal(goal[None], heading),
        believed_s=case.believed_s,
        is_measured=case.is_measured,
    )
    time_s = len(linked.way) * PERIOD_S
    linked.rest()
    way = np.array(linked.way)[:, :2]
    along = goal / np.hypot(*goal)
    beside = np.abs(way[:, 1] * along[0] - way[:, 0] * along[1])
    return Arrival(
        step.phase is ExecutionPhase.ARRIVED,
        float((way @ along).max() - np.hypot(*goal)),
        float(beside.max()),
        float(np.hypot(*(way[-1] - goal))),
        float(np.hypot(*(linked.seen.xy_heading[:2] - goal))),
        time_s,
        sentence(step.why) if step.why else "",
    )


# Table.


@dataclass(frozen=True, slots=True)
class _ArrivalResult:
    case: Case
    arrivals: list[Arrival]

    def column(self, name: str) -> list[float]:
        """Return one quantity of all arrivals."""
        return [float(getattr(arrival, name)) for arrival in self.arrivals]


def _run_case(case: Case) -> _ArrivalResult:
    return _ArrivalResult(case, [go(case, case.first + i) for i in range(case.seeds)])


UNKNOWN_S = 0.2
"""Unknown part of the delay at the start."""


def cases(robot: str, seeds: int, first: int) -> list[Case]:
    """Return the rows of the table: delays that are known or unknown at the start."""
    make = functools.partial(Case, seeds=seeds, first=first)
    believed = (0.0, 0.1, 0.3)
    return [
        *(make(robot, delay_s, delay_s) for delay_s in believed),
        *(make(robot, delay_s + UNKNOWN_S, delay_s) for delay_s in believed),
        make(robot, 0.1 + UNKNOWN_S, 0.1, is_measured=False),
        make(robot, 0.3, 0.3, errors=1.0),
        make(robot, 0.3, 0.3, errors=1.0, has_camera=True),
    ]


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Drive to goals over a link whose delay is known or unknown at the start."""
    wanted = cases(args.robot, args.seeds, args.seed)
    rows = experiment.run_cases(_run_case, wanted, args.jobs, out)
    numbers = ("has_arrived", "overshoot_m", "beside_m", "off_m", "off_by_estimate_m", "time_s")
    columns: dict[str, Sequence[float | str]] = {
        "delay_s": [row.case.delay_s for row in rows for _ in row.arrivals],
        "believed_s": [row.case.believed_s for row in rows for _ in row.arrivals],
        "measured": [float(row.case.is_measured) for row in rows for _ in row.arrivals],
        "errors": [row.case.errors for row in rows for _ in row.arrivals],
        "camera": [float(row.case.has_camera) for row in rows for _ in row.arrivals],
    }
    columns |= {name: [value for row in rows for value in row.column(name)] for name in numbers}
    out.table("go_to", columns)
    _draw(rows, out)
    return [
        f"{args.seeds} places; median / 95 of 100 / worst:",
        *_lines(rows),
    ]


def _lines(rows: Sequence[_ArrivalResult]) -> list[str]:
    """Return the table in Markdown."""
    head = ["delay, ms", "at first believed", "measured", "robot", "lost"]
    head += ["overshoot, mm", "beside the line, mm", "off by the estimate, mm", "off in truth, mm"]
    head += ["time, s"]
    lines: list[list[str]] = []
    for row in rows:
        case = row.case
        cells = [f"{1e3 * case.delay_s:.0f}", f"{1e3 * case.believed_s:.0f}"]
        cells += ["yes" if case.is_measured else "no", case.sensing]
        cells.append(str(sum(not arrival.has_arrived for arrival in row.arrivals)))
        for name, scale, digits in (
            ("overshoot_m", 1e3, 1),
            ("beside_m", 1e3, 0),
            ("off_by_estimate_m", 1e3, 0),
            ("off_m", 1e3, 0),
            ("time_s", 1.0, 2),
        ):
            cells.append(experiment.spread(scale * np.array(row.column(name)), digits))
        lines.append(cells)
    return experiment.markdown_table(head, lines)


def _draw(rows: Sequence[_ArrivalResult], out: Output) -> None:
    figure = experiment.new_figure(9.0, 4.2, "Going to a place over a link with a delay")
    axes: Any = figure.subplots()
    names: list[str] = []
    for i, row in enumerate(rows):
        case = row.case
        measured = "" if case.is_measured else ", not measured"
        believed = f"{1e3 * case.delay_s:.0f} ms\nfor {1e3 * case.believed_s:.0f}{measured}"
        names.append(believed if case.errors == 0.0 else f"{believed}\n{case.sensing}")
        overshoot = 1e3 * np.array(row.column("overshoot_m"))
        places = np.full(len(overshoot), float(i))
        axes.plot(places, overshoot, "o", color=experiment.SERIES_COLOURS[0], markersize=4)
    axes.axhline(10.0, color=experiment.REFERENCE_COLOUR, linestyle="--")
    axes.set_yscale("symlog", linthresh=10.0)
    axes.set_xticks(range(len(names)), names)
    experiment.label_axes(axes, "", "overshoot (mm)")
    out.figure("go_to", figure)


def _flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--seeds", type=flags.whole(1), default=20, help="places of each row; default 20"
    )
    experiment.add_jobs_flag(parser)


EXPERIMENT = Experiment(
    "go-to",
    run,
    ["python -m research go-to", "python -m research go-to --robot omni4 --seeds 10"],
    robot="tsd",
    seed_of="the first place",
    add_own_flags=_flags,
)
