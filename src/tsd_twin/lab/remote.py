"""Slalom by a scripted operator over a link, with and without predicted pose and speed cap.

The operator sees a pose as old as the link makes it, reacts after the time of a person, and steers
for a point ahead on the path, as drivers do. McRuer and Jex (1967) measured 0.15 to 0.25 s of
effective delay in compensatory tracking; the hand adds a first-order lag.
"""

from __future__ import annotations

import argparse
import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import msgspec
import numpy as np

from tsd_twin import robots
from tsd_twin.cli import experiment, flags
from tsd_twin.cli.experiment import Axes, Experiment, Output
from tsd_twin.client import procedures
from tsd_twin.client.errors import ClientError
from tsd_twin.client.protocol import COMMAND_PERIOD_S, ControlProtocol
from tsd_twin.client.virtual import SimulationLink
from tsd_twin.errors import TwinError
from tsd_twin.lab.tracking import distances_to_path, named_path
from tsd_twin.lie import SE2, Array
from tsd_twin.link_emulation.spec import PROFILES, LinkSpec
from tsd_twin.messages.cdr import BASE
from tsd_twin.motion.prediction import PendingCommand, Predictor
from tsd_twin.robots import RobotDescription
from tsd_twin.simulation import SimRobot

REACTION_S, HAND_S = 0.2, 0.1
"""Delay from seeing to acting, and time constant of the hand."""
LOOK_AHEAD_S = 0.7
"""Preview of the operator, in time at the speed of the stick."""
_TURN_PER_RAD = 1.5
_PUSH_AGAIN_S = 1.0
"""Reaction time of a person after a stop of the robot: release the stick and push it again."""
_MARGIN_S = 0.15
"""Age of a command apart from the link: periods of status and command, and its execution."""
_UNCAPPED_M = 1000.0
_LONGEST = 4.0
"""A run ends at the latest after so many times the duration at full stick."""


@dataclass(frozen=True, slots=True)
class RemoteCase:
    """One drive over a link."""

    robot: RobotDescription
    link: str
    ghost: bool
    """Whether the operator watches the predicted pose rather than the received one."""
    cap: bool
    """Whether the lease caps the speed (`limits.stop_allowance_m`)."""
    speed_mps: float
    seed: int


@dataclass(frozen=True, slots=True, eq=False)
class RemoteRun:
    """Result of a drive."""

    case: RemoteCase
    truth: Array
    """(n, 3): true poses relative to the start, every 20 ms."""
    path_xy: Array
    """(m, 2): points along the path."""
    took_s: float
    finished: bool
    stops: int
    """Number of automatic stops during the drive."""

    @property
    def rms_m(self) -> float:
        """RMS distance from the path."""
        return float(np.sqrt(np.mean(np.square(self.away_m))))

    @property
    def worst_m(self) -> float:
        """Maximum distance from the path."""
        return float(self.away_m.max())

    @property
    def away_m(self) -> Array:
        """(n,): distances from the path."""
        return distances_to_path(self.truth[:, :2], self.path_xy)


@dataclass
class ScriptedOperator:
    """Person with a stick, who steers for a point ahead on the path."""

    path_xy: Array
    """(m, 2): points along the path."""
    speed_mps: float
    _seen: deque[tuple[float, SE2]] = field(default_factory=deque[tuple[float, SE2]])
    _stick: Array = field(default_factory=lambda: np.zeros(3))
    _nearest: int = 0

    def at_end(self, xy: Array) -> bool:
        """Return whether a position (2,) is past the last gate."""
        return bool(xy[0] >= self.path_xy[-1, 0] - 0.05)

    def push(self, now_s: float, shown: SE2) -> Array:
        """Return the twist (3,) of the stick in the base frame, for the pose shown now."""
        self._seen.append((now_s, shown))
        pose = self._seen[0][1]
        while self._seen and self._seen[0][0] <= now_s - REACTION_S:
            pose = self._seen.popleft()[1]
        x, y, heading_rad = pose.xy_heading
        ahead = self.path_xy[self._nearest : self._nearest + 200]
        self._nearest += int(np.argmin(np.hypot(*(ahead - [x, y]).T)))
        along_m = np.hypot(*np.diff(self.path_xy[self._nearest :], axis=0).T).cumsum()
        look_m = self.speed_mps * LOOK_AHEAD_S
        goal = self.path_xy[self._nearest + int(np.searchsorted(along_m, look_m))]
        towards = pose.inverse().rotate(goal - np.array([x, y]))
        wanted = np.append(
            self.speed_mps * towards / max(float(np.hypot(*towards)), 1e-9),
            -_TURN_PER_RAD * heading_rad,
        )
        self._stick += (1.0 - math.exp(-COMMAND_PERIOD_S / HAND_S)) * (wanted - self._stick)
        return self._stick.copy()

    def let_go(self) -> None:
        """Let the stick go."""
        self._stick = np.zeros(3)


class _Display:
    """Pose that the page shows: as received, or predicted to when a command sent now arrives."""

    def __init__(self, protocol: ControlProtocol, robot: RobotDescription, *, ghost: bool) -> None:
        self._protocol = protocol
        self._limit_mps = robot.limits.speed_mps
        self._predictor = Predictor(robot.kinematics(), robot.limits, robot.lag_s)
        self._sent: deque[tuple[float, Array]] = deque(maxlen=100)
        self._ghost = ghost

    def add_sent(self, now_s: float, twist: Array) -> None:
        self._sent.append((now_s, twist))

    def pose(self, now_s: float) -> SE2:
        here = self._protocol.pose(now_s)
        delay_s = self._protocol.delay_s(now_s)
        if not self._ghost or delay_s is None:
            return here
        flying = [
            PendingCommand(sent_s - now_s + delay_s, twist)
            for sent_s, twist in self._sent
            if sent_s > now_s - delay_s - COMMAND_PERIOD_S
        ]
        first = flying[0].request if flying else np.zeros(3)
        share = self._protocol.latest_status.limits.speed_mps / self._limit_mps
        measured = self._protocol.estimated_twist
        return here @ self._predictor.after(delay_s, SE2.identity(), first, flying, share, measured)


def drive_slalom(case: RemoteCase) -> RemoteRun:
    """Drive the slalom once, in virtual time."""
    robot = case.robot
    if not case.cap:
        limits = msgspec.structs.replace(robot.limits, stop_allowance_m=_UNCAPPED_M)
        robot = msgspec.structs.replace(robot, limits=limits)
    network = link_of(case.link, case.seed)
    link = SimulationLink(robot, SimRobot(robot, seed=case.seed), None, network)
    protocol = ControlProtocol(robot.name, robot, "remote")
    link.attach(protocol)
    link.run(procedures.acquire(protocol, max_age_s=max_age_s(network)))
    link.run(procedures.arm(protocol, link.now_s()))
    path = named_path("sine")
    path_xy = path.at(np.linspace(0.0, path.length_m, 2001)).xy
    operator = ScriptedOperator(path_xy, case.speed_mps)
    display = _Display(protocol, robot, ghost=case.ghost)
    start_s, stops = link.now_s(), 0
    truth = [_true_pose(link).xy_heading]
    most_s = _LONGEST * path.length_m / case.speed_mps
    while not (done := operator.at_end(truth[-1][:2])) and link.now_s() - start_s < most_s:
        now_s = link.now_s()
        try:
            twist = operator.push(now_s, display.pose(now_s))
            command = protocol.set_velocity(twist.tolist(), BASE, now_s)
        except ClientError:
            operator.let_go()
            stops += 1
            link.sleep_until(now_s + _PUSH_AGAIN_S)
        else:
            display.add_sent(now_s, twist)
            if command is not None:
                link.send(command)
            link.sleep_until(now_s + COMMAND_PERIOD_S)
        truth.append(_true_pose(link).xy_heading)
    return RemoteRun(case, np.array(truth), path_xy, link.now_s() - start_s, done, stops)


def _true_pose(link: SimulationLink) -> SE2:
    pose = link.simulated.truth(link.now_s()).pose
    if not isinstance(pose, SE2):
        raise TwinError(f"{link.id} turns a sphere in place: it drives no slalom")
    return pose


def link_of(name: str, seed: int) -> LinkSpec:
    """Return a link by name of a profile or by its text, with a seed; `direct` is a cable."""
    spec = LinkSpec(delay_s=0.001) if name == DIRECT else LinkSpec.parse(name)
    return replace(spec, seed=seed)


def max_age_s(link: LinkSpec) -> float:
    """Return the age of commands to ask for: both ways of the link with its jitter, and periods."""
    wander_s = link.wander.most_s if link.wander else 0.0
    stall_s = link.stall.length_s if link.stall else 0.0
    return 2.0 * (link.delay_s + wander_s + 3.0 * link.jitter_s) + stall_s + _MARGIN_S


DIRECT = "direct"
VARIANTS = {
    "as received": (False, False),
    "ghost": (True, False),
    "speed cap": (False, True),
    "ghost and cap": (True, True),
}
"""Names of the combinations of predicted pose and speed cap."""


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """A slalom by a scripted operator over each link, with and without ghost and speed cap."""
    robot = robots.load_robot(args.robot)
    links = args.link or [DIRECT, *PROFILES]
    cases = [
        RemoteCase(robot, link, ghost, cap, args.speed, args.seed + run)
        for link in links
        for ghost, cap in VARIANTS.values()
        for run in range(args.runs)
    ]
    runs = experiment.run_cases(drive_slalom, cases, args.jobs, out)
    groups = {
        (link, name): [
            run
            for run in runs
            if run.case.link == link and (run.case.ghost, run.case.cap) == variant
        ]
        for link in links
        for name, variant in VARIANTS.items()
    }
    out.table("remote", _columns(runs))
    _draw(groups, links, out)
    head = ["link", "operator", "RMS off (mm)", "most off (mm)", "time (s)", "stops", "finished"]
    return experiment.markdown_table(head, [_row(*key, group) for key, group in groups.items()])


def _row(link: str, name: str, runs: Sequence[RemoteRun]) -> list[str]:
    return [
        link,
        name,
        f"{1000 * np.median([run.rms_m for run in runs]):.0f}",
        f"{1000 * max(run.worst_m for run in runs):.0f}",
        f"{np.median([run.took_s for run in runs]):.1f}",
        f"{sum(run.stops for run in runs)}",
        f"{sum(run.finished for run in runs)} of {len(runs)}",
    ]


def _columns(runs: Sequence[RemoteRun]) -> dict[str, list[float | str]]:
    return {
        "link": [run.case.link for run in runs],
        "ghost": [float(run.case.ghost) for run in runs],
        "cap": [float(run.case.cap) for run in runs],
        "seed": [float(run.case.seed) for run in runs],
        "rms_m": [run.rms_m for run in runs],
        "worst_m": [run.worst_m for run in runs],
        "took_s": [run.took_s for run in runs],
        "stops": [float(run.stops) for run in runs],
        "finished": [float(run.finished) for run in runs],
    }


def _draw(
    groups: Mapping[tuple[str, str], Sequence[RemoteRun]], links: Sequence[str], out: Output
) -> None:
    figure: Any = experiment.new_figure(8.0, 2.1 * len(links) + 0.6, "Slalom over a link")
    first: Axes = None
    for i, link in enumerate(links):
        axes: Axes = figure.add_subplot(len(links), 1, i + 1, sharex=first, sharey=first)
        path_xy = groups[link, next(iter(VARIANTS))][0].path_xy
        axes.plot(*path_xy.T, "--", color=experiment.REFERENCE_COLOUR, label="path")
        for name, colour in zip(VARIANTS, experiment.SERIES_COLOURS, strict=False):
            axes.plot(*groups[link, name][0].truth[:, :2].T, color=colour, label=name)
        axes.set_aspect("equal")
        x_label = "x (m)" if link == links[-1] else ""
        experiment.label_axes(axes, x_label, "y (m)", link)
        if first is None:
            first = axes
            experiment.add_legend(axes, ncols=5, loc="lower right", bbox_to_anchor=(1.0, 1.0))
    out.figure("remote", figure)


def _flags(parser: argparse.ArgumentParser) -> None:
    text = f"profiles or links as of tsd-link; default {DIRECT} and all profiles"
    parser.add_argument("--link", nargs="+", metavar="SPEC", help=text)
    text = "of the full stick, m/s; default 0.7"
    flags.add(parser, "--speed", text, flags.POSITIVE, 0.7, "MPS")
    flags.add(parser, "--runs", "drives each, with seeds that follow", flags.whole(1), 3)
    experiment.add_jobs_flag(parser)


EXPERIMENT = Experiment(
    "remote",
    run,
    [
        "tsd-lab remote --out lab",
        "tsd-lab remote --link transatlantic satellite,loss=5% --runs 20",
        "tsd-lab remote --link delay=300ms --speed 0.2 --robot mecanum",
    ],
    robot="tsd",
    seed_of="links and sensors",
    add_own_flags=_flags,
)
