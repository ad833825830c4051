"""Experiment `health`: robots, recordings or many simulated robots against their shadow twins."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from tsd_twin import robots
from tsd_twin.cli import experiment, flags
from tsd_twin.cli.experiment import Experiment, Output
from tsd_twin.client.sync import connect
from tsd_twin.lab.rerun import chosen_robot
from tsd_twin.lab.robot_health import Health, lines
from tsd_twin.lab.wear_drives import (
    MANOEUVRES,
    MIXED,
    STAND,
    Result,
    WearScenario,
    drive,
    wear_of_seed,
)
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.topics import STATUS
from tsd_twin.recording import open_recording
from tsd_twin.recording.mcap_file import entries
from tsd_twin.recording.reader import decoders
from tsd_twin.shadow import STREAMS, ShadowFeed, ShadowTwin
from tsd_twin.simulation import PLANTS, Wear

WITHIN_S = 5.0
"""Maximum time in which a worn part should be named."""


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
    return lines(health, f"{robot_id} in {path}")


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
        return lines(health, f"{client.link.id} on the bus")


# Simulated robots.


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
            wear_of_seed(wear, robot, seed),
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
