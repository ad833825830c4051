"""Experiment `health`: robots, recordings or many simulated robots against their shadow twins."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import numpy as np

from tsd_twin import robots
from tsd_twin.cli import experiment, flags
from tsd_twin.cli.experiment import Experiment, Output
from tsd_twin.client.state import RobotState
from tsd_twin.client.sync import RobotClient, connect
from tsd_twin.client.virtual import SimulationLink
from tsd_twin.errors import TwinError
from tsd_twin.kinematics import JointKind
from tsd_twin.lab import manoeuvres as lab_manoeuvres
from tsd_twin.lab.manoeuvres import TwistAt
from tsd_twin.lab.rerun import chosen_robot
from tsd_twin.lie import SE2
from tsd_twin.messages.cdr import BASE
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.pose import PoseStamped, encode_pose
from tsd_twin.messages.sentences import full_sentence
from tsd_twin.messages.topics import STATUS
from tsd_twin.recording import open_recording
from tsd_twin.recording.mcap_file import entries
from tsd_twin.recording.reader import decoders
from tsd_twin.robots import OmniDescription, RobotDescription, SingularityDescription
from tsd_twin.sensors.gyro import Gyro
from tsd_twin.sensors.pose import Camera
from tsd_twin.shadow import STREAMS, Drift, ShadowFeed, ShadowReport, ShadowTwin
from tsd_twin.simulation import BATTERY, PLANTS, DegradedRobot, Wear

_REPORT_S = 0.1
WITHIN_S = 5.0
"""Maximum time in which a worn part should be named."""


@dataclass(slots=True)
class Health:
    """Shadow twin with the named parts and its latest report."""

    twin: ShadowTwin
    report: ShadowReport = field(default_factory=lambda: ShadowReport(0.0))
    named: list[tuple[float, Drift]] = field(default_factory=list[tuple[float, Drift]])
    """Each part once, with the time at which it was first named."""
    compared_s: float = 0.0
    _next_s: float = 0.0

    def feed(self, state: RobotState) -> None:
        """Pass the state of a robot to the twin."""
        at_ns, odom = state.joints.stamp_ns, state.odom.message
        self.twin.advance(at_ns, state.joints, state.setpoint, odom, state.status)

    def look(self, t_s: float, *, last: bool = False) -> None:
        """Create a report every `_REPORT_S`, and if this is the `last`."""
        if t_s < self._next_s and not last:
            return
        self._next_s = t_s + _REPORT_S
        report = self.twin.report()
        known = {drift.part for _, drift in self.named}
        self.named += [(t_s, drift) for drift in report.drifts if drift.part not in known]
        self.compared_s += max(0.0, report.compared_s - self.report.compared_s)
        self.report = report


def _lines(health: Health, what: str) -> list[str]:
    """Return the lines to print for a robot."""
    report = health.report
    lines = [f"{what}, compared for {health.compared_s:.1f} s"]
    if not report.joints:
        return [*lines, "no joints: nothing can be compared"]
    lines += experiment.markdown_table(
        ["joint", "measured", "simulated", "difference", "band", ""],
        [
            [
                joint.name,
                "-" if joint.measured is None else f"{joint.measured:.2f} {joint.unit}",
                f"{joint.simulated:.2f} {joint.unit}",
                "-" if joint.measured is None else f"{joint.measured - joint.simulated:.2f}",
                f"±{joint.band:.2f}",
                "not measured" if joint.measured is None else _inside(joint.inside),
            ]
            for joint in report.joints
        ],
    )
    if report.pose is not None:
        pose = report.pose
        rows = zip(pose.names, pose.units, pose.difference, pose.band, strict=True)
        lines += [
            f"motion of the last second, {name}: {value:.1f} {unit} off, ±{band:.1f} allowed"
            for name, unit, value, band in rows
        ]
    lines += [f"{t_s:.1f} s: {drift.text}" for t_s, drift in health.named]
    if not health.named:
        lines.append("no part drifts")
    return [*lines, full_sentence(report.note)] if report.note else lines


def _inside(inside: bool) -> str:
    return "inside" if inside else "OUTSIDE"


# Recordings.


def health_of_recording(path: Path, robot_id: str | None, out: Output) -> list[str]:
    """Return the health of a robot in a recording.

    Raises:
        TwinError: If the file is not a recording, or the robot is missing or ambiguous.
    """
    recording = open_recording(path)
    robot_id = chosen_robot(recording, robot_id)
    text = recording.description(robot_id)
    robot = robots.parse_description(text, f"description of {robot_id}")
    health = Health(ShadowTwin(robot))
    feed, decode = ShadowFeed(health.twin), decoders(robot)
    names = {topic.key(robot_id): name for name, topic in STREAMS.items()}
    names[STATUS.key(robot_id)] = "status"

    def replay() -> Iterator[float]:
        for entry in entries(path, names):
            t_s, name = 1e-9 * (entry.log_ns - recording.start_ns), names[entry.topic]
            try:
                message = decode[name](entry.data)
                if name == "status":
                    feed.status = message
                else:
                    feed.add(name, message, entry.publish_ns)
            except MessageError:
                continue
            health.look(t_s)
            yield t_s

    out.show_progress(replay(), max(recording.duration_s, 1e-9), "comparing")
    health.look(recording.duration_s, last=True)
    return _lines(health, f"{robot_id} in {path}")


# Robots on the bus.


def health_of_robot(args: argparse.Namespace, out: Output) -> list[str]:
    """Return the health of a robot on the bus, after `--seconds`.

    Raises:
        TwinError: If no robot answers, or several.
    """
    with connect(args.connect or None, robot=args.id, zenoh_config=args.zenoh_config) as client:
        health = Health(ShadowTwin(client.link.robot))
        begin_s = time.monotonic()

        def watch() -> Iterator[float]:
            for state in client.states(args.seconds):
                health.feed(state)
                t_s = time.monotonic() - begin_s
                health.look(t_s)
                yield t_s

        out.show_progress(watch(), args.seconds, "comparing, drive it")
        health.look(time.monotonic() - begin_s, last=True)
        return _lines(health, f"{client.link.id} on the bus")


# Simulated robots.


def _arc(random: np.random.Generator) -> TwistAt:
    """Drive an arc with constant twist, at 80 % of the top speed."""
    angle, side = random.uniform(0.0, 2.0 * np.pi), random.choice([-1.0, 1.0])
    vx, vy = 0.8 * math.cos(angle), 0.8 * math.sin(angle)
    return lambda _: (vx, vy, 0.6 * side)


def _line(random: np.random.Generator) -> TwistAt:
    """Drive straight at a constant speed of at least half the top speed."""
    angle, speed = random.uniform(0.0, 2.0 * np.pi), random.uniform(0.5, 1.0)
    twist = (speed * math.cos(angle), speed * math.sin(angle), 0.0)
    return lambda _: twist


MANOEUVRES = lab_manoeuvres.MANOEUVRES | {"arc": _arc, "line": _line}
STAND, MIXED = "stand", "mixed"
_TURN_S = 30.0
"""Duration of each manoeuvre if they are mixed."""


@dataclass(frozen=True, slots=True)
class WearScenario:
    """Simulated robot with its shadow twin."""

    robot: str
    plant: str
    errors: float
    seed: int
    manoeuvre: str
    seconds: float
    camera: bool = False
    wear: str = ""
    """Wear as in `tsd-mock --wear`, or "" for a healthy robot."""
    wear_s: float = 0.0
    """Time at which the wear begins."""
    gyro: bool = False

    def description(self) -> RobotDescription:
        """Return the description of the robot.

        Raises:
            TwinError: If the robot cannot have a gyro.
        """
        robot = robots.load_robot(self.robot)
        if not self.gyro or any(joint.name == "gyro" for joint in robot.sensors):
            return robot
        if not isinstance(robot, SingularityDescription | OmniDescription):
            raise TwinError(f"--gyro: {robot.name} does not drive over a floor")
        return msgspec.structs.replace(robot, gyro=Gyro())

    @property
    def worn_part(self) -> str:
        """Name of the worn part, or "" for a healthy robot."""
        return self.wear.partition("=")[0]

    @property
    def kind(self) -> str:
        """Kind of the worn part and amount of wear, such as `wheel -5%`, or "" if healthy."""
        part, _, size = self.wear.partition("=")
        if part in ("", BATTERY):
            return f"{part} {size}".strip()
        joints = {joint.name: joint.kind for joint in self.description().kinematics().joints}
        return f"{'servo' if joints[part] is JointKind.POSITION else 'wheel'} {size}"


@dataclass(frozen=True, slots=True)
class Result:
    """Result of a case."""

    case: WearScenario
    named: list[tuple[float, Drift]]
    """Named parts; times since the wear began, or since the start."""
    compared_s: float
    processor_share: float
    """CPU time of the twin relative to the compared time."""

    @property
    def found_s(self) -> float:
        """Time until the worn part was named, or infinite."""
        return min(
            (t_s for t_s, drift in self.named if self._is_right(t_s, drift)), default=math.inf
        )

    @property
    def wrong(self) -> list[tuple[float, Drift]]:
        """Named parts that are healthy."""
        return [
            (t_s, drift)
            for t_s, drift in self.named
            if drift.part and not self._is_right(t_s, drift)
        ]

    def _is_right(self, t_s: float, drift: Drift) -> bool:
        return t_s >= 0.0 and self.case.worn_part == drift.part


def _twists(case: WearScenario, robot: RobotDescription) -> TwistAt:
    """Return the twist as a function of time, within the limits of the robot."""
    random = np.random.default_rng([case.seed, 5])
    made = {name: make(random) for name, make in MANOEUVRES.items()}
    scale = robot.kinematics().twist_scale_m
    top, turn = robot.limits.speed_mps / scale, robot.limits.turn_rate_rad_per_s
    names = [*made, STAND]

    def twist(t_s: float) -> tuple[float, float, float]:
        name = names[int(t_s / _TURN_S) % len(names)] if case.manoeuvre == MIXED else case.manoeuvre
        if name == STAND:
            return (0.0, 0.0, 0.0)
        x, y, z = made[name](t_s)
        return (top * x, top * y, turn * z / 3.0)

    return twist


def drive(case: WearScenario) -> Result:
    """Drive a robot with its twin."""
    robot = case.description()
    simulated = DegradedRobot(
        robot, seed=case.seed, noise=1.0, plant=case.plant, errors=case.errors
    )
    link = SimulationLink(robot, simulated, None)
    client = RobotClient(link, "lab")
    camera = Camera(robot.pose_sensor.camera_noise(), np.random.default_rng([case.seed, 7]))
    health, spent_s = Health(ShadowTwin(robot)), 0.0
    twist_at = _twists(case, robot)
    with client, client.control() as control:
        control.arm()
        begin_s = client.time_s
        worn = not case.wear
        for now_s in control.driving(lambda now_s: twist_at(now_s - begin_s), frame=BASE):
            t_s = now_s - begin_s
            if t_s >= case.seconds:
                break
            if not worn and t_s >= case.wear_s:
                simulated.wear(Wear.parse(case.wear, robot))
                worn = True
            pose = simulated.truth(now_s).pose
            if case.camera and isinstance(pose, SE2):
                for frame in camera.capture(now_s, pose):
                    seen = PoseStamped.planar(SE2(frame.pose), round(1e9 * frame.taken_s))
                    link.send_pose(encode_pose(seen))
            state = link.state()
            at_s = time.process_time()
            health.feed(state)
            health.look(t_s)
            spent_s += time.process_time() - at_s
    named = [(t_s - case.wear_s, drift) for t_s, drift in health.named]
    return Result(case, named, health.compared_s, spent_s / max(health.compared_s, 1e-9))


def _worn_part(wear: str, robot: RobotDescription, seed: int) -> str:
    """Return wear of the seed's joint, if the part is `wheel` or `servo`."""
    part, _, size = wear.partition("=")
    kind = {"wheel": JointKind.VELOCITY, "servo": JointKind.POSITION}.get(part)
    names = [joint.name for joint in robot.kinematics().joints if joint.kind is kind]
    if not names or part in [joint.name for joint in robot.kinematics().joints]:
        return wear
    return f"{names[seed % len(names)]}={size}"


def _simulations(args: argparse.Namespace, out: Output) -> list[str]:
    seeds = range(args.seed, args.seed + args.seeds)
    manoeuvres = args.manoeuvres or (list(MANOEUVRES) if args.wear else [MIXED])
    robot = robots.load_robot(args.robot)
    cases = [
        WearScenario(
            args.robot,
            args.plant,
            errors,
            seed,
            manoeuvre,
            args.seconds,
            args.camera,
            _worn_part(wear, robot, seed),
            0.5 * args.seconds if wear else 0.0,
            args.gyro,
        )
        for errors in args.errors
        for wear in args.wear or [""]
        for manoeuvre in manoeuvres
        for seed in seeds
    ]
    for case in cases:
        if case.wear:
            Wear.parse(case.wear, case.description())
    results = experiment.run_cases(drive, cases, args.jobs, out)
    out.table(
        "health",
        {
            "robot": [each.case.robot for each in results],
            "plant": [each.case.plant for each in results],
            "errors": [each.case.errors for each in results],
            "seed": [float(each.case.seed) for each in results],
            "manoeuvre": [each.case.manoeuvre for each in results],
            "wear": [each.case.wear or "none" for each in results],
            "compared_s": [each.compared_s for each in results],
            "found_after_s": [each.found_s for each in results],
            "wrong_names": [float(len(each.wrong)) for each in results],
            "processor_share": [each.processor_share for each in results],
        },
    )
    groups: dict[tuple[float, str, str], list[Result]] = {}
    for each in results:
        groups.setdefault((each.case.errors, each.case.kind, each.case.manoeuvre), []).append(each)
    sensors = " + ".join(name for name in ("gyro", "camera") if getattr(args, name)) or "joints"
    rows = [
        [
            args.plant,
            f"{errors:g}",
            sensors,
            kind or "none",
            manoeuvre,
            f"{len(same)}",
            f"{sum(each.compared_s for each in same) / 60.0:.1f} min",
            f"{sum(each.found_s <= WITHIN_S for each in same)}" if kind else "-",
            _times(same) if kind else "-",
            f"{sum(math.isinf(each.found_s) for each in same)}" if kind else "-",
            f"{sum(len(each.wrong) for each in same)}",
        ]
        for (errors, kind, manoeuvre), same in groups.items()
    ]
    said = [
        f"errors {each.case.errors:g}, seed {each.case.seed}, {each.case.manoeuvre}, "
        f"{each.case.wear or 'sound'}, at {t_s:.1f} s: {drift.text}"
        for each in results
        for t_s, drift in each.wrong
    ]
    head = [
        *("plant", "errors", "sensors", "wear", "manoeuvre", "runs", "compared"),
        *(f"within {WITHIN_S:g} s", "median / p95 / worst", "not named", "wrong names"),
    ]
    share = max(each.processor_share for each in results)
    return [
        *experiment.markdown_table(head, rows),
        *said,
        f"processor time of the twin: up to {100.0 * share:.1f} %",
    ]


def _times(results: Sequence[Result]) -> str:
    found = sorted(each.found_s for each in results)
    shown = [found[len(found) // 2], found[math.ceil(0.95 * len(found)) - 1], found[-1]]
    return " / ".join("never" if math.isinf(one) else f"{one:.1f} s" for one in shown)


def run(args: argparse.Namespace, out: Output) -> list[str]:
    """Differences between a robot and its shadow twin: recorded, live or simulated.

    Raises:
        TwinError: If the recording or robot does not exist, or the choice is ambiguous.
    """
    if args.log is not None:
        return health_of_recording(args.log, args.id, out)
    if args.live:
        return health_of_robot(args, out)
    return _simulations(args, out)


def _flags(parser: argparse.ArgumentParser) -> None:
    source = parser.add_mutually_exclusive_group()
    source.add_argument("--log", type=Path, metavar="FILE", help="a recording of tsd-record")
    source.add_argument("--live", action="store_true", help="a robot on the bus, while it drives")
    parser.add_argument("--id", help="robot in the recording or on the bus, if there are several")
    text = "where the robot listens, with --live"
    flags.add(parser, "--connect", text, metavar="ENDPOINT", repeated=True)
    parser.add_argument("--zenoh-config", metavar="FILE", help="a JSON5 file, with --live")
    text = "time with --live, and of each simulated robot"
    flags.add(parser, "--seconds", text, flags.number(5.0), 60.0)
    parser.add_argument("--plant", choices=PLANTS, default="kinematic", help="default kinematic")
    text = "times [errors] of simulated robots; default 0 1"
    flags.add(parser, "--errors", text, flags.SCALE, [0.0, 1.0], "SCALE", nargs="+")
    parser.add_argument("--camera", action="store_true", help="simulated robots have a camera")
    parser.add_argument("--gyro", action="store_true", help="simulated robots have a yaw gyro")
    text = (
        "let a part of simulated robots wear half-way, as tsd-mock --wear; wheel=-5%% and "
        "servo=-30%% are another one for each seed"
    )
    flags.add(parser, "--wear", text, metavar="PART=-SIZE", repeated=True)
    text = "of simulated robots; default all with --wear, else mixed"
    flags.add(parser, "--manoeuvres", text, nargs="+", choices=[*MANOEUVRES, MIXED, STAND])
    flags.add(parser, "--seeds", "robots of each row", flags.whole(1), 1)
    experiment.add_jobs_flag(parser)


EXPERIMENT = Experiment(
    "health",
    run,
    [
        "tsd-lab health --log run.mcap                     a recording",
        "tsd-lab health --live --seconds 30                a robot on the bus",
        "tsd-lab health --seconds 1800                     sound robots for half an hour",
        "tsd-lab health --wear servo=-30% --manoeuvres 'full stick' --seeds 8",
        "tsd-lab health --wear wheel=-5% --camera --seconds 20 --plant mujoco",
    ],
    robot="tsd",
    seed_of="the first simulated robot of a row",
    add_own_flags=_flags,
)
